"""Computed normals for meshes without their own, smooth except across hard edges; and gradients of uv."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from pyibr.core.checks import Float64

_HARD_EDGE = 0.5  # cosine: a hard edge separates normals that are more than 60 degrees apart
_NEAR = 0.75**0.5  # cosine of 30 degrees: if all normals are this near to their mean, no two are at a hard edge
_CROWD = 64  # most normals at one place that are compared in pairs; if there are more, they share their mean
_AT_ONCE = 1 << 20  # pairs in memory
_TRIANGLES_AT_ONCE = 1 << 14  # their corners stay in the cache


def pieces_of(count: int) -> Iterator[slice]:
    """Slices that divide `count` triangles: the corners of millions of triangles together would take gigabytes."""
    return (slice(first, first + _TRIANGLES_AT_ONCE) for first in range(0, count, _TRIANGLES_AT_ONCE))


def areas(vertices: NDArray[np.floating], faces: NDArray[np.integer]) -> Float64:
    """(M, 3) normals of the triangles; their length is twice the area."""
    found = np.empty((len(faces), 3))
    for some in pieces_of(len(faces)):
        corner = vertices[faces[some]].astype(np.float64)
        found[some] = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    return found


def place_of(vertices: NDArray[np.float32]) -> NDArray[np.int64]:
    """(N,) index of each vertex's place, equal for vertices at one place, in the order of places.

    Coordinates that are tiny compared with the others become 0: in floating point, the sine of pi is not exactly 0.
    """
    tiny = np.abs(vertices).max(initial=0.0) * np.finfo(np.float32).eps
    flushed = np.where(np.abs(vertices) < tiny, np.float32(0), vertices) + np.float32(0)  # + 0 turns -0 into 0
    bits = flushed.view(np.uint32)
    x, y, z = (bits ^ np.where(bits >> 31, np.uint32(0xFFFFFFFF), np.uint32(1 << 31))).T.astype(np.uint64)
    high = np.uint64(32)
    return _ranks(_ranks(x << high | y).astype(np.uint64) << high | z)


def _ranks(values: NDArray[np.uint64]) -> NDArray[np.int64]:
    """(N,) rank of each value among the distinct values."""
    order = np.argsort(values)
    growing = values[order]
    ranks = np.empty(len(values), np.int64)
    ranks[order] = np.cumsum(growing != np.concatenate([growing[:1], growing[:-1]]))
    return ranks


def summed(owner: NDArray[np.integer], vectors: Float64, count: int) -> Float64:
    """(count, 3) sums of the (N, 3) vectors of each owner."""
    return np.stack([np.bincount(owner, vectors[:, axis], count) for axis in range(3)], axis=1).astype(np.float64)


def summed_at_corners(faces: NDArray[np.integer], vectors: Float64, count: int) -> Float64:
    """(count, 3) sums of the triangles' (M, 3) vectors at each vertex."""
    sums = [np.bincount(faces.ravel(), np.repeat(vectors[:, axis], 3), count) for axis in range(3)]
    return np.stack(sums, axis=1).astype(np.float64)


def summed_at_places(place: NDArray[np.int64], own: Float64) -> tuple[Float64, NDArray[np.bool_]]:
    """(N, 3) sums, for each vector of `own`, of the vectors at its place that face the same way; all for a zero vector.

    Also (N,) bool, whether other vectors at the place face another way. own: normals weighted by area.
    """
    sums, at_edges = own + 0.0, np.zeros(len(place), np.bool_)
    among = np.flatnonzero((np.bincount(place) > 1)[place])  # few in most meshes
    sums[among], at_edges[among] = _summed_among(place[among], own[among])
    return sums, at_edges


def _summed_among(place: NDArray[np.int64], own: Float64) -> tuple[Float64, NDArray[np.bool_]]:
    """`summed_at_places` for vectors that share their place with other vectors."""
    count = int(place.max(initial=-1)) + 1
    means = summed(place, own, count)
    sums, at_edges = means[place], np.zeros(len(place), np.bool_)
    ways = _unit(own)
    aslant = ((ways * _unit(means)[place]).sum(axis=1) < _NEAR) & ways.any(axis=1)
    crowd = np.bincount(place, minlength=count)
    members = np.flatnonzero(((np.bincount(place[aslant], minlength=count) > 0) & (crowd <= _CROWD))[place])
    members = members[np.argsort(place[members], kind="stable")]
    first = np.searchsorted(place[members], place[members])  # first member at the same place
    many = crowd[place[members]]
    pieces = np.flatnonzero(np.diff(np.cumsum(many) // _AT_ONCE, prepend=0))
    for rows in np.split(np.arange(len(members)), pieces):
        each = many[rows]
        owner = np.repeat(np.arange(len(rows)), each)
        other = members[first[rows][owner] + np.arange(len(owner)) - np.repeat(np.cumsum(each) - each, each)]
        here = members[rows][owner]
        cosine = (ways[here] * ways[other]).sum(axis=1)
        apart = (cosine <= _HARD_EDGE) & ways[here].any(axis=1) & ways[other].any(axis=1)
        sums[members[rows]] = summed(owner[~apart], own[other[~apart]], len(rows))
        at_edges[members[rows]] = np.bincount(owner[apart], minlength=len(rows)) > 0
    return sums, at_edges


def unit_or_up(vectors: Float64) -> Float64:
    """Unit vectors; (0, 0, 1) for zero vectors."""
    return np.where(vectors.any(axis=1, keepdims=True), _unit(vectors), (0.0, 0.0, 1.0))


def _unit(vectors: Float64) -> Float64:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(length > 0, vectors / np.where(length > 0, length, 1), 0.0)


def unit(vectors: Float64, otherwise: Float64) -> Float64:
    """Vectors (..., 3) at unit length; `otherwise` where they are zero."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.where(length > 1e-30, vectors / np.maximum(length, 1e-30), otherwise)


def any_tangent(normals: Float64) -> Float64:
    """(N, 3) unit vectors at right angles to normals."""
    least = np.eye(3)[np.abs(normals).argmin(axis=1)]
    return unit(np.cross(normals, least), np.array([1.0, 0.0, 0.0]))


def uv_gradients(corners: Float64, uv: Float64) -> tuple[Float64, NDArray[np.bool_]]:
    """Gradients of u and v over triangles with `corners` (T, 3, 3) and `uv` (T, 3, 2).

    (T, 2, 3) in the triangles' planes, per scene unit, zero where the triangle is degenerate; and (T,) False where the
    triangle or its uv is degenerate.
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
