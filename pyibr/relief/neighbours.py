"""Neighbours of a mesh's triangles, for walks over its surface, and the directions of the relief below their sides."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pyibr.core.checks import Float64
from pyibr.meshes.normals import place_of, summed

_LEAST_TURN = 0.05  # below this share of the greatest, eigenvalues of the sum of n n^T over a place's normals are noise
_LEAST_AREA = 1e-6  # triangles of a smaller area, relative to the square of their longest side, are lines
_LONGEST = 2.0  # greatest length of a mitred normal: its length for two normals 120 degrees apart


def place_and_way(vertices: Float64, normals: Float64) -> NDArray[np.int64]:
    """(N,) a number for each pair of place and normal: vertices share it across seams of uv, not across hard edges."""
    kinds = place_of(vertices.astype(np.float32))
    for along in np.rint(1000 * normals).astype(np.int64).T:
        kinds = 2001 * kinds + along + 1000  # NumPy sorts numbers ten times as fast as rows
    return np.unique(kinds, return_inverse=True)[1].reshape(-1)


def mitred(vertices: Float64, normals: Float64, faces: NDArray[np.int32]) -> Float64:
    """(N, 3) normals, mitred at hard edges: surfaces that are moved along them still meet there.

    The component of a mitred normal along each normal of its place is 1; with normals more than 120 degrees apart it is
    shorter. Only normals of triangles with an area count.
    """
    place = place_of(vertices.astype(np.float32))
    a, b, c = vertices[faces].swapaxes(0, 1)
    across, longest = np.cross(b - a, c - a), np.maximum(((b - a) ** 2).sum(axis=1), ((c - a) ** 2).sum(axis=1))
    shown = np.unique(faces[np.linalg.norm(across, axis=1) > _LEAST_AREA * longest])
    _, first = np.unique(place_and_way(vertices, normals)[shown], return_index=True)
    first = shown[first]
    owner, ways, count = place[first], normals[first], int(place.max()) + 1
    several = np.bincount(owner, minlength=count) > 1
    squares = np.stack([summed(owner, ways * ways[:, [axis]], count)[several] for axis in range(3)], axis=1)
    sums = summed(owner, ways, count)
    inverse = np.linalg.pinv(squares, rcond=_LEAST_TURN, hermitian=True)
    made = np.einsum("nij,nj->ni", inverse, sums[several])
    sums[several] = made * (_LONGEST / np.maximum(np.linalg.norm(made, axis=1, keepdims=True), _LONGEST))
    return np.where(several[place, None], sums[place], normals)


def sides_beside(vertices: Float64, faces: NDArray[np.int32]) -> NDArray[np.int32]:
    """For each side of each triangle, the side of the neighbour across it: (M, 3) 3 * triangle + opposite corner.

    -1 at borders. Triangles are neighbours across seams of uv. Triangles with two corners at one place, as at the poles
    of a globe, are left out: the triangles at their two sides are neighbours.
    """
    place = place_of(vertices.astype(np.float32))
    ends = place[faces]
    start, end = ends[:, [1, 2, 0]], ends[:, [2, 0, 1]]
    solid = np.flatnonzero((start != end).all(axis=1))
    made = np.full(faces.shape, -1, np.int32)
    if not len(solid):
        return made
    count = int(place.max()) + 1
    there, back = ((first * count + second)[solid].ravel() for first, second in ((start, end), (end, start)))
    order = np.argsort(there, kind="stable")
    beside = order[np.searchsorted(there[order], back).clip(0, len(there) - 1)]  # the first of several
    made[solid] = np.where(there[beside] == back, 3 * solid[beside // 3] + beside % 3, -1).reshape(-1, 3)
    return made
