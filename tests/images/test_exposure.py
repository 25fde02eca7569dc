"""Gains that match views with different exposures; they do not depend on the views' order."""

from __future__ import annotations

import numpy as np
import pytest

import pyibr as ibr
from pyibr.images.exposure import Overlap, exposure_gains, matching_gains
from tests.scenes import pose

SIZE = (64, 48)


def wall(at: float, gain: float, depth: float = 4.0, yaw: float = 0.0) -> ibr.DepthImage:
    """A view of an endless wall at distance `depth`, whose colours are smooth in the world."""
    camera = ibr.Camera([[50, 0, 31.5], [0, 50, 23.5], [0, 0, 1]], SIZE, pose(yaw, center=(at, 0, 0)))
    x = np.mgrid[: SIZE[1], : SIZE[0]][1]
    z = np.full(x.shape, depth, np.float32)
    if yaw == 0:
        along = at + (x - 31.5) / 50 * depth
        color = 0.45 + 0.1 * np.sin(along)[..., None] * (1, 0.5, 0.8)
    else:
        color = np.full((*x.shape, 3), 0.45)
    return ibr.DepthImage((color * gain).astype(np.float32), z, camera)


@pytest.mark.parametrize("apart", [0.02, 0.4, 1.2])
def test_gains_are_those_that_views_were_exposed_by(apart):
    exposures = np.random.default_rng(4).uniform(0.6, 1.4, 25)
    found = exposure_gains([wall(apart * number, one) for number, one in enumerate(exposures)])
    # 2 %: positions in the other view are rounded to pixels, and colours change by up to 2 % per pixel.
    np.testing.assert_allclose(found, (np.median(exposures) / exposures)[:, None] * [1, 1, 1], rtol=0.02)


def test_the_order_changes_no_bit():
    exposures = np.random.default_rng(5).uniform(0.6, 1.4, 9)
    views = [wall(0.3 * (number // 2), one) for number, one in enumerate(exposures)]  # two views per camera
    first = exposure_gains(views)
    for seed in range(3):
        order = np.random.default_rng(seed).permutation(len(views))
        fresh = [ibr.DepthImage(views[k].color, views[k].depth, views[k].camera) for k in order]
        np.testing.assert_array_equal(exposure_gains(fresh), first[order])


def test_two_groups_far_apart_from_one_another_agree_if_any_of_their_views_do():
    """In each place there are twenty views, more than the number of neighbours with which a view is compared."""
    views = [wall(0.001 * number, 1.0) for number in range(20)]
    views += [wall(2.0 + 0.001 * number, 1.3) for number in range(20)]
    found = exposure_gains(views)
    np.testing.assert_allclose(found[:20] / found[20:], 1.3, rtol=0.01)


def test_views_that_nothing_is_known_of_keep_their_colours():
    away = wall(0.0, 0.7, yaw=180)
    found = exposure_gains([wall(0, 1.0), away, wall(0.2, 1.2)])
    np.testing.assert_allclose(found[1], 1.0)
    np.testing.assert_allclose(found[0] / found[2], 1.2, rtol=0.02)
    np.testing.assert_array_equal(exposure_gains([away]), np.ones((1, 3)))


def test_colours_do_not_tell_where_views_show_two_surfaces():
    """One view sees a surface in front of the wall; noise does not explain the distance between the two."""
    found = exposure_gains([wall(0, 1.0), wall(0, 0.5, depth=3.0)])
    np.testing.assert_array_equal(found, np.ones((2, 3)))


def test_pairs_that_contradict_the_others_count_little():
    """One of fifteen pairs has a wrong ratio, by 0.5 as a logarithm, as if a view saw a lamp in a mirror."""
    logs = np.random.default_rng(6).uniform(-0.3, 0.3, 6)
    pairs = [(a, b) for a in range(6) for b in range(a)]
    overlaps = [Overlap(a, b, np.full(3, logs[a] - logs[b]), 500) for a, b in pairs]
    overlaps[7] = Overlap(*pairs[7], overlaps[7].ratio + 0.5, 500)
    found = np.log(matching_gains(6, overlaps))[:, 0]
    expected = np.median(logs) - logs
    assert np.abs(found - expected).max() < 0.02
