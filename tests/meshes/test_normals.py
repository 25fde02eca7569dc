"""Normals computed for meshes without normals, at hard edges and on smooth surfaces."""

from __future__ import annotations

import numpy as np
import pytest

import pyibr as ibr
from pyibr.capture import models
from pyibr.meshes import normals as module
from pyibr.meshes.normals import place_of, summed_at_places
from tests.boxes import box, facets


def test_sides_with_corners_of_their_own_keep_their_normals():
    mesh = facets(box())
    across = np.cross(*(mesh.vertices[mesh.faces[:, k]] - mesh.vertices[mesh.faces[:, 0]] for k in (1, 2)))
    expected = across / np.linalg.norm(across, axis=1, keepdims=True)
    np.testing.assert_allclose(mesh.smooth_normals[mesh.faces], expected[:, None].repeat(3, 1), atol=1e-6)


def test_shared_corners_are_smooth():
    three_edges = box().smooth_normals[1:4]  # corners between sides
    assert ((np.abs(three_edges[:, :2]) > 0.3) & (np.abs(three_edges[:, :2]) < 0.95)).all()
    np.testing.assert_allclose(three_edges[:, 2], 0, atol=1e-6)


@pytest.mark.parametrize(("angle", "is_smooth"), [(0, True), (59, True), (61, False), (180, False)])
def test_the_angle_that_makes_an_edge(angle, is_smooth):
    """Two triangles with separate corners meet along the x axis, at an angle."""
    turn = np.radians(angle)
    corners = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0], [0, 0, 0], [1, -np.cos(turn), -np.sin(turn)]]
    found = ibr.Mesh(corners, [[0, 1, 2], [3, 4, 5]]).smooth_normals
    ways = np.array([[0, 0, 1], [0, -np.sin(turn), np.cos(turn)]])
    mean = np.linalg.norm(ways.sum(0)) and ways.sum(0) / np.linalg.norm(ways.sum(0))
    np.testing.assert_allclose(found[0], mean if is_smooth else ways[0], atol=1e-6)
    np.testing.assert_allclose(found[3], mean if is_smooth else ways[1], atol=1e-6)
    np.testing.assert_allclose(found[2], ways[0], atol=1e-6)  # a corner of one triangle


def test_pairs_in_pieces_are_the_same(monkeypatch):
    noise = np.random.default_rng(5)
    place = noise.integers(0, 30, 400)
    own = noise.normal(size=(400, 3)) * (noise.random((400, 1)) > 0.1)
    whole = summed_at_places(place, own)
    monkeypatch.setattr(module, "_AT_ONCE", 50)
    pieces = summed_at_places(place, own)
    assert whole[1].sum() > 300
    for a, b in zip(whole, pieces, strict=True):
        np.testing.assert_array_equal(a, b)
    ways = own / np.maximum(np.linalg.norm(own, axis=1, keepdims=True), 1e-300)
    for i in range(400):
        alike = (place == place[i]) & ((ways @ ways[i] > 0.5) | ~own.any(axis=1) | (not own[i].any()))
        np.testing.assert_allclose(whole[0][i], own[alike].sum(axis=0), atol=1e-9)


@pytest.mark.parametrize("vertices", ["scattered", "a grid", "the same", "zeros of both signs"])
def test_places_are_numbered_in_their_order(vertices):
    rng = np.random.default_rng(4)
    some = rng.standard_normal((500, 3)).astype(np.float32)
    given = {
        "scattered": np.concatenate([some, some[::3]]),
        "a grid": rng.integers(-2, 3, (500, 3)).astype(np.float32),
        "the same": np.ones((9, 3), np.float32),
        "zeros of both signs": rng.choice(np.float32([-0.0, 0.0, 1.0]), (90, 3)),
    }[vertices]
    np.testing.assert_array_equal(place_of(given), np.unique(given, axis=0, return_inverse=True)[1].reshape(-1))


def test_triangles_in_pieces_are_the_same(monkeypatch):
    round_mesh = models.donut(20)
    whole = ibr.Mesh(round_mesh.vertices, round_mesh.faces)
    camera = ibr.Camera.look_at((0, 0, 3), (0, 0, 0), (0, 1, 0), (61, 37), fov_y=45)
    light = ibr.Light(direction=(-1, -1, -1))
    frame = ibr.render(whole, camera, light)
    monkeypatch.setattr(module, "_TRIANGLES_AT_ONCE", 7)
    pieces = ibr.Mesh(round_mesh.vertices, round_mesh.faces)
    np.testing.assert_array_equal(pieces.smooth_normals, whole.smooth_normals)
    np.testing.assert_array_equal(ibr.render(pieces, camera, light).color, frame.color)


def test_corners_that_no_triangle_uses_lie_outside_of_the_bounds():
    mesh = ibr.Mesh([[9, 9, 9], [0, 0, 0], [1, 0, 0], [0, 2, 0], [-9, 0, 0]], [[1, 2, 3]])
    np.testing.assert_array_equal(mesh.bounds, [[0, 0, 0], [1, 2, 0]])
