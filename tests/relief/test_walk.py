"""Outlines of reliefs of constant height on coarse meshes with creases, saddles and poles, compared with cast rays."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import pyibr as ibr
from benchmarks.relief.outlines import MESHES as SCANS
from benchmarks.relief.outlines import measure
from pyibr.capture import models
from pyibr.relief.neighbours import mitred, sides_beside
from tests.boxes import box, facets
from tests.data import shared
from tests.relief.solids import cylinder, grid


def globe(u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A sphere of radius 1 about the origin, with both poles."""
    a, b = 2 * np.pi * u, np.pi * (v - 0.5)
    normals = np.stack([np.cos(b) * np.cos(a), np.cos(b) * np.sin(a), np.sin(b)], axis=-1)
    return normals, normals


def cushion(cells: int = 9) -> ibr.Mesh:
    """A cube of 6 x cells x cells squares, whose sides have equal normals at common corners."""
    x, y = np.meshgrid(*[np.linspace(-1, 1, cells + 1)] * 2)
    i = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()
    square = np.concatenate([np.stack([i, i + 1, i + cells + 2], 1), np.stack([i, i + cells + 2, i + cells + 1], 1)])
    points, faces, uv = [], [], []
    for axis in range(3):
        for side in (-1.0, 1.0):
            of_side = np.stack([side * x, y, np.full_like(x, side)], axis=-1).reshape(-1, 3)
            points.append(np.roll(of_side, axis, axis=1))
            faces.append(square + 2 * axis * x.size + (side > 0) * x.size)
            uv.append(np.stack([x, y], axis=-1).reshape(-1, 2))
    at = np.concatenate(points)
    normals = np.sign(at) * (np.abs(at) > 1 - 1e-6)
    return ibr.Mesh(at, np.concatenate(faces), uv=np.concatenate(uv), normals=normals)


MESHES: dict[str, tuple[Callable[[], ibr.Mesh], float]] = {
    # the mesh, and the least intersection over union with the truth
    "creases": (cushion, 0.96),
    "poles": (lambda: grid(globe, 32, 16), 0.98),
    "6 sides": (lambda: models.donut(6), 0.97),
    "8 sides": (lambda: models.donut(8), 0.97),
    "12 sides": (lambda: models.donut(12), 0.97),
    "24 sides": (lambda: models.donut(24), 0.97),
}
SCANNED = {
    "Spot": (0.75, 1.1),
    "rocker-arm": (0.75, 1.1),
    "cheburashka": (0.75, 1.1),
    "fandisk, smooth": (0.75, 1.1),
    "fandisk, creased": (0.75, 1.1),
    "cow": (0.75, 1.4),
}
"""Least and greatest move of the outlines, as a fraction of the true move.

The cow's outline moves more: the truth is inside out at its horns and ears, which are thinner than the greater depth.
"""


@pytest.mark.parametrize(
    ("name", "depth"),
    [*((name, 0.04) for name in MESHES), *(pytest.param(n, 0.01, marks=pytest.mark.thorough) for n in MESHES)],
)
def test_outlines_are_the_displaced_meshs(name, depth):
    """Two pixels or more from the true outline no pixel is wrong, except a few where three creases meet."""
    pytest.importorskip("open3d")
    make, least = MESHES[name]
    found = measure(make(), depth, 160)
    assert found.iou >= least
    assert 1 - found.iou <= 0.5 * (1 - found.bare_iou)
    assert found.holes <= 8
    assert found.spurs <= 8


@pytest.mark.thorough
@pytest.mark.parametrize("depth", [0.01, 0.04])
@pytest.mark.parametrize("name", SCANNED)
def test_no_outline_of_a_scanned_mesh_is_worse_than_the_bare_meshs(name, depth):
    """At most 8 pixels are wrong two pixels or more from the true outline, except where the truth is inside out.

    Pixels are wrong if they are empty inside the outline, or drawn outside of it.
    """
    shared("meshes")
    mesh = SCANS[name]()
    assert isinstance(mesh, ibr.Mesh)
    found = measure(mesh, depth)
    assert found.iou > found.bare_iou
    assert found.holes - found.inside_out <= 8
    assert found.spurs <= 8
    low, high = SCANNED[name]
    assert low <= found.carved <= high


def beside(mesh: ibr.Mesh) -> np.ndarray:
    return sides_beside(mesh.vertices.astype(np.float64), mesh.faces)


def test_neighbours_of_a_globe():
    """Neighbours are found across the seam of uv, and at the poles, where every other triangle has no area."""
    globe_ = grid(globe, 8, 4)
    found = beside(globe_)
    solid = np.setdiff1d(np.arange(len(globe_.faces)), np.flatnonzero((found < 0).all(axis=1)))
    assert len(solid) == 2 * 8 * 4 - 2 * 8
    assert (found[solid] >= 0).all()
    sides = found[solid].ravel()
    np.testing.assert_array_equal(found.ravel()[sides].reshape(-1, 3), 3 * solid[:, None] + np.arange(3))


def test_neighbours_end_at_borders():
    assert (beside(grid(cylinder, 8, 1)) < 0).sum() == 16
    assert (beside(facets(box(), with_normals=True)) >= 0).all()


def test_sides_of_a_box_sink_as_one():
    """Each side of a box sinks by 1, and they still meet at edges; a sheet folded by 150 degrees sinks less."""
    solid = facets(box((2, 2, 2)), with_normals=True)
    np.testing.assert_allclose(mitred(solid.vertices, solid.normals, solid.faces), solid.vertices, atol=1e-12)
    turn = np.radians(150)
    normals = np.array([[0, 0, 1], [0, np.sin(turn), np.cos(turn)]])
    fold = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 0], [1, 0, 0], [0, 0, 1.0]])
    made = mitred(fold, normals.repeat(3, axis=0), np.arange(6, dtype=np.int32).reshape(2, 3))
    middle = normals.mean(axis=0) * 2 / np.linalg.norm(normals.mean(axis=0))
    np.testing.assert_allclose(made[[0, 1, 3, 4]], middle * np.ones((4, 1)))


def test_the_level_does_not_depend_on_which_corner_is_first():
    """The number of texels in a pixel is the triangle's own, however long it is."""
    height = np.random.default_rng(0).random((256, 256), np.float32)
    color = np.repeat((255 * height).astype(np.uint8)[..., None], 3, axis=2)
    corners, uv = [[0, 0, 0], [1, 0, 0.3], [1, 6, 0], [0, 6, 0.3]], [[0, 0], [1, 0], [1, 1], [0, 1]]
    camera = ibr.Camera.look_at((-2, 3, 4), (0.5, 3, 0), (0, 0, 1), (161, 75), fov_y=40)
    first, *others = (
        ibr.render(ibr.ReliefSurface(ibr.Mesh(corners, faces, uv=uv), height, color, 0.05), camera)
        for faces in ([[0, 1, 2], [0, 2, 3]], [[1, 2, 0], [2, 3, 0]], [[2, 0, 1], [3, 0, 2]])
    )
    assert first.valid.mean() > 0.15
    for frame in others:
        assert (frame.valid != first.valid).sum() <= 3 and np.nanmax(np.abs(frame.depth - first.depth)) < 1e-3
