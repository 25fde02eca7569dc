"""Which triangles of a mesh lie beside each other, as a walk over its surface goes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pyibr.core.checks import Float64


def place_and_way(vertices: Float64, normals: Float64) -> NDArray[np.int64]:
    """(N,) equal numbers for vertices at one place with one normal: seams of uv do not part them, hard edges do."""
    kinds = np.column_stack([vertices, normals.round(3)])
    return np.unique(kinds, axis=0, return_inverse=True)[1].reshape(-1)


def neighbours(vertices: Float64, faces: NDArray[np.int32], normals: Float64) -> NDArray[np.int32]:
    """(M, 3) triangles on the sides opposite to each corner, across seams of uv, too; -1 at borders and hard edges.

    Parameters
    ----------
    vertices : (N, 3) float64
    faces : (M, 3) int32
    normals : (N, 3) float64
        Unit length.
    """
    place = place_and_way(vertices, normals)
    ends = place[faces]
    start, end = (ends[:, corners].ravel() for corners in ([1, 2, 0], [2, 0, 1]))
    count = int(place.max(initial=-1)) + 1
    there, back = start * count + end, end * count + start
    order = np.argsort(there, kind="stable")
    at = np.searchsorted(there[order], back).clip(0, max(len(there) - 1, 0))
    beside = order[at]  # the first of several
    return np.where(there[beside] == back, beside // 3, -1).astype(np.int32).reshape(faces.shape)
