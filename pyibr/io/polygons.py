"""Triangulation of polygons: fans for convex ones, ear clipping for concave ones."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

_CONCAVE_MAX = 2000
"""Limit on the corners of a concave polygon: the time grows with their square."""

Points = NDArray[np.float64]


def triangles(counts: NDArray[np.int64], points: NDArray[np.floating]) -> NDArray[np.int64]:
    """(M, 3) triangles as indices into a list of corners at `points`; polygons have `counts` corners each.

    ValueError for a concave polygon of more than 2000 corners.
    """
    start = np.cumsum(counts) - counts
    if (counts == 3).all():
        return np.arange(len(points)).reshape(-1, 3)
    owner = np.repeat(np.arange(len(counts)), counts)
    place = np.arange(len(points)) - start[owner]
    around = points - points[start[owner]].astype(np.float64)
    before, after = ((start[owner] + (place + step) % counts[owner]) for step in (-1, 1))
    across, bent = np.cross(around, around[after]), np.cross(around - around[before], around[after] - around)
    normals = np.empty((len(counts), 3))
    for axis in range(3):
        normals[:, axis] = np.bincount(owner, across[:, axis], len(counts))
    hollow = np.einsum("ij,ij->i", bent, normals[owner]) < 0
    first = np.zeros(len(counts), np.int64)  # a fan from a concave corner cuts concave quads, too
    first[owner[hollow]] = place[hollow]
    inner = np.maximum(counts - 2, 0)
    done = np.cumsum(inner) - inner
    polygon = np.repeat(np.arange(len(counts)), inner)
    step = np.arange(len(polygon)) - done[polygon]
    fan = np.column_stack([np.zeros_like(step), step + 1, step + 2])
    found = start[polygon, None] + (first[polygon, None] + fan) % counts[polygon, None]
    for number in np.unique(owner[hollow & (counts[owner] > 4)]):
        if counts[number] > _CONCAVE_MAX:
            raise ValueError(f"a concave polygon of {counts[number]} corners; at most {_CONCAVE_MAX} are supported")
        begin = start[number]
        flat = _flat(around[begin : begin + counts[number]], normals[number])
        found[done[number] : done[number] + inner[number]] = begin + _by_ears(flat)
    return found


def _flat(points: Points, normal: NDArray[np.float64]) -> Points:
    """(n, 2) points, projected along the axis nearest to the normal, counter-clockwise."""
    axis = int(np.abs(normal).argmax())
    across = [(axis + 1) % 3, (axis + 2) % 3]
    return points[:, across if normal[axis] > 0 else across[::-1]]


def _by_ears(flat: Points) -> NDArray[np.int64]:
    """(n - 2, 3) triangles by ear clipping: corners whose triangles hold no other corner are cut off in turn.

    A self-intersecting polygon may run out of ears: the rest becomes a fan.
    """
    count = len(flat)
    before, after = np.roll(np.arange(count), 1), np.roll(np.arange(count), -1)
    left, found, waiting = np.ones(count, np.bool_), list[tuple[int, int, int]](), list(range(count - 1, -1, -1))
    while waiting and len(found) < count - 3:
        corner = waiting.pop()
        ear = int(before[corner]), corner, int(after[corner])
        if left[corner] and _is_ear(flat[list(ear)], flat[left]):
            found.append(ear)
            left[corner] = False
            after[ear[0]], before[ear[2]] = ear[2], ear[0]
            waiting += (ear[2], ear[0])  # only the neighbours have changed
    rest = np.flatnonzero(left)
    found += [(int(rest[0]), int(one), int(other)) for one, other in pairwise(rest[1:])]
    return np.array(found, np.int64)


def _is_ear(corners: Points, others: Points) -> bool:
    """Tell whether three corners turn left or run straight, without another corner inside."""
    sides = [_left_of(corners[k], corners[(k + 1) % 3], others) for k in range(3)]
    return bool(_left_of(*corners) >= 0) and not ((sides[0] > 0) & (sides[1] > 0) & (sides[2] > 0)).any()


def _left_of(begin: Points, end: Points, point: Points) -> NDArray[np.float64]:
    """Twice the area of the triangle with `point`, positive if it is to the left of the line from begin to end."""
    ahead, aside = end - begin, point - begin
    return ahead[0] * aside[..., 1] - ahead[1] * aside[..., 0]
