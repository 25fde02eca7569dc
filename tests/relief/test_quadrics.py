"""Tangent frames of vertices, and quadrics fitted to their neighbours."""

from __future__ import annotations

import numpy as np
import pytest

import pyibr as ibr
from pyibr.core.camera import Camera
from pyibr.relief.quadrics import fitted_quadrics, vertex_frames
from tests.relief.solids import cylinder, grid, plane, sphere, torus


def patch(a: float, b: float, size: float = 0.1) -> ibr.Mesh:
    """3 x 3 vertices on z = a x^2 + b y^2, with u = x and v = y; vertex 4 is at the origin."""
    y, x = (k.ravel() * size for k in np.mgrid[-1:2, -1:2].astype(float))
    z = a * x * x + b * y * y
    i = np.array([0, 1, 3, 4])
    faces = np.concatenate([np.stack([i, i + 1, i + 4], 1), np.stack([i, i + 4, i + 3], 1)])
    gradient = np.stack([-2 * a * x, -2 * b * y, np.ones(9)], axis=1)
    return ibr.Mesh(np.stack([x, y, z], 1), faces, uv=np.stack([x, y], 1), normals=gradient)


@pytest.mark.parametrize(("a", "b"), [(1.5, 0.7), (-2, -2), (1, -1), (0.8, 0), (0, -3), (0, 0)])
@pytest.mark.parametrize("size", [1e-4, 0.1, 1e3])
def test_a_quadric_is_fitted_exactly(a, b, size):
    """The surfaces are paraboloids, a hyperbolic paraboloid, parabolic cylinders and a plane, at three scales."""
    mesh = patch(a / size, b / size, size)
    found = vertex_frames(mesh, (1, 1))
    # float32 rounds the vertices by 1e-7 of the patch's size.
    np.testing.assert_allclose(found.quadrics[4] * size, [a, b, 0], atol=1e-5)
    assert not found.planar[4]


def test_it_does_not_depend_on_where_the_patch_lies():
    mesh = patch(1.5, -0.7)
    rotation = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    rotation *= np.sign(np.linalg.det(rotation))
    moved = ibr.Mesh(mesh.vertices @ rotation.T + (1, 2, 3), mesh.faces, uv=mesh.uv, normals=mesh.normals @ rotation.T)
    found = vertex_frames(moved, (1, 1))
    np.testing.assert_allclose(found.quadrics[4], [1.5, -0.7, 0], atol=2e-4)  # float32 rounds positions of about 4
    np.testing.assert_allclose(found.gradients[4], rotation.T[:2], atol=1e-5)


@pytest.mark.parametrize(
    ("surface", "expected"),
    [
        (sphere, (-0.5, -0.5, 0)),
        (cylinder, (-0.5, 0, 0)),  # -1 / (2 R) around the axis, 0 along it
        (torus, None),
    ],
)
def test_curvatures_of_solids(surface, expected):
    mesh = grid(surface, 64, 32)
    found = vertex_frames(mesh, (1, 1))
    inner = (mesh.uv[:, 1] > 0.1) & (mesh.uv[:, 1] < 0.9)
    if expected is None:  # across the tube -1 / (2 r); around the axis -cos(b) / (2 (R + r cos(b)))
        b = 2 * np.pi * mesh.uv[:, 1]
        expected = np.stack([-0.5 * np.cos(b) / (1 + 0.4 * np.cos(b)), np.full(len(b), -0.5 / 0.4), 0 * b], axis=1)
        assert (found.quadrics[inner][:, 0] > 0.1).any()  # the saddle
    # A fit to neighbours at distance d is off by d^2 / R^2 of the curvature. c is off by that of the greater curvature.
    expected = np.broadcast_to(expected, (len(inner), 3))[inner]
    found_there = found.quadrics[inner]
    np.testing.assert_allclose(found_there[:, :2], expected[:, :2], rtol=0.06, atol=0.03)
    np.testing.assert_allclose(found_there[:, 2], 0, atol=0.06 * np.abs(expected).max() + 0.03)


def test_seams_of_uv_do_not_show():
    """A cylinder's first and last column of vertices have the same positions and different uv."""
    mesh = grid(cylinder, 32, 4)
    found = vertex_frames(mesh, (1, 1))
    rows = np.arange(5) * 33
    np.testing.assert_allclose(found.quadrics[rows], found.quadrics[rows + 32], atol=1e-6)


def test_gradients_tell_the_size_of_tiles():
    mesh = grid(cylinder, 64, 8)
    found = vertex_frames(mesh, (12, 5))
    size = 1 / np.linalg.norm(found.gradients, axis=2)
    np.testing.assert_allclose(size[:, 0], 2 * np.pi / 12, rtol=2e-3)  # polygons are shorter than circles
    np.testing.assert_allclose(size[:, 1], 2.4 / 5, rtol=1e-5)
    np.testing.assert_allclose(np.einsum("nkc,nc->nk", found.gradients, found.normals), 0, atol=1e-7)  # float32


def test_mirrored_uv_runs_the_other_way():
    mesh = patch(1, 2)
    mirrored = ibr.Mesh(mesh.vertices, mesh.faces, uv=mesh.uv * (-1, 1), normals=mesh.normals)
    a, b = vertex_frames(mesh, (1, 1)), vertex_frames(mirrored, (1, 1))
    np.testing.assert_allclose(b.gradients[4, 0], -a.gradients[4, 0])
    np.testing.assert_allclose(b.quadrics[4], a.quadrics[4], atol=1e-9)


@pytest.mark.parametrize(
    "points",
    [
        [[0, 0, 0], [1, 0, 0], [2, 0, 0]],  # no area
        [[0, 0, 0], [0, 0, 0], [0, 0, 0]],  # one point
        [[0, 0, 0], [1, 1, 0.5], [2, 2, 0.5]],  # all on one line
    ],
)
def test_neighbours_that_determine_nothing(points):
    quadrics, planar = fitted_quadrics(
        np.array(points, float),
        np.array([[0, 1, 2]], np.int32),
        np.tile([0.0, 0, 1], (3, 1)),
        np.tile([1.0, 0, 0], (3, 1)),
    )
    assert planar[0]
    np.testing.assert_array_equal(quadrics[0], 0)
    assert np.isfinite(quadrics).all()


def test_vertices_without_triangles_are_planar():
    mesh = ibr.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0.2], [5, 5, 5]], [[0, 1, 2]], uv=[[0, 0], [1, 0], [0, 1], [0, 0]])
    found = vertex_frames(mesh, (1, 1))
    assert found.planar[3]
    np.testing.assert_array_equal(found.gradients[3], 0)


@pytest.mark.parametrize(
    ("surface", "curvatures"), [(sphere, (-0.5, -0.5, 0)), (cylinder, (-0.5, 0, 0)), (plane, (0, 0, 0))]
)
def test_boundary_vertices(surface, curvatures):
    """Quadrics of vertices at borders are right, too, although their neighbours are on one side."""
    mesh = grid(surface, 96, 48)
    found = vertex_frames(mesh, (1, 1))
    border = (mesh.uv[:, 1] == 0) | (mesh.uv[:, 1] == 1)
    assert not found.planar.any()
    # Two corners of the sphere have just two neighbours, at an angle of 88.2 degrees. There c is off by
    # 2 * 0.5 * cos(88.2 degrees).
    np.testing.assert_allclose(found.quadrics[border], np.broadcast_to(curvatures, (border.sum(), 3)), atol=0.0315)


def test_a_fan_of_few_neighbours_is_stable():
    """In a single triangle, each vertex has two neighbours, from which a quadric is fitted."""
    mesh = ibr.Mesh(
        [[0, 0, 0], [1, 0, 0.1], [0, 1, -0.2]], [[0, 1, 2]], uv=[[0, 0], [1, 0], [0, 1]], normals=[[0, 0, 1]] * 3
    )
    found = vertex_frames(mesh, (1, 1))
    np.testing.assert_allclose(found.quadrics[0], [0.1, -0.2, 0], atol=1e-6)
    assert np.isfinite(found.quadrics).all()
    assert np.abs(found.quadrics).max() < 1


@pytest.mark.parametrize("turn", [15, 45, 80])
def test_axes_that_do_not_follow_uv(turn):
    """If u and v are turned against a saddle's axes, its quadric has the coefficients of the turned axes."""
    mesh, (cosine, sine) = patch(1.5, -0.7), (np.cos(np.radians(turn)), np.sin(np.radians(turn)))
    turned = ibr.Mesh(
        mesh.vertices, mesh.faces, uv=mesh.uv @ np.array([[cosine, -sine], [sine, cosine]]), normals=mesh.normals
    )
    a = 1.5 * cosine**2 - 0.7 * sine**2
    expected = [a, 1.5 - 0.7 - a, -2 * (1.5 + 0.7) * cosine * sine]
    np.testing.assert_allclose(vertex_frames(turned, (1, 1)).quadrics[4], expected, atol=2e-5)


@pytest.mark.parametrize("cells", [(64, 8), (128, 1), (24, 1), (300, 2)], ids=str)
def test_curvatures_of_a_tube_do_not_depend_on_uv(cells):
    """They do not depend on the length of the tube's triangles, either, not even at its ends."""
    tube = grid(cylinder, *cells)
    for turn in np.radians([0, 10, 22.5, 45, 60, 90, 135]):
        way = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        uv = (np.asarray(tube.uv, float) * (2 * np.pi, 2.4)) @ way
        found = vertex_frames(ibr.Mesh(tube.vertices, tube.faces, uv=uv, normals=tube.normals), (1, 1))
        assert not found.planar.any()
        a, b, c = found.quadrics.T
        most = np.linalg.eigvalsh(np.stack([a, c / 2, c / 2, b], axis=1).reshape(-1, 2, 2))
        # The fit is not exact, and float32's rounding is divided by the neighbours' distance squared; the smallest
        # distance is 1 / 120 of the height.
        np.testing.assert_allclose(most, np.broadcast_to((-0.5, 0), most.shape), atol=0.012)


@pytest.mark.parametrize("distance", ["approximate", "exact"])
@pytest.mark.parametrize("cells", [(64, 8), (128, 1)], ids=str)
def test_a_tubes_outline_does_not_depend_on_how_its_uv_is_turned(cells, distance):
    """A tube 0.3 deep, with uv turned nine ways: outlines agree within a pixel; with exact distances they are right."""
    tube = grid(cylinder, *cells)
    camera = Camera.look_at((8, 0, 0), (0, 0, 0), (0, 0, 1), (121, 161), projection="orthographic", height=161 / 43.9)
    widths = []
    for turn in np.radians([0, 10, 22.5, 30, 45, 60, 77, 90, 135]):
        way = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        uv = (np.asarray(tube.uv, float) * (2 * np.pi, 2.4)) @ way
        base = ibr.Mesh(tube.vertices, tube.faces, uv=uv, normals=tube.normals)
        color = np.full((1, 1, 3), 200, np.uint8)
        relief = ibr.ReliefSurface(base, np.zeros((4, 4), np.float32), color, 0.3, distance=distance)
        widths.append(ibr.render(relief, camera).valid[60:100].sum(axis=1).mean())
    assert np.ptp(widths) <= 1, widths
    if distance == "exact":
        assert np.abs(np.array(widths) - 2 * 0.7 * 43.9).max() <= 1, widths
