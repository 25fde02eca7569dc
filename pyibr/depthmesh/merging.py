"""Merging of triangles to a given number by edge collapses, the cheapest first.

A quadtree leaves all triangles along a depth edge as fine as the samples; merging removes these, too. The cost of
moving a vertex comes from the quadrics of Garland and Heckbert (SIGGRAPH 1997): the sum of its squared distances from
the planes of all triangles merged into it, and from planes perpendicular to the surface along its outline. So no vertex
lies farther from any of these planes than the square root of its cost. Vertices stay samples: one end of an edge moves
to the other. Edges without a common triangle collapse in the same round.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pyibr.core.checks import Float64

Whole = NDArray[np.int64]

_ROUNDS_MAX = 400  # rounds of collapses: each removes a few percent of the triangles
_CHEAPEST = 0.3  # fraction of the edges that may collapse in a round
_SHUFFLE = 2654435761  # multiplicative hash (Knuth): odd, and near the golden section of 2^32
_NO_COST = 1e-6  # relative to the extent: smaller distances are rounding errors
_AREA_MIN = 1e-3  # square pixels: smaller triangles count as degenerate


def merged(points: Float64, pixels: Float64, faces: Whole, count: int, max_error: float) -> Whole:
    """Merge the triangles (T, 3) of a view to at most `count` triangles (t, 3), whose corners are some of the vertices.

    No vertex ends up farther than `max_error`, in scene units, from the planes merged into it, and no triangle turns
    over in the view, where the vertices `points`, (N, 3), lie at `pixels`, (N, 2).
    """
    quadrics = _quadrics(points, faces)
    live = np.ones(len(points), np.bool_)  # vertices whose edges may be within the error: costs never fall
    refused = np.empty(0, np.int64)  # edges, start * N + end, whose recent collapses were rejected
    changed = True  # since the refused edges were last tried again
    for _ in range(_ROUNDS_MAX):
        if len(faces) <= count:
            break
        ends, costs = _edges(points, quadrics, faces, live, refused)
        gone, stays = _apart(ends, costs, faces, len(points), max_error, (len(faces) - count + 1) // 2).T
        sound = _stays_in_order(pixels, faces, gone, stays, len(points))
        if not len(gone) and not changed:
            break
        tried = np.concatenate([ends[costs <= max_error**2, 0], refused // len(points)])
        # A rejected collapse may succeed once its surroundings have changed.
        lately = gone[~sound] * len(points) + stays[~sound]
        refused = np.concatenate([refused, lately])[-len(faces) // 2 :] if len(gone) else refused[:0]
        changed = bool(sound.any()) or (changed and len(gone) > 0)
        gone, stays = gone[sound], stays[sound]
        live[:] = False
        live[gone] = live[stays] = True
        live[faces[_with_any(live, faces)]] = True
        live[tried] = True
        quadrics[stays] += quadrics[gone]
        moved = np.arange(len(points))
        moved[gone] = stays
        faces = moved[faces]
        faces = faces[(faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])]
    return faces


def _quadrics(points: Float64, faces: Whole) -> Float64:
    """(N, 4, 4) quadrics: sums of squared distances from the planes of each vertex's triangles and outline edges."""
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


def _with_any(vertices: NDArray[np.bool_], faces: Whole) -> NDArray[np.bool_]:
    """Find the triangles with any of the vertices as a corner: (T,) bool. Faster than a reduction of rows of three."""
    a, b, c = faces.T
    return vertices[a] | vertices[b] | vertices[c]


def _half_edges(faces: Whole) -> tuple[Whole, Whole, Whole]:
    """(E, 2) directed edges of the triangles, (E,) their triangles, and (E,) edge indices, equal in both directions."""
    there = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    low, high = np.sort(there, axis=1).T
    _, number = np.unique(low * (int(faces.max(initial=0)) + 1) + high, return_inverse=True)
    return there, np.repeat(np.arange(len(faces)), 3), number


def _edges(
    points: Float64, quadrics: Float64, faces: Whole, live: NDArray[np.bool_], refused: Whole
) -> tuple[Whole, Float64]:
    """Edges (E, 2) whose `live` first vertex may move to the second, except `refused`; and their costs."""
    there, _, number = _half_edges(faces[_with_any(live, faces)])  # all triangles of the edges from live vertices
    sides = np.bincount(number)
    _, first = np.unique(number, return_index=True)
    ends, outline = there[first], sides == 1
    touches = np.zeros(len(points), np.bool_)
    touches[ends[outline]] = True
    both = np.concatenate([ends, ends[:, ::-1]])
    on_outline = np.concatenate([outline, outline])
    # Outline vertices stay on the outline, and edges of more than two triangles stay as they are.
    may = (on_outline | ~touches[both[:, 0]]) & (np.concatenate([sides, sides]) <= 2)
    may &= live[both[:, 0]] & ~np.isin(both[:, 0] * len(points) + both[:, 1], refused)
    both = both[may]
    place = np.column_stack([points[both[:, 1]], np.ones(len(both))])
    sums = quadrics[both[:, 0]] + quadrics[both[:, 1]]
    cost = np.einsum("ni,nij,nj->n", place, sums, place)
    return both, np.where(cost > (_NO_COST * np.ptp(points, axis=0).max()) ** 2, cost, 0.0)


def _apart(ends: Whole, costs: Float64, faces: Whole, vertices: int, max_error: float, most: int) -> Whole:
    """(n, 2) the cheapest edges without common triangles, at most `most`."""
    allowed = np.flatnonzero(costs <= max_error**2)
    # A hash breaks ties. On planes all costs are equal: in index order, each edge would wait for the one before.
    order = allowed[np.lexsort((allowed * _SHUFFLE % 2**32, costs[allowed]))]
    order = order[: max(int(_CHEAPEST * len(costs)), 16)]
    rank = np.arange(len(order))
    least = np.full(vertices, len(costs), np.int64)
    ends = ends[order]
    for column in ends.T:
        np.minimum.at(least, column, rank)
    for _ in range(2):  # over two rings of triangles around each vertex
        of_faces = least[faces].min(axis=1)
        for column in faces.T:
            np.minimum.at(least, column, of_faces)
    first = (least[ends[:, 0]] == rank) & (least[ends[:, 1]] == rank)
    return ends[first][:most]


def _stays_in_order(pixels: Float64, faces: Whole, gone: Whole, stays: Whole, vertices: int) -> NDArray[np.bool_]:
    """Find the collapses that turn no triangle over and join no surfaces: (n,) bool."""
    target = np.full(vertices, -1)
    target[gone] = stays
    number = np.full(vertices, -1)
    number[gone] = np.arange(len(gone))
    bad = np.zeros(len(gone), np.bool_)
    around = np.flatnonzero(_with_any(target >= 0, faces))
    some, to = faces[around], target[faces[around]]
    which = np.where(to >= 0, number[some], -1).max(axis=1)
    after = np.where(to >= 0, to, some)
    kept = (after[:, 0] != after[:, 1]) & (after[:, 1] != after[:, 2]) & (after[:, 2] != after[:, 0])
    before, later = _areas(pixels, some), _areas(pixels, after)
    turned = kept & (later * np.sign(before) < _AREA_MIN)
    bad[which[turned]] = True
    # Only corners of the edge's own triangles may have edges to both ends: otherwise two surfaces would grow together.
    removed = np.bincount(which[~kept], minlength=len(gone))
    shared = _common_neighbours(faces, gone, stays, vertices)
    return ~bad & (shared == removed)


def _areas(pixels: Float64, faces: Whole) -> Float64:
    a, b, c = (pixels[faces[:, k]] for k in range(3))
    u, v = b - a, c - a
    return 0.5 * (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])


def _common_neighbours(faces: Whole, gone: Whole, stays: Whole, vertices: int) -> Whole:
    """For each of the separate edges, count the vertices with edges to both of its ends."""
    number = np.full(vertices, -1)
    number[gone] = number[stays] = np.arange(len(gone))
    there = faces[_with_any(number >= 0, faces)][:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    there = np.concatenate([there, there[:, ::-1]])
    there = there[(number[there[:, 0]] >= 0) & (number[there[:, 0]] != number[there[:, 1]])]
    is_gone = np.zeros(vertices, np.int64)
    is_gone[gone] = 1
    edge, other = number[there[:, 0]], there[:, 1]
    pairs = np.unique(np.stack([edge, other, is_gone[there[:, 0]]], axis=1), axis=0)
    again = (pairs[1:, :2] == pairs[:-1, :2]).all(axis=1)
    return np.bincount(pairs[1:][again, 0], minlength=len(gone))
