"""Reliefs on meshes whose uv is mirrored, everywhere or in part."""

from __future__ import annotations

import numpy as np
import pytest

import pyibr as ibr
from pyibr.core.camera import Camera
from pyibr.relief.quadrics import split_at_mirrors
from tests.displaced import square
from tests.relief.solids import cylinder, grid
from tests.relief.test_truth import tiled_noise

CAMERA = Camera.look_at((0.8, -0.5, 0.7), (0.5, 0.5, 0), (0, 0, 1), (161, 117), fov_y=45)
LIGHT = ibr.Light(direction=(0.5, 0.7, -0.6))


def slanted() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Height, colour and normals without any symmetry, not square; normals are for a depth of 0.1 on a unit square."""
    y, x = np.mgrid[:24, :32]
    a, b = 2 * np.pi * (x + 0.5) / 32, 2 * np.pi * (y + 0.5) / 24
    height = 0.5 + 0.3 * np.sin(a) * np.cos(2 * b) + 0.2 * np.cos(a + b)
    by_u = 2 * np.pi * (0.3 * np.cos(a) * np.cos(2 * b) - 0.2 * np.sin(a + b))
    by_v = 2 * np.pi * (-0.6 * np.sin(a) * np.sin(2 * b) - 0.2 * np.sin(a + b))
    normals = np.stack([-0.1 * by_u, -0.1 * by_v, np.ones_like(by_u)], axis=-1)
    color = np.stack([255 * height, 4 * x + 0.0 * y, 5 * y + 0.0 * x], axis=-1).astype(np.uint8)
    return height.astype(np.float32), color, (normals / np.linalg.norm(normals, axis=-1, keepdims=True)).astype("f4")


TURNS = {  # functions that turn uv, a map to match it, and the map's normals
    "u": (lambda uv: (1, 0) + uv * (-1, 1), lambda map_: map_[:, ::-1], lambda n: n * np.float32([-1, 1, 1])),
    "v": (lambda uv: (0, 1) + uv * (1, -1), lambda map_: map_[::-1], lambda n: n * np.float32([1, -1, 1])),
    "u and v": (lambda uv: 1 - uv, lambda map_: map_[::-1, ::-1], lambda n: n * np.float32([-1, -1, 1])),
    "swapped": (lambda uv: uv[:, ::-1], lambda map_: np.swapaxes(map_, 0, 1), lambda n: n[..., [1, 0, 2]]),
}


@pytest.mark.thorough
@pytest.mark.parametrize("mapped", [False, True])
@pytest.mark.parametrize("distance_", ["approximate", "exact"])
@pytest.mark.parametrize("turn", TURNS)
def test_a_map_turned_with_its_uv_is_the_same_picture(turn, distance_, mapped):
    turned_uv, turned, turned_normals = TURNS[turn]
    base, (height, color, normals) = square(), slanted()
    other = ibr.Mesh(base.vertices, base.faces, uv=turned_uv(np.array(base.uv)))
    maps = [np.ascontiguousarray(turned(map_)) for map_ in (height, color)]
    normal_map = np.ascontiguousarray(turned_normals(turned(normals)))
    a = ibr.ReliefSurface(base, height, color, 0.1, normal_map=normals if mapped else None, distance=distance_)
    b = ibr.ReliefSurface(other, *maps, 0.1, normal_map=normal_map if mapped else None, distance=distance_)
    one, two = (ibr.render(thing, CAMERA, LIGHT) for thing in (a, b))
    np.testing.assert_array_equal(one.valid, two.valid)
    # Rounding decides for rays that graze a cell's edge, and at edges of shadows.
    assert np.isclose(one.depth, two.depth, rtol=1e-4)[one.valid].mean() >= 0.999
    assert (np.abs(one.color.astype(int) - two.color)[one.valid].max(axis=1) <= 2).mean() >= 0.995


@pytest.mark.thorough
def test_a_map_of_the_heights_own_normals_lights_as_its_slopes_do():
    height, color, normals = slanted()
    slopes, mapped = (ibr.ReliefSurface(square(), height, color, 0.1, normal_map=n) for n in (None, normals))
    a, b = (ibr.render(thing, CAMERA, LIGHT).color.astype(int) for thing in (slopes, mapped))
    off = np.abs(a - b).max(axis=2)
    assert np.mean(off <= 12) >= 0.98  # slopes are differences over two texels


def folded(columns: int, rows: int) -> ibr.Mesh:
    """A cylinder whose u grows from 0 to 1 and falls back to 0: both halves share the vertices where u is 1."""
    mesh = grid(cylinder, columns, rows)
    u, v = np.asarray(mesh.uv, float).T
    return ibr.Mesh(mesh.vertices, mesh.faces, uv=np.stack([2 * np.minimum(u, 1 - u), v], axis=1), normals=mesh.normals)


@pytest.mark.parametrize("distance_", ["approximate", "exact"])
def test_where_mirrored_uv_meet_the_relief_goes_on(distance_):
    """A map that is its own mirror image gives the same picture as on a cylinder whose u only grows."""
    noise = tiled_noise(3, 4)
    height, white = 0.5 * (noise + noise[:, ::-1]), np.full((2, 2, 3), 200, np.uint8)
    camera = Camera.look_at((-1.9, -2.4, 0.3), (-1, -0.1, 0), (0, 0, 1), (400, 300), fov_y=30)
    frame, plain = (
        ibr.render(ibr.ReliefSurface(base, height, white, 0.1, tiles=tiles, distance=distance_), camera)
        for base, tiles in ((folded(32, 8), (6, 5)), (grid(cylinder, 32, 8), (12, 5)))
    )
    assert (frame.valid != plain.valid).mean() <= 1e-3
    both = frame.valid & plain.valid
    assert both.sum() > 30000
    assert np.isclose(frame.depth, plain.depth, rtol=1e-4)[both].mean() >= 0.99


def test_only_vertices_between_mirrored_triangles_are_doubled():
    mesh = folded(16, 2)
    split = split_at_mirrors(mesh)
    # The middle vertex of each of three rows is doubled; at the seam, vertices are separate already.
    assert len(split.vertices) == len(mesh.vertices) + 3
    np.testing.assert_array_equal(split.vertices[: len(mesh.vertices)], mesh.vertices)
    np.testing.assert_array_equal(split.vertices[split.faces], mesh.vertices[mesh.faces])
    np.testing.assert_array_equal(split.uv[split.faces], mesh.uv[mesh.faces])
    for whole in (square(), grid(cylinder, 8, 2), ibr.Mesh(square().vertices, square().faces, uv=np.zeros((4, 2)))):
        assert split_at_mirrors(whole) is whole
