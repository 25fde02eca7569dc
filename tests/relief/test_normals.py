"""Normals of reliefs on a torus, and the places on the map that rays meet, compared with the carved torus."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import pyibr as ibr
from pyibr.core.camera import Camera
from tests.embree import points_of
from tests.relief.solids import grid, torus
from tests.relief.test_truth import WHITE

TILES, SCALE = (6, 3), 0.1
CAMERA = Camera.look_at((2, -2.5, 1.7), (0, 0, 0), (0, 0, 1), (160, 120), fov_y=42)
LIGHTS = (-0.3, 0.6, -1), (-1, 0.2, -0.3), (0.2, 1, -0.1)


def even(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return np.full_like(u + v, 0.5)


def rolling(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Smooth heights between 0.1 and 0.9, periodic with period 1."""
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
    """Shades of up to 200 are off by 0.8 on average, by rounding to bytes and by slopes averaged over two texels.

    If u and v were linear along rays, with the frames of the rays' entries, they would be off by 1.6 on average, and by
    up to 7 for 95 % of the points.
    """
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
    """The picture's point is the point of the true surface at the place on the map that the ray meets.

    If u and v were linear along rays, it would be off by the way below the base times depth divided by the tube's
    radius: by 0.006 on average, and by over 0.016 for 5 % of the points.
    """
    relief = relief_of(height)
    places, frame = relief.tile_coordinates(CAMERA), ibr.render(relief, CAMERA)
    points = points_of(frame)
    around = np.hypot(points[:, 0], points[:, 1])
    near = np.column_stack([np.arctan2(points[:, 1], points[:, 0]), np.arctan2(points[:, 2], around - 1)]) / (2 * np.pi)
    part = places[frame.valid].astype(np.float64)
    u, v = ((np.round(near * TILES - part) + part) / TILES).T
    off = np.linalg.norm(carved(height, u, v) - points, axis=1)
    # The base, of 96 x 48 cells, is up to 0.0009 inside of the torus; along oblique rays, two to three times as much.
    assert off.mean() <= 0.002
    assert np.quantile(off, 0.95) <= 0.005
