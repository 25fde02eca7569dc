"""Noise of depth, given or estimated, and estimated steps of depth with a coarse scale."""

from __future__ import annotations

import pickle
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

import pyibr as ibr
from pyibr.images.noise import DepthNoise
from tests.data import shared

Array = NDArray[Any]
SIZE = (160, 120)
CAMERA = ibr.Camera([[150, 0, 79.5], [0, 150, 59.5], [0, 0, 1]], SIZE)


def room(size: tuple[int, int] = SIZE) -> Array:
    """(H, W) depth of a slanted wall and a floor, 1.5 to 8 units away."""
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, size[0]), np.linspace(-0.4, 0.4, size[1]))
    return np.minimum(6 / (1 - x), np.where(y > 0.02, 0.6 / np.maximum(y, 0.02), np.inf))


def view_of(depth: Array, **options: Any) -> ibr.DepthImage:
    return ibr.DepthImage(None, depth.astype(np.float32), CAMERA, **options)


def test_given_noise_is_kept_in_each_of_its_forms():
    depth = room()
    assert view_of(depth, noise=0.003).noise == (0.003, 0, 0)
    assert view_of(depth, noise=(0.001, 0.0, 0.002)).noise == (0.001, 0, 0.002)
    assert view_of(depth, noise=lambda z: 0.002 + 0.001 * z * z).noise == pytest.approx((0.001, 0, 0.002), abs=1e-9)
    assert view_of(np.full(depth.shape, np.nan), noise=lambda z: 0.5 * z).noise == pytest.approx((0.5, 0, 0), abs=1e-3)
    flat = ibr.Camera([[10, 0, 79.5], [0, 10, 59.5], [0, 0, 1]], SIZE, projection="orthographic")
    assert ibr.DepthImage(None, depth.astype(np.float32), flat, noise=0.01).noise == (0, 0, 0.01)


def test_given_noise_goes_with_the_view():
    view = ibr.DepthImage(np.zeros((*room().shape, 3), np.uint8), room().astype(np.float32), CAMERA, noise=0.003)
    assert view.in_float.noise == view.noise and pickle.loads(pickle.dumps(view)).noise == view.noise
    lens = ibr.Camera(CAMERA.K, SIZE, lens=ibr.Lens("brown_conrady", [-0.2, 0.02, 0, 0]))
    assert ibr.undistorted(ibr.DepthImage(None, view.depth, lens, noise=0.003)).noise == view.noise


@pytest.mark.parametrize("noise", [-1.0, np.nan, (1.0, 2.0), (1.0, -2.0, 0.0), "much", lambda z: z[:2], lambda z: -z])
def test_what_is_no_noise_is_refused(noise):
    with pytest.raises(ibr.ArgumentError, match="noise"):
        view_of(room(), noise=noise)


each_kind = pytest.mark.parametrize("kind", [(0.002, 0, 0), (0, 0.003, 0), (0, 0, 0.004)])


@each_kind
def test_noise_is_found(kind):
    depth = room((640, 480))
    noisy = depth + np.random.default_rng(0).normal(size=depth.shape) * np.polyval(kind, depth)
    camera = ibr.Camera(4 * CAMERA.K + [[0, 0, 0], [0, 0, 0], [0, 0, -3]], (640, 480))
    found = ibr.DepthImage(None, noisy.astype(np.float32), camera).noise
    for z in (2.0, 4.0, 6.0):
        # An estimate from 250 differences is accurate to 6 %; a fit to twelve estimates is better.
        assert np.polyval(found, z) == pytest.approx(np.polyval(kind, z), rel=0.12)


def test_disparitys_noise_is_that_of_nearness():
    assert ibr.disparity_noise(0.25, 500, 0.1) == pytest.approx(0.25 / 50)
    for arguments in ((-1, 500, 0.1), (1, 0, 0.1), (1, 500, np.nan)):
        with pytest.raises(ibr.ArgumentError):
            ibr.disparity_noise(*arguments)


def test_steps_are_those_of_the_scale():
    depth = room((640, 480))
    disparity = np.rint(40 / depth * 4) / 4
    assert DepthNoise((40 / disparity).astype(np.float32)).steps == pytest.approx((1 / 160, 0, 0), rel=0.02)
    steps = DepthNoise((np.rint(depth * 20) / 20).astype(np.float32)).steps
    np.testing.assert_allclose(np.polyval(steps, (2.0, 5.0)), 0.05, rtol=0.2)


@pytest.mark.parametrize("unit", [1e-25, 1e-3, 1e33])
def test_noise_and_steps_have_no_unit(unit):
    """In these units, products of differences of nearness exceed the range of float32."""
    disparity = 40 / room((640, 480)) + np.random.default_rng(4).normal(0, 0.1, (480, 640))
    depth = 40 / (np.rint(8 * disparity) / 8)
    same, noise = DepthNoise(depth.astype(np.float32)), DepthNoise((depth * unit).astype(np.float32))
    assert any(same.steps)
    with np.errstate(over="raise", divide="raise", invalid="raise"):
        pairs = (same.deviation, noise.deviation), (same.steps, noise.steps)
    for (a, b, c), found in pairs:
        expected = np.minimum([a / unit, b, c * unit], 1e18)  # 1e18: limit of each term
        # Samples are sorted into parts of octaves of nearness, which in another unit contain other samples.
        assert np.polyval(found, 4 * unit) == pytest.approx(np.polyval(expected, 4 * unit), rel=0.1)


def test_what_has_no_scale_has_no_steps():
    rng = np.random.default_rng(0)
    boxes = np.full((480, 640), 10.0)
    for _ in range(20):
        y, x = rng.integers(0, 400), rng.integers(0, 560)
        boxes[y : y + 80, x : x + 80] = rng.uniform(2, 9)
    rows = np.broadcast_to(1 / (0.1 + 0.001 * np.arange(480))[:, None], (480, 640))  # each row has its own depth
    stairs = np.repeat(2 + 0.05 * np.arange(8), 40)[None] * np.ones((240, 1))
    leaves = np.full((45, 60), 4.0)  # at different depths in front of a wall
    rng = np.random.default_rng(3)
    for _ in range(30):
        y, x = rng.integers(0, 40), rng.integers(0, 55)
        leaves[y : y + 4, x : x + 4] = rng.uniform(3.0, 3.2)
    planes = [np.full((480, 640), 3.0), np.full((480, 640), np.nan), np.ones((1, 1))]
    for depth in (room((640, 480)), boxes, rows, stairs, leaves, *planes):
        assert DepthNoise(depth.astype(np.float32)).steps == (0, 0, 0)


def deviation_at(depth: Array, z: float) -> float:
    return float(np.dot(DepthNoise(np.ascontiguousarray(depth, np.float32)).deviation, (z * z, z, 1)))


def chequer(side: int, height: float, slope: float) -> Array:
    """(H, W) depth of a board 4 units away, whose black squares, `side` samples wide, are `height` farther."""
    y, x = np.mgrid[:151, :203]
    up = (x // side + y // side) % 2
    return (4 + height * up) / (1 + slope * x / 203)


@pytest.mark.parametrize("slope", [0.0, 0.2])
@pytest.mark.parametrize("side", [2, 3, 4, 7])
def test_exact_depth_has_no_noise(side, slope):
    blocks = np.random.default_rng(0).uniform(2, 4, (76, 102)).repeat(2, axis=0).repeat(2, axis=1)
    assert deviation_at(blocks, 3.0) == 0
    assert deviation_at(chequer(side, 0.02, slope), 4.0) < 1e-6 * 4.0
    rows, columns = np.mgrid[:151, :203]
    wires = np.where((columns + 0.6 * rows) % 17 < side, 2.0, 4.0)
    assert deviation_at(wires * (1 + 0.1 * np.arange(203) / 203), 3.0) < 1e-6 * 3.0
    y, x = np.mgrid[:151, :203] / 20
    assert deviation_at(3 + 0.5 * np.sin(x) * np.cos(1.3 * y), 3.0) < 1e-5 * 3.0  # a curved surface is not noisy


@each_kind
@pytest.mark.parametrize("slope", [0.0, 0.6])
def test_noise_of_walls_and_slopes_is_found_and_crops_agree(kind, slope):
    depth = 2.5 / (1 + slope * (np.arange(321) / 321 - 0.5)) * np.ones((243, 1))
    noisy = depth + np.random.default_rng(1).normal(size=depth.shape) * np.polyval(kind, depth)
    whole = deviation_at(noisy, 2.5)
    assert whole == pytest.approx(np.polyval(kind, 2.5), rel=0.1)
    for part in (noisy[3:, 5:], noisy[:-7, :-4], noisy[::-1], noisy.T):
        assert deviation_at(part, 2.5) == pytest.approx(whole, rel=0.1)


def test_noise_of_a_sky_is_not_that_of_the_ground():
    noisy = room((640, 480)) + np.random.default_rng(0).normal(0, 0.01, (480, 640))
    noisy[:200] = 100.0
    assert deviation_at(noisy, 3.0) == pytest.approx(0.01, rel=0.1)


def test_a_corridors_disparity_in_bytes_is_a_scale():
    """From sample to sample, the corridor's walls change by more than a step of the scale, and its end by none."""
    y, x = np.mgrid[:240, :320]
    with np.errstate(divide="ignore"):
        depth = np.minimum(np.minimum(290 * 0.9 / np.abs(x - 159.5), 290 * 1.2 / np.abs(y - 119.5)), 8.0)
    step = (1 / depth.min()) / 255
    steps = DepthNoise((1 / (np.rint(1 / depth / step) * step)).astype(np.float32)).steps
    assert steps == pytest.approx((step, 0, 0), rel=0.02, abs=1e-9)


@pytest.mark.parametrize("name", ["7scenes_tsdf_fusion/frame-*.depth.png", "asus_xtion_unregistered/depth1_0[1-3].png"])
def test_frames_of_one_recording_and_their_crops_agree(name):
    found = list[float]()
    for path in sorted((shared("formats")).glob(name)):
        depth = cv2.imread(str(path), cv2.IMREAD_UNCHANGED) / 1000
        found += [deviation_at(part, 2.0) for part in (depth, depth[3:, 5:], depth[:-7, :-4], depth[11:, 9:], depth.T)]
    assert len(found) >= 15 and max(found) < 1.1 * min(found)
    assert min(found) > 0.004  # half of a step of the depth's scale, 10.7 mm, is 5 mm
