"""Triangles merged to a number of them, along depth edges, too: edges collapse, the cheapest first.

A quadtree leaves all triangles along a depth edge as fine as samples are. Garland and Heckbert's quadrics (SIGGRAPH
1997) tell what moving a vertex costs: the sum of its squared distances from the planes of all triangles that have been
merged in it, and from planes that stand on the outline. So no vertex lies off any of them by more than the root of it.
Vertices stay samples: an edge's one end moves to the other. Edges that have no triangle in common collapse at once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pyibr.core.checks import Float64

Whole = NDArray[np.int64]

_ROUNDS_MAX = 400  # of collapses: each takes away some percent
_CHEAPEST = 0.3  # the share of the edges that may collapse in a round
_SHUFFLE = 2654435761  # a hash of numbers (Knuth): odd, and near the golden section of 2^32
_NO_COST = 1e-6  # of the extent: less is rounding
_AREA_MIN = 1e-3  # square pixels: smaller triangles are none


@dataclass(frozen=True)
class _Edges:
    """Edges of triangles, and what collapses of their first end to the second cost."""

    ends: Whole
    cost: Float64


def merged(points: Float64, pixels: Float64, faces: Whole, count: int, max_error: float) -> Whole:
    """Merge triangles of a view.

    Parameters
    ----------
    points : (N, 3) float64
        In space.
    pixels : (N, 2) float64
        In the view, where no triangle may turn over.
    faces : (T, 3) int64
    count : int
        At most so many triangles are to be left.
    max_error : float
        Scene units by which no vertex may lie off what is merged in it.

    Returns
    -------
    (t, 3) int64
        Of the same vertices, of which some are no longer used.
    """
    quadrics = _quadrics(points, faces)
    refused = np.empty(0, np.int64)  # edges, start * N + end, that could not collapse lately
    for _ in range(_ROUNDS_MAX):
        if len(faces) <= count:
            break
        edges = _costs(points, quadrics, faces, refused)
        chosen = _apart(edges, faces, len(points), max_error, (len(faces) - count + 1) // 2)
        gone, stays = edges.ends[chosen].T
        sound = _stays_in_order(pixels, faces, gone, stays, len(points))
        if not len(gone) and not len(refused):
            break
        # What is refused may do once its surroundings have changed.
        lately = gone[~sound] * len(points) + stays[~sound]
        refused = np.concatenate([refused, lately])[-len(faces) // 2 :] if len(gone) else refused[:0]
        gone, stays = gone[sound], stays[sound]
        quadrics[stays] += quadrics[gone]
        moved = np.arange(len(points))
        moved[gone] = stays
        faces = moved[faces]
        faces = faces[(faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])]
    return faces


def _quadrics(points: Float64, faces: Whole) -> Float64:
    """(N, 4, 4) sums of squared distances from the planes around each vertex."""
    a, b, c = (points[faces[:, k]] for k in range(3))
    normals = _unit(np.cross(b - a, c - a))
    found = np.zeros((len(points), 4, 4))
    _add_planes(found, faces, normals, a)
    there, faces_of, number = _half_edges(faces)
    outline = np.flatnonzero(np.bincount(number)[number] == 1)
    start, end = points[there[outline, 0]], points[there[outline, 1]]
    _add_planes(found, there[outline], _unit(np.cross(end - start, normals[faces_of[outline]])), start)
    return found


def _add_planes(quadrics: Float64, corners: Whole, normals: Float64, on: Float64) -> None:
    planes = np.column_stack([normals, -np.sum(normals * on, axis=1)])
    squares = planes[:, :, None] * planes[:, None, :]
    for column in corners.T:
        np.add.at(quadrics, column, squares)


def _unit(vectors: Float64) -> Float64:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return vectors / np.where(length > 0, length, 1.0)


def _half_edges(faces: Whole) -> tuple[Whole, Whole, Whole]:
    """(E, 2) each triangle's edges as it is wound, (E,) the triangle, and (E,) a number that both sides share."""
    there = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    low, high = np.sort(there, axis=1).T
    _, number = np.unique(low * (int(faces.max()) + 1) + high, return_inverse=True)
    return there, np.repeat(np.arange(len(faces)), 3), number


def _costs(points: Float64, quadrics: Float64, faces: Whole, refused: Whole) -> _Edges:
    """Either way of each edge that may collapse, but those that were refused."""
    there, _, number = _half_edges(faces)
    sides = np.bincount(number)
    _, first = np.unique(number, return_index=True)
    ends, outline = there[first], sides == 1
    touches = np.zeros(len(points), np.bool_)
    touches[ends[outline]] = True
    both = np.concatenate([ends, ends[:, ::-1]])
    on_outline = np.concatenate([outline, outline])
    # What is on the outline stays on it, and edges of more than two triangles are left.
    may = (on_outline | ~touches[both[:, 0]]) & (np.concatenate([sides, sides]) <= 2)
    may &= ~np.isin(both[:, 0] * len(points) + both[:, 1], refused)
    both = both[may]
    place = np.column_stack([points[both[:, 1]], np.ones(len(both))])
    sums = quadrics[both[:, 0]] + quadrics[both[:, 1]]
    cost = np.einsum("ni,nij,nj->n", place, sums, place)
    return _Edges(both, np.where(cost > (_NO_COST * np.ptp(points, axis=0).max()) ** 2, cost, 0.0))


def _apart(edges: _Edges, faces: Whole, vertices: int, max_error: float, most: int) -> Whole:
    """Numbers of the cheapest edges that have no triangle in common, at most so many."""
    allowed = np.flatnonzero(edges.cost <= max_error**2)
    # On planes all cost the same: in the edges' own order each would wait for the one beside it.
    order = allowed[np.lexsort((allowed * _SHUFFLE % 2**32, edges.cost[allowed]))]
    order = order[: max(int(_CHEAPEST * len(edges.cost)), 16)]
    rank = np.arange(len(order))
    least = np.full(vertices, len(edges.cost), np.int64)
    ends = edges.ends[order]
    for column in ends.T:
        np.minimum.at(least, column, rank)
    for _ in range(2):  # over the triangles around, and those around these
        of_faces = least[faces].min(axis=1)
        for column in faces.T:
            np.minimum.at(least, column, of_faces)
    first = (least[ends[:, 0]] == rank) & (least[ends[:, 1]] == rank)
    return order[first][:most]


def _stays_in_order(pixels: Float64, faces: Whole, gone: Whole, stays: Whole, vertices: int) -> NDArray[np.bool_]:
    """Tell which collapses turn no triangle over, and join no surfaces."""
    target = np.full(vertices, -1)
    target[gone] = stays
    number = np.full(vertices, -1)
    number[gone] = np.arange(len(gone))
    bad = np.zeros(len(gone), np.bool_)
    corner = target[faces]
    around = np.flatnonzero((corner >= 0).any(axis=1))
    some, to = faces[around], corner[around]
    which = np.where(to >= 0, number[some], -1).max(axis=1)
    after = np.where(to >= 0, to, some)
    kept = (after[:, 0] != after[:, 1]) & (after[:, 1] != after[:, 2]) & (after[:, 2] != after[:, 0])
    before, later = _areas(pixels, some), _areas(pixels, after)
    turned = kept & (later * np.sign(before) < _AREA_MIN)
    bad[which[turned]] = True
    # Vertices that both ends have an edge to are those of the edge's own triangles, or two sheets would be one.
    removed = np.bincount(which[~kept], minlength=len(gone))
    shared = _common_neighbours(faces, gone, stays, vertices)
    return ~bad & (shared == removed)


def _areas(pixels: Float64, faces: Whole) -> Float64:
    a, b, c = (pixels[faces[:, k]] for k in range(3))
    u, v = b - a, c - a
    return 0.5 * (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])


def _common_neighbours(faces: Whole, gone: Whole, stays: Whole, vertices: int) -> Whole:
    """Number of vertices with edges to both ends of each of the edges, which are apart from each other."""
    number = np.full(vertices, -1)
    number[gone] = number[stays] = np.arange(len(gone))
    there = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    there = np.concatenate([there, there[:, ::-1]])
    there = there[(number[there[:, 0]] >= 0) & (number[there[:, 0]] != number[there[:, 1]])]
    is_gone = np.zeros(vertices, np.int64)
    is_gone[gone] = 1
    edge, other = number[there[:, 0]], there[:, 1]
    pairs = np.unique(np.stack([edge, other, is_gone[there[:, 0]]], axis=1), axis=0)
    again = (pairs[1:, :2] == pairs[:-1, :2]).all(axis=1)
    return np.bincount(pairs[1:][again, 0], minlength=len(gone))
