"""Relief kernels compared with tests/reference/relief.py in float64, numbers of steps, and coordinates on the map."""

from __future__ import annotations

import numpy as np
import pytest

import pyibr as ibr
from pyibr.capture import models
from pyibr.core.camera import Camera
from pyibr.opencl.memory import empty
from pyibr.picture.target import Target
from pyibr.relief import draw_relief
from tests.displaced import square
from tests.embree import points_of
from tests.reference.heights import bilinear_height
from tests.reference.relief import relief_depth
from tests.relief.solids import Carved, cylinder, grid, sphere, torus

WHITE = np.full((2, 2, 3), 200, np.uint8)
SCALE, TILES = 0.1, (6, 3)


def hills(rows: int = 12) -> np.ndarray:
    """Heights of `rows` x 16 texels that tile without a seam."""
    y, x = np.mgrid[:rows, :16]
    a, b = 2 * np.pi * x / 16, 2 * np.pi * y / rows
    return (0.5 + 0.3 * np.sin(a) * np.cos(b) + 0.15 * np.cos(2 * a + b)).astype(np.float32)


def seen_from(projection: str) -> Camera:
    tall = {"height": 1.65} if projection == "orthographic" else {}
    return Camera.look_at((1.3, -2.3, 1.5), (0, 0, 0), (0, 0, 1), (49, 31), fov_y=34, projection=projection, **tall)


@pytest.mark.parametrize(("search", "projection"), [("linear", "orthographic"), ("safe", "perspective")])
def test_a_torus_is_as_in_float64(search, projection):
    """The safe search is compared with 96 even steps, which miss no part of these hills."""
    camera, base = seen_from(projection), models.donut(12)
    thing = ibr.ReliefSurface(base, hills(), WHITE, SCALE, tiles=TILES, distance="approximate", search=search)
    steps, halvings = (32, 6) if search == "linear" else (96, 12)
    rounded = np.rint(hills() * 65535.0) / 65535
    expected = relief_depth(base, thing.frames, rounded, SCALE, TILES, camera, "approximate", steps, halvings)
    frame = ibr.render(thing, camera)
    assert frame.valid.sum() > 600
    # Rounding decides whether a ray hits if it grazes the outline, or a hill in front of another hill.
    assert (frame.valid != np.isfinite(expected)).mean() <= 2e-3
    both = frame.valid & np.isfinite(expected)
    assert (np.abs(frame.depth - expected)[both] <= 2e-4).mean() >= 0.99


@pytest.mark.thorough
def test_perpendicular_distances_are_as_in_float64():
    camera, base = seen_from("perspective"), models.donut(16)
    thing = ibr.ReliefSurface(base, hills(), WHITE, SCALE, tiles=TILES, distance="perpendicular", search="linear")
    rounded = np.rint(hills() * 65535.0) / 65535
    expected = relief_depth(base, thing.frames, rounded, SCALE, TILES, camera, "perpendicular")
    frame = ibr.render(thing, camera)
    assert (frame.valid != np.isfinite(expected)).mean() <= 2e-3
    both = frame.valid & np.isfinite(expected)
    # For rays along the normal, perpendicular distances grow without bound, and so does their rounding.
    assert (np.abs(frame.depth - expected)[both] <= SCALE / 50).mean() >= 0.99


@pytest.mark.parametrize("surface", [sphere, cylinder])
def test_exact_distances_hold_on_deep_reliefs(surface):
    """Reliefs are 0.3 deep, on a tube and a sphere of radius 1. Outlines are right to a pixel, depths to 0.005."""
    camera = Camera.look_at((8, 0, 0), (0, 0, 0), (0, 0, 1), (161, 121), projection="orthographic", height=121 / 43.9)
    flat, wide, off = np.zeros((4, 4), np.float32), {}, {}
    for distance in ("approximate", "exact"):
        relief = ibr.ReliefSurface(grid(surface, 64, 32), flat, WHITE, 0.3, tiles=(4, 4), distance=distance)
        frame = ibr.render(relief, camera)
        points = points_of(frame)
        radius = np.linalg.norm(points if surface is sphere else points[:, :2], axis=1)
        wide[distance], off[distance] = frame.valid[60].sum(), np.abs(radius - 0.7)
    assert abs(wide["exact"] - 2 * 0.7 * 43.9) <= 1 < wide["approximate"] - 2 * 0.7 * 43.9
    # With 64 sides, a chord is up to 0.0012 inside of the circle, and quadrics are fitted to points 0.1 away.
    assert np.quantile(off["exact"], 0.95) <= 0.005 < np.quantile(off["approximate"], 0.95)


def test_exact_distances_are_nearer_on_a_deep_torus():
    """The relief is half as deep as the tube's radius.

    Seen along the axis, the outline is the torus's equators, where exact distances are exact. In oblique views they are
    not, since the curvature changes along the outline.
    """
    truth, flat = Carved(torus, np.zeros((32, 32)), 0.2, (6, 4)), np.zeros((4, 4), np.float32)
    too_many: dict[tuple[str, bool], float] = {}
    for along in (True, False):
        eye = (0.3, 0, 5) if along else (2.2, -3.0, 1.9)
        camera = Camera.look_at(eye, (0, 0, 0), (0, 1, 0) if along else (0, 0, 1), (321, 239), fov_y=42)
        covered = np.isfinite(truth.depth(camera)).sum()
        for distance in ("approximate", "exact"):
            relief = ibr.ReliefSurface(grid(torus, 96, 48), flat, WHITE, 0.2, tiles=(4, 4), distance=distance)
            too_many[distance, along] = ibr.render(relief, camera).valid.sum() / covered - 1
    assert abs(too_many["exact", True]) <= 0.005 < 0.3 < too_many["approximate", True]
    assert too_many["exact", False] <= 0.15 < 0.35 < too_many["approximate", False]


@pytest.mark.parametrize("distance", ["approximate", "exact"])
@pytest.mark.parametrize("surface", [sphere, cylinder, torus])
def test_even_heights_are_parallel_surfaces(surface, distance):
    """Constant heights give the parallel surface 0.05 below a sphere, a cylinder and a torus, up to the outline."""
    eye = (1.2, -2.0, 2.2) if surface is torus else (4.0, 0, 0)
    camera = Camera.look_at(eye, (0, 0, 0), (0, 0, 1), (161, 121), fov_y=30 if surface is not torus else 46)
    even = np.full((4, 4), 0.5, np.float32)
    frame = ibr.render(
        ibr.ReliefSurface(grid(surface, 96, 64), even, WHITE, 0.1, tiles=(4, 4), distance=distance), camera
    )
    points = points_of(frame)
    around = np.hypot(points[:, 0], points[:, 1])
    radius = {sphere: np.linalg.norm(points, axis=1), cylinder: around, torus: 0.6 + np.hypot(around - 1, points[:, 2])}
    off = np.abs(1 - radius[surface] - 0.05)
    assert len(points) > 4000
    assert np.median(off) <= 1e-3
    assert (off <= 5e-3).mean() >= 0.97  # a tenth of the depth; at outlines, quadrics are less precise


def test_coordinates_in_the_tile():
    """The height of the map at each pixel's coordinates gives the depth that the picture shows."""
    camera = Camera.look_at((0.8, -0.5, 0.7), (0.5, 0.5, 0), (0, 0, 1), (161, 117), fov_y=45)
    thing = ibr.ReliefSurface(square(), hills(8), WHITE, SCALE, tiles=TILES)
    places, frame = thing.tile_coordinates(camera), ibr.render(thing, camera)
    assert places.shape == (117, 161, 2)
    assert places.dtype == np.float32
    np.testing.assert_array_equal(np.isfinite(places).all(axis=2), frame.valid)
    assert (places[frame.valid] >= 0).all()
    assert (places[frame.valid] <= 1).all()
    points = points_of(frame)
    off = (places[frame.valid] - points[:, :2] * TILES + 0.5) % 1 - 0.5
    assert np.abs(off).max() <= 1e-4
    deep = SCALE * (bilinear_height(hills(8).astype(float), *places[frame.valid].astype(float).T) - 1)
    assert np.abs(deep - points[:, 2]).max() <= 1e-3
    with pytest.raises(ibr.ArgumentError, match=r"^camera: "):
        thing.tile_coordinates("camera")


@pytest.mark.thorough
def test_steps_are_counted():
    """On a relief of constant height 0.5, even steps stop half-way; the safe search skips the empty space above it."""
    camera = Camera.look_at((0.5, 0.5, 1), (0.5, 0.5, 0), (0, 1, 0), (31, 23), fov_y=20)
    counted: dict[str, np.ndarray] = {}
    for search in ("linear", "safe"):
        thing = ibr.ReliefSurface(square(), np.full((8, 8), 0.5, np.float32), WHITE, 0.1, search=search)
        counts = empty((23, 31, 2), np.int32)
        counts.fill(0)
        draw_relief(Target(camera, np.dtype(np.uint8)), thing, None, counters=counts)
        counted[search] = counts.to_host().copy()
        assert (counted[search][..., 0] == 1).all()
    # 16 or 17 steps of 32, since the height is rounded to 16 bits, and six halvings.
    assert set(np.unique(counted["linear"][..., 1])) <= {22, 23}
    assert counted["safe"][..., 1].max() <= 6
