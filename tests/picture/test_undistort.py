"""Undistorted images, by both forms of the kernel, compared with the slow reference."""

from __future__ import annotations

import numpy as np
import pytest

import pyibr as ibr
from tests.embree import pixels_of
from tests.reference import undistort

BARREL = ibr.Lens("brown_conrady", [-0.25, 0.06, 0.003, -0.002])
LENSES = {
    "barrel": BARREL,
    "rational": ibr.Lens("rational", [0.548, -0.021, 2e-05, -7e-05, -0.0027, 0.89, 0.086, -0.0139]),
    "fisheye": ibr.Lens("kannala_brandt", [0.02, -0.01, 0.002, 0]),
}


def noisy_view(size: tuple[int, int], lens: ibr.Lens, dtype: str = "uint8", far: float = np.inf) -> ibr.DepthImage:
    """A view of two surfaces, with holes, infinite samples, and noise by which some neighbours are torn apart."""
    width, height = size
    rng = np.random.default_rng(width)
    y, x = np.mgrid[:height, :width]
    depth = np.where(np.hypot(x - 0.4 * width, y - 0.5 * height) < 0.25 * min(size), 1.5, 2.5 + 0.01 * x)
    depth = (depth * rng.normal(1, 0.02, depth.shape)).astype(np.float32)
    depth[rng.random(depth.shape) < 0.05] = rng.choice([np.nan, 0, np.inf, -1])
    color = rng.integers(0, 256, (height, width, 3)).astype(np.uint8)
    picture = color if dtype == "uint8" else (color / 255).astype(np.float32)
    f = 0.7 * max(size)
    camera = ibr.Camera([[f, 0, 0.52 * width], [0, 1.03 * f, 0.47 * height], [0, 0, 1]], size, lens=lens)
    return ibr.DepthImage(None if dtype == "none" else picture, depth, camera, far=far)


def check(view: ibr.DepthImage, cut_ratio: float | None, linear: bool) -> None:
    found = ibr.undistorted(view, cut_ratio=cut_ratio, interpolation="linear" if linear else "nearest")
    color, depth, sure = undistort.undistorted(view, found.camera, cut_ratio, linear)
    assert sure.mean() > 0.95
    # Positions are rounded to float32, by up to 1e-5 pixels, which changes colours by at most 1 level of 255.
    np.testing.assert_allclose(found.depth[sure], depth[sure], rtol=1e-5, equal_nan=True)
    if view.has_color:
        most = 1.0 if view.color.dtype == np.uint8 else 1 / 255
        np.testing.assert_allclose(found.color[sure], color[sure], atol=most)
    assert np.isfinite(found.depth).mean() > 0.6


@pytest.mark.usefixtures("lanes")
@pytest.mark.parametrize("dtype", ["uint8", "float32", "none"])
@pytest.mark.parametrize("lens", LENSES)
def test_as_the_slow_twin(lens, dtype):
    for cut_ratio, linear in ((1.05, True), (1.02, False), (None, True)):
        check(noisy_view((83, 61), LENSES[lens], dtype), cut_ratio, linear)


@pytest.mark.parametrize("size", [(1, 1), (1, 9), (13, 1), (2, 2), (7, 13)])
def test_small_images(size):
    found = ibr.undistorted(noisy_view(size, BARREL))
    assert found.camera.lens is None
    assert found.valid.any()


def test_background_stays_background():
    view = noisy_view((83, 61), BARREL, far=2.0)
    found = ibr.undistorted(view, cut_ratio=1.05)
    assert found.far == 2.0
    assert 0 < found.valid.mean() < 0.4
    # No depth is interpolated between the background and a nearer surface.
    assert not ((found.depth > 1.7) & (found.depth < 2.3)).any()


def test_once_is_enough():
    view = noisy_view((83, 61), BARREL)
    assert ibr.undistorted(view) is ibr.undistorted(view)
    assert ibr.undistorted(view) is not ibr.undistorted(view, cut_ratio=1.2)
    pinhole = ibr.DepthImage(view.color, view.depth, ibr.Camera(view.camera.K, view.camera.size))
    assert ibr.undistorted(pinhole) is pinhole


def test_what_is_out_of_a_lens_sight_is_not_made_up():
    """Barrel distortion limits the field of view; depth that is stored outside of it shows no surface."""
    lens = ibr.Lens("brown_conrady", [-0.45, 0, 0, 0])
    camera = ibr.Camera([[40, 0, 41], [0, 40, 30], [0, 0, 1]], (83, 61), lens=lens)
    depth = np.where(np.isnan(camera.ideal_positions(pixels_of(camera))[:, 0]), 9, 2).reshape(61, 83)
    assert (depth == 9).any()
    found = ibr.undistorted(ibr.DepthImage(None, depth.astype(np.float32), camera))
    np.testing.assert_allclose(found.depth[found.valid], 2, rtol=1e-6)
    with pytest.raises(ibr.ArgumentError, match=r"view: expected a pyibr\.DepthImage"):
        ibr.undistorted(found.depth)  # pyright: ignore[reportArgumentType]


def test_few_copies_of_a_view_are_kept():
    view = noisy_view((24, 18), BARREL)
    made = [ibr.undistorted(view, cut_ratio=1.02 + 0.01 * k) for k in range(9)]
    kept_ones = [
        one for cache in view.device_cache.values() for (name, _), one in cache.items() if name == "undistorted"
    ]
    assert len(kept_ones) <= 4
    assert ibr.undistorted(view, cut_ratio=1.10) is made[-1]


@pytest.mark.parametrize(
    ("argument", "value"), [("cut_ratio", "x"), ("cut_ratio", 1.0), ("interpolation", "no"), ("view", None)]
)
def test_wrong_arguments_are_named(argument, value):
    with pytest.raises(ibr.ArgumentError, match=f"^{argument}: "):
        ibr.undistorted(**{"view": noisy_view((24, 18), BARREL), argument: value})
