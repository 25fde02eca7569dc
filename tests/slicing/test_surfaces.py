"""Sliced surfaces compared with rays cast at a fine triangulation of the same height field."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
import pytest

import pyibr as ibr
from pyibr.capture import models
from pyibr.core.camera import Camera
from pyibr.slicing import alpha_tests
from tests.displaced import Solid, interior, looking, square
from tests.relief.solids import grid
from tests.relief.solids import torus as ring

SCALE = 0.25
SIZE = (120, 90)
JUMP = 0.05  # in depth between neighbours, at an edge
FINE = 8  # cells of the true mesh per texel, along each axis: a bilinear patch is off its cells by 1/64 of its twist
ELEVATIONS = (90, 60, 35, 15, 5)  # cameras' elevations above the square, in degrees
DIRECTIONS = (10, 100, 190, 280, 55)


def heights(n: int = 32) -> np.ndarray:
    """Hills with heights from 0.1 to 0.9, periodic so that tiles join."""
    y, x = np.mgrid[:n, :n] * (2 * np.pi / n)
    waves = np.sin(2 * x) * np.cos(y) + 0.5 * np.sin(3 * y + x) + 0.3 * np.cos(4 * x - 2 * y)
    return (0.5 + 0.4 * waves / np.abs(waves).max()).astype(np.float32)


def surface(
    slices: int, slicing: str, test: str = "inside", height: np.ndarray | None = None, clipped: bool = True
) -> ibr.SlicedSurface:
    color = np.full((2, 2, 3), 200, np.uint8)
    return ibr.SlicedSurface(
        square(),
        heights() if height is None else height,
        color,
        SCALE,
        slices=slices,
        slicing=slicing,
        test=test,
        clipped=clipped,
    )


def camera(elevation: float, direction: float, size: tuple[int, int] = SIZE, projection: str = "perspective") -> Camera:
    return looking(elevation, direction, SCALE, size, projection)


@cache
def solid() -> Solid:
    return Solid(heights(), SCALE, FINE)


@cache
def views(projection: str) -> list[tuple[Camera, np.ndarray]]:
    """Views from all elevations, each from another direction, from all sides of the lowest ones."""
    way = {90: (10,), 60: (100,), 35: (55,), 15: (190, 280), 5: DIRECTIONS}
    cameras = [camera(e, d, projection=projection) for e in ELEVATIONS for d in way[e]]
    return [(cam, solid().depth(cam)) for cam in cameras]


PROJECTIONS = ["perspective", "orthographic"]


@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("slicing", ["orthogonal", "screen"])
def test_depth_error_falls_as_the_number_of_slices_rises(slicing, projection):
    counts = (16, 64, 256)
    means = []
    truths = views(projection)
    for slices in counts:
        errors = []
        for cam, truth in truths:
            frame = ibr.render(surface(slices, slicing), cam)
            inside = interior(truth, JUMP) & frame.valid
            errors.append((frame.depth - truth)[inside])
        off = np.concatenate(errors)
        means.append(np.abs(off).mean())
        assert means[-1] <= SCALE / slices
    exponent = np.polyfit(np.log(counts), np.log(means), 1)[0]
    assert -1.15 <= exponent <= -0.85, (exponent, means)


@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("slicing", ["orthogonal", "screen"])
def test_no_view_sees_through(slicing, projection):
    """With 256 slices, silhouettes are right, too."""
    for cam, truth in views(projection):
        seen = np.isfinite(truth)
        for slices in (16, 64, 256):
            frame = ibr.render(surface(slices, slicing), cam)
            assert frame.valid[interior(truth, JUMP)].all()
        assert (seen & frame.valid).sum() / (seen | frame.valid).sum() >= 0.99


def test_slices_of_the_surface_are_seen_through_from_the_side():
    """Figure 4 of the paper: seen at 2 degrees, some rays pass between two slices, and more do with fewer slices."""
    through = []
    for slices in (8, 32):
        missed = total = 0
        for d in DIRECTIONS:
            cam = camera(2, d)
            inside = interior(solid().depth(cam), JUMP)
            missed += (~ibr.render(surface(slices, "surface"), cam).valid[inside]).sum()
            total += inside.sum()
        through.append(missed / total)
    assert through[0] > 0.01
    assert through[1] < through[0]


@pytest.mark.parametrize("slicing", ["surface", "orthogonal", "screen"])
def test_the_alpha_test_at_height_0(slicing):
    """At height 0, the test `inside` shows nothing, and `at_least` shows the base."""
    height = heights()
    height[:, :16] = 0
    cam = camera(90, 90, (64, 64))
    masked = ibr.render(surface(32, slicing, "inside", height), cam)
    based = ibr.render(surface(32, slicing, "at_least", height), cam)
    u = ground(cam)[..., 0]
    v = ground(cam)[..., 1]
    # Heights are interpolated up to half a texel beside the step, and by perspective the higher half covers more.
    flat = (u > 0.05) & (u < 0.45) & (v > 0.05) & (v < 0.95)
    assert not masked.valid[flat].any()
    assert based.valid[flat].all()
    np.testing.assert_allclose(based.depth[flat], 2.2 + 0.5 * SCALE, rtol=1e-5)


@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("slicing", ["surface", "orthogonal", "screen"])
def test_at_least_draws_all_of_the_base_from_any_side(slicing, projection):
    """No ray misses the base, at heights of 0, by rounding."""
    flat = np.zeros((32, 32), np.float32)
    for elevation in (70, 45, 20):
        cam = camera(elevation, 33, (128, 128), projection)
        frame = ibr.render(surface(64, slicing, "at_least", flat), cam)
        truth = ibr.render(square(), cam)
        inner = cv2.erode(truth.valid.astype(np.uint8), np.ones((3, 3))).astype(bool)
        assert inner.sum() > 1000
        assert frame.valid[inner].all()
        # Depths of about 2.2 in float32; points up to 1/100,000 of the displacement above the base count as base.
        assert np.abs(frame.depth - truth.depth)[inner].max() <= 1e-5


@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("scale", [0.001, 0.01])
@pytest.mark.parametrize("slicing", ["surface", "orthogonal", "screen"])
def test_at_least_draws_all_of_the_base_however_shallow_it_is(scale, slicing, projection):
    """No ray misses the base if the displacement is 1/3000 of the distance, though rounding is over 1/100,000 of it."""
    base, flat, white = grid(ring, 96, 48), np.zeros((4, 4), np.float32), np.full((2, 2, 3), 255, np.uint8)
    how = {"fov_y": 42.0} if projection == "perspective" else {"projection": projection, "height": 2.9}
    cam = Camera.look_at((2, -2.5, 1.7), (0, 0, 0), (0, 0, 1), (173, 131), **how)
    inner = cv2.erode(ibr.render(base, cam).valid.astype(np.uint8), np.ones((5, 5))).astype(bool)
    assert inner.sum() > 4000
    for slices in (16, 64):
        shown = ibr.SlicedSurface(base, flat, white, scale, slices=slices, slicing=slicing, test="at_least")
        assert ibr.render(shown, cam).valid[inner].all()
    assert not ibr.render(ibr.SlicedSurface(base, flat, white, scale, slicing=slicing), cam).valid.any()


def ground(cam: Camera) -> np.ndarray:
    """(H, W, 3) points where the pixels' rays meet the plane z = 0."""
    y, x = np.mgrid[: cam.height, : cam.width]
    rays = np.stack([x, y, np.ones_like(x)], axis=-1) @ np.linalg.inv(cam.K).T @ cam.world_from_camera[:3, :3].T
    origin = cam.world_from_camera[:3, 3]
    return origin + rays * (-origin[2] / rays[..., 2])[..., None]


def test_a_band_opens_steps_between_neighbours():
    """From the side, the test `inside` shows a filled cliff; `band` shows its top and bottom alone."""
    height = np.full((32, 32), 0.1, np.float32)
    height[:, 16:] = 0.9
    cam = camera(20, 180)
    whole = ibr.render(surface(64, "surface", "inside", height), cam)
    band = ibr.render(surface(64, "surface", "band", height), cam)
    assert band.valid.sum() < 0.9 * whole.valid.sum()
    assert not (band.valid & ~whole.valid).any()


def cliffs() -> np.ndarray:
    """Heights with a slope and two cliffs inside, one 0.3 and one 0.6 high."""
    height = np.tile(np.linspace(0.02, 0.09, 128), (128, 1)).astype(np.float32)
    height[:, 41:87] += 0.3
    height[:, 87:] += 0.9
    return height


@pytest.mark.parametrize("slicing", ["surface", "orthogonal", "screen"])
def test_a_bands_thickness_decides_what_is_apart(slicing):
    """From above no part of the surface is missed; from the side, cliffs higher than the band is thick are open.

    A cliff is a ramp between two texels. Slices are several texels apart, so that hardly any slice meets a ramp.
    """
    size = (200, 150)
    above, aside = camera(90, 90, size, "orthographic"), camera(20, 180, size)
    color = np.full((1, 1, 3), 9, np.uint8)
    whole = {cam: ibr.render(surface(16, slicing, "inside", cliffs()), cam).valid for cam in (above, aside)}
    open_at = {}
    for band in (None, 1 / 16, 0.15, 0.45, 0.75, 5.0):
        thing = ibr.SlicedSurface(square(), cliffs(), color, SCALE, slices=16, slicing=slicing, test="band", band=band)
        missed = {cam: (seen & ~ibr.render(thing, cam).valid).sum() / seen.sum() for cam, seen in whole.items()}
        assert missed[above] <= 0.03  # the cliffs: each one is a texel of 128 and a pixel of 100 wide
        open_at[band] = missed[aside]
    assert open_at[None] == open_at[1 / 16]
    # Each cliff is open below the band, which hangs down from its top.
    assert open_at[0.15] > 1.2 * open_at[0.45] > 1.2 * open_at[0.75]
    assert open_at[0.45] > 0.02
    assert open_at[0.75] < 0.01
    assert open_at[5.0] == 0


def test_a_band_thinner_than_a_slice_leaves_gaps():
    """Bands that are as thick as a slice, half or a quarter of it cover that share of a slope, seen from above."""
    slope = np.tile((np.arange(64) + 0.5) / 64, (64, 1)).astype(np.float32)
    cam = Camera.look_at((0.5, 0.5, 40), (0.5, 0.5, 0), (0, 1, 0), (301, 301), fov_y=1.3)
    inner = (np.abs(ground(cam)[..., :2] - 0.5) < 0.4).all(axis=-1)
    color = np.full((1, 1, 3), 9, np.uint8)
    for part in (1, 0.5, 0.25):
        thing = ibr.SlicedSurface(
            square(), slope, color, 0.01, slices=20, slicing="surface", test="band", band=part / 20
        )
        # 265 pixels contain the edges of 16 slices, at which a pixel each may be wrong.
        assert abs(ibr.render(thing, cam).valid[inner].mean() - part) <= 16 / 265


def test_tests_are_counted():
    cam = camera(60, 30)
    counts = {}
    for slicing in ("surface", "orthogonal", "screen"):
        thing = surface(64, slicing)
        counted, seen = alpha_tests(thing, cam), ibr.render(thing, cam).valid
        assert (counted[seen] >= 1).all()
        assert counted.max() <= 3 * 64 * 2  # more than the slices that a ray can cross
        counts[slicing] = counted[seen].mean()
    assert counts["orthogonal"] < 64


@pytest.mark.parametrize("slicing", ["orthogonal", "screen"])
def test_the_cost_stays_even(slicing):
    """Section 3.4: seen from the side, a surface has more slices, but each of them covers fewer pixels."""
    tests = [alpha_tests(surface(64, slicing), camera(e, d)).sum() for e in ELEVATIONS for d in DIRECTIONS[:2]]
    assert max(tests) <= 1.5 * min(tests)


@pytest.mark.thorough
@pytest.mark.parametrize("elevation", [60, 10])
def test_slices_beside_the_volume_change_the_cost_alone(elevation):
    cam = camera(elevation, 30)
    clipped, whole = surface(32, "screen"), surface(32, "screen", clipped=False)
    frames = [ibr.render(thing, cam) for thing in (clipped, whole)]
    # Where a slice just touches an edge of the volume, rounding decides whether it is inside.
    assert (frames[0].valid != frames[1].valid).mean() < 1e-3
    both = frames[0].valid & frames[1].valid
    assert (np.abs(frames[0].depth - frames[1].depth)[both] > 1e-5).mean() < 1e-3
    assert alpha_tests(whole, cam).sum() > 1.5 * alpha_tests(clipped, cam).sum()


def test_other_heights_without_rebuilding():
    first = surface(32, "orthogonal")
    cam = camera(50, 20)
    ibr.render(first, cam)
    second = first.with_height(np.clip(heights() * 0.5, 0, 1))
    assert second.volume is first.volume
    frame, fresh = ibr.render(second, cam), ibr.render(surface(32, "orthogonal", height=heights() * 0.5), cam)
    np.testing.assert_array_equal(frame.depth, fresh.depth)
    assert not np.array_equal(frame.depth, ibr.render(first, cam).depth, equal_nan=True)


@pytest.mark.parametrize("slicing", ["orthogonal", "screen"])
def test_a_donut_of_constant_height_is_a_fatter_donut(slicing):
    """Depth is near the mesh moved outwards by 0.1: half of the pixels are within one slice, and 90 % within three.

    There are no gaps between the prisms on neighbouring polygons.
    """
    height, color = np.ones((4, 4), np.float32), np.full((1, 1, 3), 200, np.uint8)
    thing = ibr.SlicedSurface(
        models.donut(), height, color, 0.1, tiles=(8, 4), slices=20, slicing=slicing, test="at_least"
    )
    cam = Camera.look_at((1.5, -2.0, 2.5), (0, 0, 0), (0, 0, 1), (160, 120), fov_y=45)
    frame = ibr.render(thing, cam)
    base = models.donut()
    outer = ibr.Mesh(base.vertices + 0.1 * base.normals, base.faces)
    truth = ibr.render(outer, cam)
    both = frame.valid & truth.valid
    assert both.sum() / (frame.valid | truth.valid).sum() >= 0.99
    off = (frame.depth - truth.depth)[both]
    assert np.median(np.abs(off)) <= 0.1 / 20
    assert np.quantile(np.abs(off), 0.9) <= 3 * 0.1 / 20  # rays meet slices obliquely
