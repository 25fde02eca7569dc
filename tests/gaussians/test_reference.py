"""Pictures of Gaussians compared with blending in float64."""

from __future__ import annotations

import numpy as np
import pytest

import pyibr as ibr
from benchmarks.gaussians.twin import blended
from tests.gaussians.clouds import camera, cloud, like, shuffled
from tests.one_lane import both_forms


def check(frame: ibr.Frame, expected: tuple[np.ndarray, ...], left_out: np.ndarray | None = None) -> None:
    """Compare a frame with a reference: colour to a level, alpha to .004, depth on nearly all pixels."""
    color, alpha, depth = expected
    seen = np.ones(depth.shape, np.bool_) if left_out is None else ~left_out
    error = np.abs(frame.color / (255 if frame.color.dtype == np.uint8 else 1) - color).max(axis=2)
    assert error[seen].max() <= 1 / 255
    assert np.abs(frame.alpha - alpha)[seen].max() <= 0.004
    same = np.isclose(frame.depth, depth, rtol=1e-4, atol=0, equal_nan=True)
    assert same[seen].mean() >= 0.999
    np.testing.assert_array_equal(frame.valid[seen], ~np.isnan(frame.depth[seen]))


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_a_picture_equals_the_reference(degree, projection):
    thing, view = cloud(900, degree, seed=degree), camera(projection=projection)
    frame = ibr.render(thing, view)
    assert 0.2 < frame.valid.mean() < 0.99 and (frame.alpha > 0.9).any()
    check(frame, blended([thing], view))


def test_long_thin_and_large_ones_equal_the_reference():
    rng, count, view = np.random.default_rng(5), 300, camera((97, 131))
    means = rng.uniform(-1, 1, (count, 3)) * (3, 3, 2) + (0, 0, 3)
    scales = np.exp(rng.uniform(np.log(1e-4), np.log(3), (count, 3)))
    thing = ibr.Gaussians(
        means, scales, rng.normal(size=(count, 4)), rng.uniform(0.05, 0.6, count), colors=rng.random((count, 3))
    )
    check(ibr.render(thing, view), blended([thing], view))


@pytest.mark.parametrize(
    "changes", [{"low_pass": 0}, {"antialiased": True}, {"near": 4.0}, {"sh": 20 * cloud(500).sh}], ids="".join
)
def test_options_and_bright_colours_equal_the_reference(changes):
    thing, view = cloud(500, size=0.02), camera()
    other = like(thing, **changes)
    frame = ibr.render(other, view)
    check(frame, blended([other], view))
    assert ("sh" in changes) == (frame.alpha.mean() == ibr.render(thing, view).alpha.mean())


def test_both_forms_of_the_kernels_agree():
    thing, view = cloud(2000, 3), camera()
    wide, narrow = both_forms(lambda: ibr.render(shuffled(thing), view))  # a new thing each time
    assert np.abs(wide.color.astype(int) - narrow.color).max() <= 1
    assert (wide.color != narrow.color).mean() < 1e-3
    np.testing.assert_allclose(wide.alpha, narrow.alpha, atol=1e-5)
    assert np.isclose(wide.depth, narrow.depth, rtol=1e-5, atol=0, equal_nan=True).mean() > 0.9999


def test_many_in_a_larger_picture_equal_the_reference():
    """As in `cloud`, with more Gaussians than a chunk of any sort holds, and several bins."""
    thing, view = cloud(20000, 1, size=0.02), camera((322, 201))
    check(ibr.render(thing, view), blended([thing], view))
