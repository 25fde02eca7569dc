"""Colours and light at points of triangles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pyibr.core.checks import Float64
from pyibr.meshes.normals import areas, summed_at_corners

_SUN: Float64 = np.array([1.0, 0.98, 0.92])
_SHADOW: Float64 = np.array([0.30, 0.28, 0.34])
_LIGHT: Float64 = np.array([-0.45, -0.8, -0.4]) / np.linalg.norm([0.45, 0.8, 0.4])


def light_on(normal: Float64) -> Float64:
    """Return the colours (n, 3) of sunlight from above on surfaces with unit normals (n, 3)."""
    lambert = normal @ _LIGHT
    light = 0.15 + 0.85 * np.maximum(lambert, 0) + 0.15 * np.minimum(lambert, 0)
    return _SHADOW + (_SUN - _SHADOW) * light[:, None]


def barycentric(corner: Float64, normal: Float64, point: Float64) -> Float64:
    """Barycentric weights (n, 3) of points on triangles (n, 3, 3), clamped to the triangles."""
    squared = np.maximum(np.sum(normal * normal, 1), np.finfo(np.float64).tiny)
    following, last = np.roll(corner, -1, axis=1), np.roll(corner, -2, axis=1)
    opposite = np.cross(last - following, point[:, None] - following)
    weight = np.clip(np.einsum("nkc,nc->nk", opposite, normal) / squared[:, None], 0, 1)
    total = weight.sum(axis=1, keepdims=True)
    return np.where(total > 0, weight / np.maximum(total, 1e-12), 1 / 3)


def bilinear(image: NDArray[np.uint8], uv: Float64) -> Float64:
    """Bilinear colours (n, 3) of a repeating image at uv (n, 2)."""
    size = np.array([image.shape[1], image.shape[0]])
    at = (uv - np.floor(uv)) * size - 0.5
    low = np.floor(at)
    (fx, fy), (x, y) = (at - low).T[..., None], low.astype(np.int64).T % size[:, None]
    right, down = (x + 1) % size[0], (y + 1) % size[1]
    top = (1 - fx) * image[y, x] + fx * image[y, right]
    return (1 - fy) * top + fy * ((1 - fx) * image[down, x] + fx * image[down, right])


def smooth_normals(vertices: Float64, faces: NDArray[np.integer]) -> Float64:
    """Unit vertex normals (N, 3): sums of the faces' normals, weighted by area."""
    total = summed_at_corners(faces, areas(vertices, faces), len(vertices))
    return total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), np.finfo(np.float64).tiny)
