"""Reliefs on planes and on curved solids, compared with rays cast at fine meshes of the carved surface."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
import pytest

import pyibr as ibr
from pyibr.core.camera import Camera
from pyibr.images.metrics import silhouette_iou
from tests.displaced import interior, square
from tests.relief.solids import Carved, cylinder, grid, plane, sphere, torus

SIZE = (240, 180)
WHITE = np.full((2, 2, 3), 200, np.uint8)


def tiled_noise(seed: int, sigma: float) -> np.ndarray:
    """Smooth noise from 0 to 1, 64 x 64 texels, which tiles."""
    noise = np.pad(np.random.default_rng(seed).random((64, 64)), 16, mode="wrap")
    smooth = cv2.GaussianBlur(noise, (0, 0), sigma)[16:-16, 16:-16]
    return ((smooth - smooth.min()) / np.ptp(smooth)).astype(np.float32)


@cache
def bricks() -> np.ndarray:
    """A map of 64 x 64 texels with rough bricks and slanted joints, which tiles."""
    y, x = np.mgrid[:64, :64]
    across = np.minimum((x + 16 * (y // 16 % 2)) % 32, 31 - (x + 16 * (y // 16 % 2)) % 32)
    joint = np.minimum(across, np.minimum(y % 16, 15 - y % 16))
    return (np.clip(joint / 4, 0, 1) * (0.7 + 0.3 * tiled_noise(2, 1.5))).astype(np.float32)


def distance(frame: ibr.Frame, truth: np.ndarray, camera: Camera) -> np.ndarray:
    """(H, W) distance, in scene units, between the points that a pixel shows in the frame and in truth."""
    y, x = np.mgrid[: camera.height, : camera.width]
    rays = np.stack([x, y, np.ones_like(x)], axis=-1) @ np.linalg.inv(camera.K).T
    length = np.linalg.norm(rays, axis=-1) if camera.projection == "perspective" else 1.0
    return np.abs(frame.depth - truth) * length


def over_square(elevation: float, projection: str = "perspective", size: tuple[int, int] = SIZE) -> Camera:
    """A camera at `elevation` degrees that looks at the middle of the unit square."""
    e = np.radians(elevation)
    eye = np.array([0.5, 0.5, 0]) + 1.6 * np.array([0.35 * np.cos(e), -0.94 * np.cos(e), np.sin(e)])
    tall = {"height": 0.9} if projection == "orthographic" else {}
    return Camera.look_at(eye, (0.5, 0.5, 0), (0, 0.3, 1), size, fov_y=32, projection=projection, **tall)


@cache
def carved_plane(thin: bool) -> Carved:
    """A plane of 3 x 3 unit squares. The relief's polygon is the middle one; rays continue below its neighbours."""
    return Carved(plane, (spikes() if thin else bricks()), 0.05, (3, 3), fine=4)


@cache
def spikes() -> np.ndarray:
    """Single texels of full height, and a ridge, over low ground; even steps miss them."""
    height = np.full((64, 64), 0.1, np.float32)
    height[4::16, 6::16] = 1
    height[40, :] = 1
    return height


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
@pytest.mark.parametrize("elevation", [90, 60, 30, 10])
@pytest.mark.parametrize("thin", [False, True])
def test_a_plane(elevation, projection, thin):
    camera = over_square(elevation, projection)
    height = spikes() if thin else bricks()
    base = square()
    truth = carved_plane(thin).depth(camera)
    frame = ibr.render(ibr.ReliefSurface(base, height, WHITE, 0.05), camera)
    entered = ibr.render(base, camera).valid
    np.testing.assert_array_equal(frame.valid, entered)
    # On level ground, depth changes by 0.005 / sin(elevation) from row to row of pixels.
    inside = interior(np.where(entered, truth, np.inf), max(0.033, 0.025 / np.sin(np.radians(elevation))))
    assert inside.sum() > 600
    off = distance(frame, truth, camera)[inside] * 64  # texels
    assert (off <= 0.5).mean() >= 0.999, (off <= 0.5).mean()


def test_even_steps_miss_thin_features_and_safe_ones_do_not():
    camera = over_square(15, size=(400, 300))
    base = square()
    truth = carved_plane(True).depth(camera)
    missed = {}
    for search in ("safe", "linear"):
        frame = ibr.render(ibr.ReliefSurface(base, spikes(), WHITE, 0.05, search=search), camera)
        # A ray that steps over such a texel shows a point more than a texel away from the true surface.
        missed[search] = (distance(frame, truth, camera)[frame.valid] * 64 > 1).mean()
    assert missed["safe"] <= 0.002  # at outlines of such texels
    assert missed["linear"] >= 5 * missed["safe"]
    assert missed["linear"] >= 0.01


@pytest.mark.parametrize("side", [0, 1, 2, 3])
@pytest.mark.parametrize(("n", "distance_"), [(64, "exact"), (48, "approximate")])
def test_rays_along_an_axis_of_the_map(n, side, distance_):
    """Parallel rays, each in one row or column of texels or between two, are compared with 4096 even steps."""
    e, d = np.radians(12), np.radians(90 * side)
    away = np.array([np.cos(e) * np.cos(d), np.cos(e) * np.sin(d), np.sin(e)])
    camera = Camera.look_at(
        (0.5, 0.5, 0) + 1.6 * away, (0.5, 0.5, 0), (0, 0, 1), (129, 65), fov_y=32, projection="orthographic", height=1.0
    )
    base, height = square(), bricks()[:n, :n]
    safe, even = (
        ibr.render(ibr.ReliefSurface(base, height, WHITE, 0.05, distance=distance_, **options), camera)
        for options in ({}, {"search": "linear", "steps": 4096})
    )
    np.testing.assert_array_equal(safe.valid, even.valid)
    off = np.abs(safe.depth - even.depth)[safe.valid] * n  # texels
    assert (off <= 0.1).mean() >= 0.998  # rounding decides for grazing rays


def around(name: str, distance_: float = 1.0) -> Camera:
    eye = {"cylinder": (3.2, -1.2, 0.3), "sphere": (3.2, -1.2, 0.35), "torus": (2.2, -3.0, 1.9)}[name]
    return Camera.look_at(distance_ * np.array(eye), (0, 0, 0), (0, 0, 1), SIZE, fov_y=42)


SOLIDS = {
    "cylinder": (cylinder, (8, 3), (64, 8)),
    "sphere": (sphere, (8, 3), (64, 32)),
    "torus": (torus, (10, 4), (96, 48)),
}
SCALES = {"cylinder": 0.05, "sphere": 0.05, "torus": 0.025}


@cache
def carved(name: str) -> Carved:
    surface, tiles, _ = SOLIDS[name]
    return Carved(surface, bricks(), SCALES[name], tiles)


def banded_iou(a: np.ndarray, b: np.ndarray) -> float:
    """Intersection over union of the pixels within 12 pixels of b's silhouette."""
    inner, outer = cv2.erode(b.astype(np.uint8), np.ones((3, 3))), cv2.dilate(b.astype(np.uint8), np.ones((3, 3)))
    band = cv2.dilate(outer - inner, np.ones((25, 25))) > 0
    return silhouette_iou(a & band, b & band)


@pytest.mark.parametrize("distance_", ["approximate", "exact"])
@pytest.mark.parametrize("name", list(SOLIDS))
def test_curved_solids(name, distance_):
    surface, tiles, cells = SOLIDS[name]
    camera, base = around(name), grid(surface, *cells)
    truth = carved(name).depth(camera)
    solid = np.isfinite(truth)
    frames: dict[str, ibr.Frame] = {}
    for silhouette in ("quadric", "none"):
        relief = ibr.ReliefSurface(
            base, bricks(), WHITE, SCALES[name], tiles=tiles, silhouette=silhouette, distance=distance_
        )
        frames[silhouette] = ibr.render(relief, camera)
    frame = frames["quadric"]
    assert silhouette_iou(frame.valid, solid) >= 0.99
    assert banded_iou(frame.valid, solid) >= 0.95
    wrong = {silhouette: (made.valid ^ solid).sum() for silhouette, made in frames.items()}
    assert wrong["quadric"] <= 0.4 * wrong["none"], wrong
    inside = interior(truth, 0.05)
    assert inside.sum() > 1800
    assert frame.valid[inside].all()
    texel = 2 * np.pi * (1.4 if name == "torus" else 1.0) / (tiles[0] * 64)
    off = distance(frame, truth, camera)[inside] / texel
    assert (off <= 2).mean() >= 0.97, (off <= 2).mean()


def test_zero_curvature_is_flat_relief():
    base = square()
    camera = over_square(25)
    quadric, none = (
        ibr.render(ibr.ReliefSurface(base, bricks(), WHITE, 0.05, silhouette=silhouette), camera)
        for silhouette in ("quadric", "none")
    )
    np.testing.assert_array_equal(quadric.depth, none.depth)


@pytest.mark.parametrize("search", ["safe", "linear"])
def test_a_height_of_one_is_the_mesh_itself(search):
    base, camera = grid(torus, 48, 24), around("torus")
    relief = ibr.ReliefSurface(base, np.ones((8, 8), np.float32), WHITE, 0.1, tiles=(4, 2), search=search)
    frame = ibr.render(relief, camera)
    mesh = ibr.render(ibr.Mesh(base.vertices, base.faces, sides="front"), camera)
    np.testing.assert_array_equal(frame.valid, mesh.valid)
    # The linear search finds the hit in its first step, which six halvings refine.
    step = 0.0 if search == "safe" else 0.1
    assert np.abs(frame.depth - mesh.depth)[frame.valid].max() <= 1e-4 + step


def test_scaling_everything_changes_nothing():
    camera, far = around("torus"), around("torus", 10.0)
    base = grid(torus, 48, 24)
    larger = ibr.Mesh(10 * base.vertices, base.faces, uv=base.uv, normals=base.normals)
    small = ibr.render(ibr.ReliefSurface(base, bricks(), WHITE, 0.05, tiles=(8, 4)), camera)
    large = ibr.render(ibr.ReliefSurface(larger, bricks(), WHITE, 0.5, tiles=(8, 4)), far)
    assert (small.valid != large.valid).mean() <= 1e-4
    both = small.valid & large.valid
    assert np.isclose(small.depth * 10, large.depth, rtol=1e-4)[both].mean() >= 0.999


def test_from_afar_means_are_read_and_bounds_hold():
    """Each pixel covers many texels, and the relief is less than two pixels deep: it looks like its mean height."""
    height = (np.indices((64, 64)).sum(axis=0) % 2).astype(np.float32)
    base = grid(torus, 48, 24)
    camera = Camera.look_at((22, -30, 19), (0, 0, 0), (0, 0, 1), (120, 90), fov_y=3.4)
    frame = ibr.render(ibr.ReliefSurface(base, height, WHITE, 0.04, tiles=(16, 6)), camera)
    mean = ibr.render(ibr.ReliefSurface(base, np.full((2, 2), 0.5, np.float32), WHITE, 0.04, tiles=(16, 6)), camera)
    assert silhouette_iou(frame.valid, mean.valid) >= 0.98
    both = frame.valid & mean.valid
    assert np.median(np.abs(frame.depth - mean.depth)[both]) <= 0.01


def test_two_coincident_cylinders_show_what_lies_farther_out():
    """Two reliefs on one cylinder: each shows where its height is greater."""
    other = tiled_noise(4, 3)
    camera, base, tiles = around("cylinder"), grid(cylinder, 64, 8), (12, 5)
    red, blue = (np.full((2, 2, 3), color, np.uint8) for color in ((200, 40, 40), (40, 40, 200)))
    frame = ibr.render(
        [
            ibr.ReliefSurface(base, bricks(), red, 0.05, tiles=tiles),
            ibr.ReliefSurface(base, other, blue, 0.05, tiles=tiles),
        ],
        camera,
    )
    truths = [Carved(cylinder, height, 0.05, tiles, fine=1).depth(camera) for height in (bricks(), other)]
    nearest = np.minimum(*truths)
    inside = interior(nearest, 0.05) & frame.valid
    agrees = (frame.color[..., 0] > 100) == (truths[0] < truths[1])
    assert agrees[inside].mean() >= 0.98, agrees[inside].mean()
    assert 0.2 <= (truths[0] < truths[1])[inside].mean() <= 0.8
