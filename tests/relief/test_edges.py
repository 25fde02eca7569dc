"""Reliefs on boxes whose meshes have no normals: their sides are flat, and no side shades another side."""

from __future__ import annotations

import numpy as np
import pytest

import pyibr as ibr
from pyibr.relief.quadrics import juts_out, split_at_edges
from tests.boxes import box, facets
from tests.displaced import square
from tests.relief.solids import cylinder, grid
from tests.relief.test_truth import bricks

WHITE = np.full((2, 2, 3), 255, np.uint8)
OUTSIDE = ibr.Camera.look_at((3, -2.4, 2.1), (0, 0, 0), (0, 0, 1), (160, 120), fov_y=45)


@pytest.mark.parametrize("light", [None, ibr.Light(direction=(-0.6, 0.5, -0.7), ambient=0.2)])
@pytest.mark.parametrize("make", [box, lambda: facets(box())], ids=["shared corners", "corners of their own"])
def test_a_box_without_normals_is_one_with_its_sides_normals(make, light):
    """Normals shared across the box's edges would give it round sides, like a bubble, and holes."""
    frames = [
        ibr.render(ibr.ReliefSurface(base, bricks(), WHITE, 0.1), OUTSIDE, light)
        for base in (make(), facets(box(), with_normals=True))
    ]
    assert frames[0].valid.sum() > 4000
    np.testing.assert_array_equal(*(frame.valid for frame in frames))
    np.testing.assert_array_equal(*(frame.color for frame in frames))
    np.testing.assert_array_equal(*(frame.depth for frame in frames))


@pytest.mark.parametrize("light", [{"direction": (-0.3, 0.6, -1)}, {"position": (3, -1, 4)}], ids=["far", "near"])
@pytest.mark.parametrize("silhouette", ["quadric", "none"])
@pytest.mark.parametrize("scale", [0.05, 0.2])
@pytest.mark.parametrize("normals", [False, True])
def test_no_side_of_a_box_shades_another(normals, scale, silhouette, light):
    """A relief of constant height carved into a box is a smaller box, on which no shadow falls.

    In the shadow map, light enters at one side and passes below the edge of another side. With the map alone, up to
    15 % of the box would be dark.
    """
    base = facets(box(), with_normals=True) if normals else box()
    relief = ibr.ReliefSurface(base, np.zeros((4, 4), np.float32), WHITE, scale, silhouette=silhouette)
    lit, plain = (
        ibr.render(relief, OUTSIDE, ibr.Light(**light, ambient=0.2, shadow_size=size)).color.astype(int)
        for size in (1024, 0)
    )
    own = ibr.render(relief, OUTSIDE).color.astype(int)
    told = (plain - 0.2 * own > 8).any(axis=2)
    assert told.sum() > 2000
    assert ((lit < plain).any(axis=2) & told).sum() == 0


def test_edges_that_jut_out():
    """A box has edges that jut out, with or without normals; a room seen from inside and smooth surfaces have none."""
    flat = np.zeros((4, 4), np.float32)
    bases = box(), facets(box(), with_normals=True), box(inside=True), grid(cylinder, 8, 2), square()
    reliefs = [ibr.ReliefSurface(base, flat, WHITE, 0.1) for base in bases]
    assert [juts_out(relief.drawn, relief.frames.normals) for relief in reliefs] == [True, True, False, False, False]
    assert [relief.is_flat for relief in reliefs] == [False, False, True, False, True]


@pytest.mark.parametrize("eye", [(0, 0, 0), (0.5, -0.4, 0.3)])
def test_no_wall_of_a_room_shades_another(eye):
    """A relief of constant height carved into a room is a larger room, which a lamp inside lights completely."""
    room = ibr.ReliefSurface(box(inside=True), np.full((4, 4), 0.5, np.float32), WHITE, 0.04)
    camera = ibr.Camera.look_at((-0.7, -0.5, -0.2), (1, 0.5, 0), (0, 0, 1), (160, 120), fov_y=80)
    lamp = ibr.Light(position=eye, ambient=0.2)
    plain = ibr.Light(position=eye, ambient=0.2, shadow_size=0)
    dark = (ibr.render(room, camera, lamp).color < ibr.render(room, camera, plain).color).any(axis=2)
    # A shadow map has texels, so that two rows of pixels along each edge may be dark: at most 5 edges of 160 pixels.
    assert dark.sum() <= 2 * 5 * 160
    assert dark.mean() <= 0.02


def test_only_vertices_at_edges_are_doubled():
    mesh = box()
    split = split_at_edges(mesh)
    # Three sides meet at each corner. The two ends, and the sides at the seam, have separate vertices already.
    assert len(split.vertices) == len(mesh.vertices) + 6
    np.testing.assert_array_equal(split.vertices[: len(mesh.vertices)], mesh.vertices)
    np.testing.assert_array_equal(split.vertices[split.faces], mesh.vertices[mesh.faces])
    np.testing.assert_array_equal(split.uv[split.faces], mesh.uv[mesh.faces])
    smooth = grid(cylinder, 8, 2)
    bare = ibr.Mesh(smooth.vertices, smooth.faces, uv=smooth.uv)
    for whole in (square(), smooth, bare, facets(box(), with_normals=True)):
        assert split_at_edges(whole) is whole
