"""The noise of depth: found, given, and the steps of coarse scales."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import pyibr as ibr
from pyibr.images.noise import DepthNoise

Array = NDArray[Any]
SIZE = (160, 120)
CAMERA = ibr.Camera([[150, 0, 79.5], [0, 150, 59.5], [0, 0, 1]], SIZE)


def room(size: tuple[int, int] = SIZE) -> Array:
    """A wall aslant and a floor, 1.5 to 8 units away."""
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
    assert view.in_float.noise == view.noise
    assert pickle.loads(pickle.dumps(view)).noise == view.noise
    lens = ibr.Camera(CAMERA.K, SIZE, lens=ibr.Lens("brown_conrady", [-0.2, 0.02, 0, 0]))
    assert ibr.undistorted(ibr.DepthImage(None, view.depth, lens, noise=0.003)).noise == view.noise


@pytest.mark.parametrize("noise", [-1.0, np.nan, (1.0, 2.0), (1.0, -2.0, 0.0), "much", lambda z: z[:2], lambda z: -z])
def test_what_is_no_noise_is_refused(noise):
    with pytest.raises(ibr.ArgumentError, match="noise"):
        view_of(room(), noise=noise)


@pytest.mark.parametrize("kind", [(0.002, 0, 0), (0, 0.003, 0), (0, 0, 0.004)])
def test_noise_is_found(kind):
    depth = room((640, 480))
    a, b, c = kind
    noisy = depth + np.random.default_rng(0).normal(size=depth.shape) * (a * depth**2 + b * depth + c)
    camera = ibr.Camera(4 * CAMERA.K + [[0, 0, 0], [0, 0, 0], [0, 0, -3]], (640, 480))
    found = ibr.DepthImage(None, noisy.astype(np.float32), camera).noise
    for z in (2.0, 4.0, 6.0):
        # A median of 250 differences is right to 6 %, a fit through twelve of them to less.
        assert found[0] * z * z + found[1] * z + found[2] == pytest.approx(a * z * z + b * z + c, rel=0.12)


def test_disparitys_noise_is_that_of_nearness():
    assert ibr.disparity_noise(0.25, 500, 0.1) == pytest.approx(0.25 / 50)
    for arguments in ((-1, 500, 0.1), (1, 0, 0.1), (1, 500, np.nan)):
        with pytest.raises(ibr.ArgumentError):
            ibr.disparity_noise(*arguments)


def test_steps_are_those_of_the_scale():
    depth = room((640, 480))
    disparity = np.rint(40 / depth * 4) / 4
    assert DepthNoise((40 / disparity).astype(np.float32)).steps == pytest.approx((1 / 160, 0, 0), rel=0.02)
    a, b, c = DepthNoise((np.rint(depth * 20) / 20).astype(np.float32)).steps
    for z in (2.0, 5.0):
        assert a * z * z + b * z + c == pytest.approx(0.05, rel=0.2)


def test_what_has_no_scale_has_no_steps():
    rng = np.random.default_rng(0)
    boxes = np.full((480, 640), 10.0)
    for _ in range(20):
        y, x = rng.integers(0, 400), rng.integers(0, 560)
        boxes[y : y + 80, x : x + 80] = rng.uniform(2, 9)
    rows = np.broadcast_to(1 / (0.1 + 0.001 * np.arange(480))[:, None], (480, 640))  # each row has a depth of its own
    for depth in (
        room((640, 480)),
        boxes,
        rows,
        np.full((480, 640), 3.0),
        np.full((480, 640), np.nan),
        np.ones((1, 1)),
    ):
        assert DepthNoise(depth.astype(np.float32)).steps == (0, 0, 0)
