"""Normals of meshes that bring none, at hard edges and where surfaces are smooth."""

from __future__ import annotations

import numpy as np
import pytest

import pyibr as ibr
from pyibr.meshes import normals as module
from pyibr.meshes.normals import summed_at_places
from tests.boxes import box, facets


def test_sides_with_corners_of_their_own_keep_their_normals():
    mesh = facets(box())
    across = np.cross(*(mesh.vertices[mesh.faces[:, k]] - mesh.vertices[mesh.faces[:, 0]] for k in (1, 2)))
    expected = across / np.linalg.norm(across, axis=1, keepdims=True)
    np.testing.assert_allclose(mesh.smooth_normals[mesh.faces], expected[:, None].repeat(3, 1), atol=1e-6)


def test_shared_corners_are_smooth():
    three_edges = box().smooth_normals[1:4]  # between two sides each
    assert ((np.abs(three_edges[:, :2]) > 0.3) & (np.abs(three_edges[:, :2]) < 0.95)).all()
    np.testing.assert_allclose(three_edges[:, 2], 0, atol=1e-6)


@pytest.mark.parametrize(("angle", "is_smooth"), [(0, True), (59, True), (61, False), (180, False)])
def test_the_angle_that_makes_an_edge(angle, is_smooth):
    """Two triangles that meet along x with corners of their own, the second one turned by an angle."""
    turn = np.radians(angle)
    corners = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0], [0, 0, 0], [1, -np.cos(turn), -np.sin(turn)]]
    found = ibr.Mesh(corners, [[0, 1, 2], [3, 4, 5]]).smooth_normals
    ways = np.array([[0, 0, 1], [0, -np.sin(turn), np.cos(turn)]])
    mean = np.linalg.norm(ways.sum(0)) and ways.sum(0) / np.linalg.norm(ways.sum(0))
    np.testing.assert_allclose(found[0], mean if is_smooth else ways[0], atol=1e-6)
    np.testing.assert_allclose(found[3], mean if is_smooth else ways[1], atol=1e-6)
    np.testing.assert_allclose(found[2], ways[0], atol=1e-6)  # nobody else's place


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
