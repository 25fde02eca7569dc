"""Cleaned depth compared with the NumPy reference (twin): equal quality, and almost equal masks."""

from __future__ import annotations

import numpy as np
import pytest

import pyibr as ibr
from benchmarks import scenes
from benchmarks.cleaning import twin as reference
from tests.cleaning.test_cleaning import BASELINE, FOCAL
from tests.data import shared
from tests.one_lane import both_forms

pytest.importorskip("cv2", reason="the reference needs OpenCV")


def scene(size: tuple[int, int], seed: int, noise: float = 0.3) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """True depth, noisy depth and colours of boxes in front of a slanted wall.

    The noisy depth has a hole, and a tenth of its samples are missing.
    """
    rng, (height, width) = np.random.default_rng(seed), size
    y, x = np.mgrid[:height, :width]
    truth = 1 / (0.3 + 0.001 * x + 0.0007 * y)
    color = np.full((*size, 3), 60, np.uint8)
    for _ in range(4):
        top, left = rng.integers(0, height), rng.integers(0, width)
        box = np.s_[top : top + height // 3, left : left + width // 4]
        truth[box], color[box] = rng.uniform(1, 2), rng.integers(0, 256, 3)
    disparity = FOCAL * BASELINE / truth + rng.normal(0, noise, size)
    depth = FOCAL * BASELINE / (np.round(disparity * 8) / 8)
    depth[rng.random(size) < 0.1] = np.nan
    depth[height // 3 : height // 3 + 9, width // 5 : width // 2] = np.nan
    return truth.astype(np.float32), depth.astype(np.float32), color


def overlap(a: np.ndarray, b: np.ndarray) -> float:
    """Intersection over union."""
    return float((a & b).sum() / max((a | b).sum(), 1))


def error(found: np.ndarray, truth: np.ndarray, noisy: np.ndarray) -> float:
    """Mean error of nearness, in decibels, of pixels with a sample."""
    both = np.isfinite(noisy) & np.isfinite(found) & np.isfinite(truth)
    return 20 * float(np.log10(np.abs(1 / found - 1 / truth)[both].mean()))


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("guided", [False, True])
def test_it_is_as_good_and_in_the_same_places(seed, guided):
    truth, noisy, color = scene((97, 131), seed)
    color = color if guided else None
    before = None
    for _ in range(2):
        ours, twin = (f(noisy, color, before=before) for f in (ibr.clean_depth, reference.clean_depth))
        assert error(ours.depth, truth, noisy) < error(twin.depth, truth, noisy) + 0.1
        # Single samples differ: the twin finds islands in values rounded to sixteenths, and noise from other samples.
        assert overlap(np.isfinite(ours.depth), np.isfinite(twin.depth)) > 0.999
        assert overlap(ours.invented, twin.invented) > 0.98
        _, noisy, _ = scene((97, 131), seed)
        noisy = noisy * np.float32(1.0001)
        before = twin.depth


@pytest.mark.parametrize("holes", [0, 1, 3, 8, 40, pytest.param(1000, marks=pytest.mark.thorough)])
def test_the_same_area_is_filled(holes):
    depth = np.full((61, 83), 2, np.float32)
    rng = np.random.default_rng(holes)
    depth[rng.random(depth.shape) < 0.97] = np.nan
    ours, twin = (f(depth, holes=holes, strength=0) for f in (ibr.clean_depth, reference.clean_depth))
    np.testing.assert_array_equal(np.isfinite(ours.depth), np.isfinite(twin.depth))
    np.testing.assert_array_equal(ours.invented, twin.invented)


@pytest.mark.parametrize("size", [(7, 13), (61, 37), (40, 160)])
@pytest.mark.parametrize("colors", ["none", "quarters", "bytes"])
def test_regions_grow_as_they_do_step_by_step(size, colors):
    """Depth grows into each pixel from the same sample as in the twin, to the bit, through random colours.

    For colours in bytes, 97 % of the pixels agree: divided by 255, equal differences of colours differ by rounding.
    """
    rng = np.random.default_rng(size[0])
    quarters = (rng.integers(0, 5, (*size, 3)) / 4).astype(np.float32)
    color = {"none": None, "quarters": quarters, "bytes": rng.integers(0, 60, (*size, 3)).astype(np.uint8)}[colors]
    depth = (2 + 0.001 * rng.random(size)).astype(np.float32)  # one surface, without speckle
    depth[rng.random(size) < 0.8] = np.nan
    ours, twin = (f(depth, color, holes=30, strength=0) for f in (ibr.clean_depth, reference.clean_depth))
    assert (ours.depth == twin.depth).mean() >= (0.97 if colors == "bytes" else 1)


@pytest.mark.thorough
@pytest.mark.parametrize("size", [(1, 1), (7, 13), (50, 33)])
def test_one_lane_cleans_as_sixteen(size):
    _, noisy, color = scene(size, 5)
    colors = color / np.float32(255)
    for more in ({}, {"before": np.full(size, 2, np.float32)}):
        wide, single = both_forms(lambda more=more: ibr.clean_depth(noisy, colors, **more))
        np.testing.assert_array_equal(wide.invented, single.invented)
        np.testing.assert_allclose(wide.depth, single.depth, rtol=1e-6)  # products and sums may be fused


@pytest.mark.thorough
@pytest.mark.parametrize("frame", [1, 50])
@pytest.mark.parametrize("noise", [0.1, 0.3, 0.6])
def test_it_is_as_good_in_a_real_room(frame, noise):
    """Errors are at most 0.1 dB larger than the twin's, and the masks of valid depth overlap by 99.9 %."""
    shared("rgbd_livingroom1")
    view = scenes.rgbd(scenes.LIVINGROOM, frame, (640, 480))
    rng = np.random.default_rng(frame)
    noisy = scenes.with_disparity_noise(view.depth, FOCAL, noise, rng)
    noisy[rng.random(noisy.shape) < 0.05] = np.nan
    ours, twin = (f(noisy, view.color) for f in (ibr.clean_depth, reference.clean_depth))
    assert error(ours.depth, view.depth, noisy) < error(twin.depth, view.depth, noisy) + 0.1
    assert overlap(np.isfinite(ours.depth), np.isfinite(twin.depth)) > 0.999
    assert overlap(ours.invented, twin.invented) > 0.99


@pytest.mark.thorough
@pytest.mark.parametrize("file", ["depth1_01.png", "depth1_06.png"])
def test_a_real_sensor_is_cleaned_in_the_same_places(file):
    depth = ibr.read_depth(shared("formats/asus_xtion_unregistered") / file, depth_scale=1000)
    ours, twin = (f(depth) for f in (ibr.clean_depth, reference.clean_depth))
    assert overlap(np.isfinite(ours.depth), np.isfinite(twin.depth)) > 0.999
    assert overlap(ours.invented, twin.invented) > 0.99
    both = np.isfinite(ours.depth) & np.isfinite(twin.depth)
    # Half of the sensor's noise; its depth has steps of 1.4 mm at a distance of 1 m.
    assert np.quantile(np.abs(ours.depth / twin.depth - 1)[both], 0.99) < 7e-4
