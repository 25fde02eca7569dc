"""Displaced surfaces have no gaps at hard edges and uv seams, compared with a displaced mesh that has none."""

from __future__ import annotations

import numpy as np
import pytest

import pyibr as ibr
from pyibr.core.camera import Camera
from tests.embree import embree
from tests.shadowed import first_hits

WHITE = np.full((1, 1, 3), 200, np.uint8)
LEAST = 0.3  # least height in the map `rough`
EYES = [(1, 0.7, 0.5), (-0.6, 0.3, -1), (0.2, 0.9, 0.9), (-1, -0.5, 0.3)]


def rough(seed: int = 0) -> np.ndarray:
    """Random heights from LEAST to 1; opposite borders differ, so that uv seams become cliffs."""
    height = LEAST + (1 - LEAST) * np.random.default_rng(seed).random((16, 16))
    return np.rint(255 * height).astype(np.uint8)


def cube(n: int) -> ibr.Mesh:
    """Six sides of n x n squares, each with its own normals and uv from 0 to 1."""
    ticks = np.arange(n + 1) / n
    u, v = (values.ravel() for values in np.meshgrid(ticks, ticks))
    i = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    quads = np.concatenate([np.stack([i, i + 1, i + n + 2], 1), np.stack([i, i + n + 2, i + n + 1], 1)])
    points, faces, normals = [], [], []
    for axis in range(3):
        for side in (-1.0, 1.0):
            normal, a, b = side * np.eye(3)[axis], np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3]
            across, down = (a, b) if side > 0 else (b, a)
            faces.append(quads + len(u) * len(faces))
            points.append(0.5 * normal + np.outer(u - 0.5, across) + np.outer(v - 0.5, down))
            normals.append(np.tile(normal, (len(u), 1)))
    uv = np.tile(np.stack([u, v], axis=1), (6, 1))
    return ibr.Mesh(np.concatenate(points), np.concatenate(faces), uv=uv, normals=np.concatenate(normals))


def displaced(mesh: ibr.Mesh, by: float) -> ibr.Mesh:
    """Displace a mesh; at each position, along the mean of the normals of all vertices there."""
    place = np.unique(mesh.vertices, axis=0, return_inverse=True)[1].ravel()
    normals = mesh.smooth_normals if mesh.normals is None else mesh.normals
    sums = np.zeros((place.max() + 1, 3))
    for number, *normal in {(int(number), *normal.tolist()) for number, normal in zip(place, normals, strict=True)}:
        sums[number] += normal
    sums /= np.linalg.norm(sums, axis=1, keepdims=True)
    return ibr.Mesh(mesh.vertices + by * sums[place], mesh.faces, sides="front")


def around(mesh: ibr.Mesh, eye: tuple[float, float, float], size: int = 200) -> Camera:
    low, high = mesh.bounds
    away = 1.4 * np.linalg.norm(high - low) * np.array(eye) / np.linalg.norm(eye)
    return Camera.look_at((low + high) / 2 + away, (low + high) / 2, (0, 1, 0.1), (size, size), fov_y=46)


def covered(mesh: ibr.Mesh, camera: Camera) -> np.ndarray:
    return np.isfinite(first_hits(embree(mesh), camera)[0])


@pytest.mark.parametrize("n", [1, 8])
@pytest.mark.parametrize("slicing", ["orthogonal", "screen"])
def test_slices_on_a_cube_are_closed_at_its_edges(slicing, n):
    """If slices were displaced only along the normals of their own side, wedges between the sides would stay empty."""
    mesh, scale = cube(n), 0.15
    level = np.full((2, 2), 0.8, np.float32)
    for eye in EYES:
        camera = around(mesh, eye)
        frame = ibr.render(ibr.SlicedSurface(mesh, rough(), WHITE, scale, slicing=slicing), camera)
        assert not (covered(displaced(mesh, LEAST * scale), camera) & ~frame.valid).any()
        # With a constant height h, the truth is a mesh. On the diagonal of a prism's wall, the slices' height is off
        # by h (1 - h) |a - b| scale; a and b are the normals at the wall's ends, and |a - b| is at most 1.16. Oblique
        # rays enlarge the error.
        frame = ibr.render(ibr.SlicedSurface(mesh, level, WHITE, scale, slicing=slicing), camera)
        truth, _, _ = first_hits(embree(displaced(mesh, 0.8 * scale)), camera)
        assert (np.isfinite(truth) != frame.valid).sum() <= 250
        both = np.isfinite(truth) & frame.valid
        assert (np.abs(frame.depth - truth)[both] <= (0.16 * 1.16 + 4 / 64) * scale).mean() >= 0.99


def test_slices_on_a_cube_are_lit_by_its_own_normals():
    mesh, camera = cube(4), around(cube(4), EYES[0])
    light = ibr.Light(direction=(-1, -0.6, -0.3), shadow_size=0)
    color = np.full((1, 1, 3), 204, np.uint8)
    thin = ibr.SlicedSurface(mesh, np.ones((2, 2), np.float32), color, 1e-3, slices=4, test="at_least")
    shades = [ibr.render(made, camera, light) for made in (thin, mesh)]
    both = shades[0].valid & shades[1].valid
    off = np.abs(shades[0].color.astype(int) - shades[1].color)[both].max(axis=1)
    assert (off <= 1).mean() >= 0.99  # the surface lies 0.001 farther out, so pixels at edges see the next side


def test_sheets_back_to_back_are_displaced_apart():
    """The mean of two opposite normals is zero, so each sheet is displaced along its own normal."""
    corners, uv = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 0], [1, 0], [1, 1], [0, 1]]
    faces = [[0, 1, 2], [0, 2, 3], [4, 6, 5], [4, 7, 6]]
    mesh = ibr.Mesh(corners * 2, faces, uv=uv * 2, normals=[[0, 0, 1]] * 4 + [[0, 0, -1]] * 4)
    made = ibr.SlicedSurface(mesh, np.ones((2, 2), np.float32), WHITE, 0.2, test="at_least", slicing="surface")
    for side in (1, -1):
        camera = Camera.look_at((0.5, 0.5, 2 * side), (0.5, 0.5, 0), (0, 1, 0), (9, 9), fov_y=10)
        np.testing.assert_allclose(ibr.render(made, camera).depth, 1.8, atol=0.2 / 64 + 1e-4)  # within a slice


@pytest.mark.parametrize("distance", ["approximate", "exact"])
@pytest.mark.parametrize("n", [1, 8])
def test_reliefs_on_a_cube_cover_all_that_rays_cannot_pass(n, distance):
    """No quadric is fitted across the cube's edges, because its surface would be round there."""
    mesh, scale = cube(n), 0.15
    relief = ibr.ReliefSurface(mesh, rough(), WHITE, scale, distance=distance)
    assert not relief.frames.quadrics.any()
    for eye in EYES:
        camera = around(mesh, eye)
        assert not (covered(displaced(mesh, -scale), camera) & ~ibr.render(relief, camera).valid).any()
