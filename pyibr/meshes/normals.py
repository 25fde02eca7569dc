"""Normals of meshes that bring none: smooth over the surface, but not over its hard edges."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pyibr.core.checks import Float64

_HARD_EDGE = 0.5  # cosine: what faces more than 60 degrees apart is divided by a hard edge
_NEAR = 0.75**0.5  # cosine of half of that: no two are farther apart if all are so near to their mean
_CROWD = 64  # at one place: more are not compared in pairs, and share their mean
_AT_ONCE = 1 << 20  # pairs in memory


def areas(vertices: NDArray[np.floating], faces: NDArray[np.integer]) -> Float64:
    """(M, 3) the triangles' normals, twice as long as their areas."""
    corner = vertices.astype(np.float64)[faces]
    return np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])


def place_of(vertices: NDArray[np.float32]) -> NDArray[np.int64]:
    """(N,) equal numbers for vertices at one place, in the order of places.

    A coordinate that is tiny beside the others is 0: the sine of half a turn is not, for computers.
    """
    tiny = np.abs(vertices).max(initial=0.0) * np.finfo(np.float32).eps
    flushed = np.where(np.abs(vertices) < tiny, np.float32(0), vertices)
    return np.unique(flushed, axis=0, return_inverse=True)[1].reshape(-1).astype(np.int64)


def summed(owner: NDArray[np.integer], vectors: Float64, count: int) -> Float64:
    """(count, 3) what the (N, 3) vectors of each owner sum up to."""
    return np.stack([np.bincount(owner, vectors[:, axis], count) for axis in range(3)], axis=1).astype(np.float64)


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
