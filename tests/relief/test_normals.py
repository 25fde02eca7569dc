"""Normals of reliefs on a curved base, and the places on the map that rays meet, compared with the carved torus."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import pyibr as ibr
from pyibr.core.camera import Camera
from tests.relief.solids import grid, torus
from tests.relief.test_truth import WHITE

TILES, SCALE = (6, 3), 0.1
CAMERA = Camera.look_at((2, -2.5, 1.7), (0, 0, 0), (0, 0, 1), (160, 120), fov_y=42)
LIGHTS = (-0.3, 0.6, -1), (-1, 0.2, -0.3), (0.2, 1, -0.1)


def even(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return np.full_like(u + v, 0.5)


def rolling(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Smooth heights from 0.1 to 0.9 over a tile."""
    a, b = 2 * np.pi * u, 2 * np.pi * v
    return np.asarray(0.5 + 0.2 * np.sin(a) * np.cos(b) + 0.15 * np.sin(2 * b + a) + 0.05 * np.cos(2 * a))


def carved(height: Callable[..., np.ndarray], u: np.ndarray, v: np.ndarray) -> np.ndarray:
    points, normals = torus(u, v)
    return np.asarray(points - SCALE * (1 - height(u * TILES[0], v * TILES[1]))[..., None] * normals)


def true_normals(height: Callable[..., np.ndarray], u: np.ndarray, v: np.ndarray) -> np.ndarray:
    e = 1e-5
    along_u = carved(height, u + e, v) - carved(height, u - e, v)
    across = np.cross(along_u, carved(height, u, v + e) - carved(height, u, v - e))
    return np.asarray(across / np.linalg.norm(across, axis=-1, keepdims=True))


def relief_of(height: Callable[..., np.ndarray]) -> ibr.ReliefSurface:
    y, x = (np.mgrid[:64, :64] + 0.5) / 64
    return ibr.ReliefSurface(grid(torus, 96, 48), height(x, y).astype(np.float32), WHITE, SCALE, tiles=TILES)


@pytest.mark.parametrize("height", [even, rolling])
def test_shades_are_the_carved_torus_own(height):
    """Shades of the same points: a byte's rounding and means of two texels for slopes are 0.8 of 200 on average.
    With linear u and v along rays and frames of the entries, 1.6 are off on average, and 95 % by less than 7."""
    fine = grid(torus, 600, 300)
    u, v = np.asarray(fine.uv, np.float64).T
    colors = np.full((len(u), 3), 200, np.uint8)
    true = ibr.Mesh(carved(height, u, v), fine.faces, normals=true_normals(height, u, v), colors=colors)
    relief, off = relief_of(height), []
    for direction in LIGHTS:
        light = ibr.Light(direction=direction, ambient=0.0, shadow_size=0)
        truth, seen = (ibr.render(thing, CAMERA, light) for thing in (true, relief))
        both = truth.valid & seen.valid & (np.abs(truth.depth - seen.depth) < 0.1 * SCALE)
        assert both.sum() > 0.9 * truth.valid.sum()
        off.append(np.abs(truth.color.astype(int) - seen.color)[both].max(axis=1))
    shades = np.concatenate(off)
    assert shades.mean() <= 1.0
    assert np.quantile(shades, 0.95) <= 4


@pytest.mark.parametrize("height", [even, rolling])
def test_rays_meet_the_map_where_the_carved_torus_is(height):
    """The true surface at this place on the map is the picture's point. Linear u and v along rays would
    miss it by a share of the way below the base, depth over tube radius: 0.006 on average and 0.016 in 5 %."""
    relief = relief_of(height)
    places, frame = relief.tile_coordinates(CAMERA), ibr.render(relief, CAMERA)
    y, x = np.nonzero(frame.valid)
    points = CAMERA.unproject(np.column_stack([x, y]), frame.depth[y, x].astype(float))
    around = np.hypot(points[:, 0], points[:, 1])
    near = np.column_stack([np.arctan2(points[:, 1], points[:, 0]), np.arctan2(points[:, 2], around - 1)]) / (2 * np.pi)
    part = places[y, x].astype(np.float64)
    u, v = ((np.round(near * TILES - part) + part) / TILES).T
    off = np.linalg.norm(carved(height, u, v) - points, axis=1)
    # The base of 96 x 48 cells lies up to 0.0009 within its torus, two to three times that along an oblique ray.
    assert off.mean() <= 0.002
    assert np.quantile(off, 0.95) <= 0.005
