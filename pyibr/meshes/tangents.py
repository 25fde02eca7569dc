"""Gradients of texture coordinates over a mesh."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pyibr.core.checks import Float64


def unit(vectors: Float64, otherwise: Float64) -> Float64:
    """Vectors (..., 3) at unit length; `otherwise` where they are zero."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.where(length > 1e-30, vectors / np.maximum(length, 1e-30), otherwise)


def uv_gradients(corners: Float64, uv: Float64) -> tuple[Float64, NDArray[np.bool_]]:
    """Gradients of u and v over triangles, in the world.

    Parameters
    ----------
    corners : (T, 3, 3) float64
        Corners of the triangles, in the world.
    uv : (T, 3, 2) float64

    Returns
    -------
    gradients : (T, 2, 3) float64
        Within the triangle's plane, per scene unit; zero where the triangle is degenerate.
    usable : (T,) bool
        False where the triangle or its uv is degenerate.
    """
    sides, changes = corners[:, 1:] - corners[:, :1], uv[:, 1:] - uv[:, :1]
    across = np.cross(sides[:, 0], sides[:, 1])
    # A linear system for each triangle, with two sides and the normal as rows.
    rows = np.concatenate([sides, unit(across, np.array([0.0, 0.0, 1.0]))[:, None]], axis=1)
    good = np.abs(np.linalg.det(rows)) > 1e-30
    rows[~good] = np.eye(3)
    values = np.concatenate([changes, np.zeros((len(uv), 1, 2))], axis=1)
    gradients: Float64 = np.linalg.solve(rows, values).transpose(0, 2, 1).astype(np.float64)
    gradients[~good] = 0
    area = changes[:, 0, 0] * changes[:, 1, 1] - changes[:, 0, 1] * changes[:, 1, 0]
    return gradients, good & (np.abs(area) > 1e-12 * np.abs(changes).max(axis=(1, 2), initial=1e-30) ** 2)
