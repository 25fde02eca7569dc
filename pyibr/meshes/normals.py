"""Normals of meshes that bring none: smooth over the surface, but not over its hard edges."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from pyibr.core.checks import Float64

_HARD_EDGE = 0.5  # cosine: what faces more than 60 degrees apart is divided by a hard edge
_NEAR = 0.75**0.5  # cosine of half of that: no two are farther apart if all are so near to their mean
_CROWD = 64  # at one place: more are not compared in pairs, and share their mean
_AT_ONCE = 1 << 20  # pairs in memory
_TRIANGLES_AT_ONCE = 1 << 14  # their corners stay in the cache


def pieces_of(count: int) -> Iterator[slice]:
    """So many triangles, some after the other: of millions, all corners at once would be gigabytes."""
    return (slice(first, first + _TRIANGLES_AT_ONCE) for first in range(0, count, _TRIANGLES_AT_ONCE))


def areas(vertices: NDArray[np.floating], faces: NDArray[np.integer]) -> Float64:
    """(M, 3) the triangles' normals, twice as long as their areas."""
    found = np.empty((len(faces), 3))
    for some in pieces_of(len(faces)):
        corner = vertices[faces[some]].astype(np.float64)
        found[some] = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    return found


def place_of(vertices: NDArray[np.float32]) -> NDArray[np.int64]:
    """(N,) equal numbers for vertices at one place, in the order of places.

    A coordinate that is tiny beside the others is 0: the sine of half a turn is not, for computers.
    """
    tiny = np.abs(vertices).max(initial=0.0) * np.finfo(np.float32).eps
    flushed = np.where(np.abs(vertices) < tiny, np.float32(0), vertices) + np.float32(0)  # there is one 0 only
    bits = flushed.view(np.uint32)
    x, y, z = (bits ^ np.where(bits >> 31, np.uint32(0xFFFFFFFF), np.uint32(1 << 31))).T.astype(np.uint64)
    high = np.uint64(32)
    return _ranks(_ranks(x << high | y).astype(np.uint64) << high | z)


def _ranks(values: NDArray[np.uint64]) -> NDArray[np.int64]:
    """(N,) what number among the different values each is, by size."""
    order = np.argsort(values)
    growing = values[order]
    ranks = np.empty(len(values), np.int64)
    ranks[order] = np.cumsum(growing != np.concatenate([growing[:1], growing[:-1]]))
    return ranks


def summed(owner: NDArray[np.integer], vectors: Float64, count: int) -> Float64:
    """(count, 3) what the (N, 3) vectors of each owner sum up to."""
    return np.stack([np.bincount(owner, vectors[:, axis], count) for axis in range(3)], axis=1).astype(np.float64)


def summed_at_corners(faces: NDArray[np.integer], vectors: Float64, count: int) -> Float64:
    """(count, 3) what the triangles' (M, 3) vectors sum up to at each vertex."""
    sums = [np.bincount(faces.ravel(), np.repeat(vectors[:, axis], 3), count) for axis in range(3)]
    return np.stack(sums, axis=1).astype(np.float64)


def summed_at_places(place: NDArray[np.int64], own: Float64) -> tuple[Float64, NDArray[np.bool_]]:
    """Sum, for each vector, those at its place that face the same way.

    Parameters
    ----------
    place : (N,) int64
    own : (N, 3) float64
        Normals by area. What has none goes with all that are there.

    Returns
    -------
    sums : (N, 3) float64
    at_edges : (N,) bool
        Whether some at the place face another way.
    """
    sums, at_edges = own + 0.0, np.zeros(len(place), np.bool_)
    among = np.flatnonzero((np.bincount(place) > 1)[place])  # most meshes have few
    sums[among], at_edges[among] = _summed_among(place[among], own[among])
    return sums, at_edges


def _summed_among(place: NDArray[np.int64], own: Float64) -> tuple[Float64, NDArray[np.bool_]]:
    """`summed_at_places` of vectors that are not alone at their places."""
    count = int(place.max(initial=-1)) + 1
    means = summed(place, own, count)
    sums, at_edges = means[place], np.zeros(len(place), np.bool_)
    ways = _unit(own)
    aslant = ((ways * _unit(means)[place]).sum(axis=1) < _NEAR) & ways.any(axis=1)
    crowd = np.bincount(place, minlength=count)
    members = np.flatnonzero(((np.bincount(place[aslant], minlength=count) > 0) & (crowd <= _CROWD))[place])
    members = members[np.argsort(place[members], kind="stable")]
    first = np.searchsorted(place[members], place[members])  # of each one's place
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
    """At unit length; (0, 0, 1) for what has none."""
    return np.where(vectors.any(axis=1, keepdims=True), _unit(vectors), (0.0, 0.0, 1.0))


def _unit(vectors: Float64) -> Float64:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(length > 0, vectors / np.where(length > 0, length, 1), 0.0)
