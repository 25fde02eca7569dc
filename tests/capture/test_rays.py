"""Captured depth images compared with Open3D's ray casting (Embree): which pixels have depth, and which depth."""

from __future__ import annotations

import numpy as np
import pytest

import pyibr as ibr
from pyibr.capture import MeshScene, capture, object_views
from tests import scenes
from tests.capture.torus import torus
from tests.data import shared
from tests.embree import embree, rays_of


def mesh_of(name: str) -> ibr.Mesh:
    return torus() if name == "torus" else ibr.Mesh.load(shared(f"meshes/{name}"))


def cast(mesh: ibr.Mesh, camera: ibr.Camera) -> np.ndarray:
    """(H, W) depth, in float64 from its plane, of the first triangle that each pixel's ray hits; inf without a hit."""
    origin, direction = np.split(rays_of(camera), 2, axis=1)
    seen = np.isfinite(direction).all(axis=1)
    found = embree(mesh).cast_rays(np.concatenate([origin, direction], axis=1, dtype=np.float32)[seen])
    face = found["primitive_ids"].numpy().astype(np.int64)
    hit = np.flatnonzero(np.isfinite(found["t_hit"].numpy()))
    rays = np.flatnonzero(seen)[hit]
    corner = mesh.vertices[mesh.faces[face[hit]]].astype(np.float64)
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    depth = np.full(len(origin), np.inf)
    depth[rays] = np.sum((corner[:, 0] - origin[rays]) * normal, 1) / np.sum(direction[rays] * normal, 1)
    return depth.reshape(camera.height, camera.width)


def differing(view: ibr.DepthImage, expected: np.ndarray) -> tuple[int, int]:
    """Count pixels whose depth is in one picture only or differs by over 1e-5 of itself; and count covered pixels."""
    there = np.isfinite(expected)
    both = there & view.valid
    off = np.abs(view.depth[both] / expected[both] - 1) > 1e-5
    return np.count_nonzero(there != view.valid) + np.count_nonzero(off), np.count_nonzero(there)


@pytest.mark.parametrize("projection", ["orthographic", "perspective"])
@pytest.mark.parametrize("name", ["torus", "bun_zipper.ply.gz", "dragon_vrip_res3.ply.gz"])
def test_object_views_are_those_of_a_ray_caster(name, projection):
    mesh = mesh_of(name)
    counts = [differing(view, cast(mesh, view.camera)) for view in object_views(mesh, 199, projection=projection)]
    off, covered = np.sum(counts, axis=0)
    assert covered > 30_000
    assert off <= 15e-5 * covered


LENSES = {
    "barrel": ibr.Lens("brown_conrady", [-0.25, 0.05, 0.002, -0.001]),
    "pincushion": ibr.Lens("brown_conrady", [0.15, 0.02, 0, 0]),
    "fisheye": ibr.Lens("kannala_brandt", [0.01, 0, 0, 0]),
}


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize("focal", [30, 90])
def test_a_lens_sees_what_a_ray_caster_sees_by_its_rays(lens, focal):
    """The camera is in the hole of a torus, some of whose triangles cross the camera's plane z = 0."""
    camera = ibr.Camera([[focal, 0, 60], [0, focal, 40], [0, 0, 1]], (121, 83), None, lens=LENSES[lens])
    off, covered = differing(capture(torus(), camera), cast(torus(), camera))
    assert covered > 2900
    assert off <= max(15e-5 * covered, 2)


def test_long_triangles_that_cross_the_camera_plane():
    """A floor of slivers that reach from behind the camera to in front of it, and a wall of two triangles."""
    random = np.random.default_rng(4)
    x = np.sort(random.uniform(-40, 40, 201))
    vertices = np.concatenate([np.stack([x, 0 * x + 1.5, 0 * x + z], 1) for z in (-60.0, 70.0)])
    first = np.arange(200)
    floor = (first[:, None] + [0, 1, 201, 1, 202, 201]).reshape(-1, 3)
    wall = np.array([[-50, -50, 30], [50, -50, 35], [-50, 50, 32], [50, 50, 37]], np.float64)
    mesh = ibr.Mesh(np.concatenate([vertices, wall]), np.concatenate([floor, [[402, 403, 404], [405, 404, 403]]]))
    camera = ibr.Camera([[80, 0, 60.3], [0, 80, 41.7], [0, 0, 1]], (121, 83)).orbited(7, (0, 0, 3), axis=(0.3, 1, 0.2))
    off, covered = differing(capture(mesh, camera), cast(mesh, camera))
    assert covered == 121 * 83
    assert off <= 2


def test_far_from_the_origin_depth_is_as_exact_as_the_vertices():
    square = np.array([[-1, -1, 2], [1, -1, 2], [-1, 1, 2], [1, 1, 2]]) + 1e6
    camera = ibr.Camera([[20, 0, 5], [0, 20, 5], [0, 0, 1]], (11, 11), scenes.pose(center=(1e6, 1e6, 1e6)))
    view = MeshScene(square, [[0, 1, 2], [3, 2, 1]]).capture(camera)
    np.testing.assert_allclose(view.depth, 2, rtol=1e-6)


def test_of_equally_far_triangles_the_first_is_seen():
    vertices = [[-1, -1, 3], [1, -1, 3], [-1, 1, 3], [1, 1, 3]] * 2
    colors = np.repeat(np.array([[200, 0, 0], [0, 200, 0]], np.uint8), 4, axis=0)
    camera = ibr.Camera([[20, 0, 5], [0, 20, 5], [0, 0, 1]], (11, 11))
    for layer in ("first", "last"):
        scene = MeshScene(vertices, [[0, 1, 2], [3, 2, 1], [4, 5, 6], [7, 6, 5]], colors=colors)
        assert (scene.capture(camera, layer=layer).color == (200, 0, 0)).all()
