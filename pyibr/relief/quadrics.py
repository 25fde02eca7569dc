"""Quadrics and frames of a mesh at its vertices: the directions of uv, and the surface's curvature (section 3).

Around each vertex the mesh is approximated by z = a x^2 + b y^2 + c x y in the vertex's tangent frame: z along the
normal, x along the direction in which u grows fastest, y at right angles to both. The paper has no c, so its uv has to
run along the directions of greatest and least curvature.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pyibr.core.checks import Float64
from pyibr.meshes.mesh import Mesh
from pyibr.meshes.normals import (
    any_tangent,
    areas,
    place_of,
    summed,
    summed_at_places,
    unit,
    unit_or_up,
    uv_gradients,
)
from pyibr.relief.neighbours import place_and_way

_SINGULAR = 1e-6  # values below this, relative to the largest value, are rounding errors
_HARD = 0.97  # cosine: normals at least 14 degrees from their place's mean normal belong to a hard edge
_BENT = 1e-3  # largest rounding error in differences between a flat triangle's unit normals
_BELOW = -0.1  # cosine between the mean normal and the direction into a triangle: if smaller, the triangle falls away


@dataclass(frozen=True)
class VertexFrames:
    """A mesh's vertices for relief mapping.

    The gradients are zero where no triangle with usable uv meets the vertex. The quadrics are zero where the vertex is
    planar: its neighbours lie on a line through it.
    """

    normals: Float64  # (N, 3) unit length
    gradients: Float64  # (N, 2, 3) of tiled u and v, in the tangent plane, per scene unit: 1 / length is a tile's size
    quadrics: Float64  # (N, 3) a, b and c, per scene unit
    planar: NDArray[np.bool_]  # (N,)


def split_at_mirrors(mesh: Mesh) -> Mesh:
    """Double the vertices between triangles whose uv have opposite orientations, so that each has its own gradients.

    Copies follow the original vertices; a mesh without such vertices is returned as it is.
    """
    uv = np.asarray(mesh.uv, np.float64)
    usable = uv_gradients(mesh.vertices.astype(np.float64)[mesh.faces], uv[mesh.faces])[1]
    a, b = (uv[mesh.faces[:, k]] - uv[mesh.faces[:, 0]] for k in (1, 2))
    mirrored = usable & (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] < 0)
    of_either = np.zeros((2, len(uv)), np.bool_)
    of_either[0, mesh.faces[usable & ~mirrored]] = True
    of_either[1, mesh.faces[mirrored]] = True
    doubled = np.flatnonzero(of_either.all(axis=0))
    if not len(doubled):
        return mesh
    number = np.arange(len(uv), dtype=np.int32)
    number[doubled] = len(uv) + np.arange(len(doubled))
    faces = np.where(mirrored[:, None], number[mesh.faces], mesh.faces)
    kept = np.concatenate([np.arange(len(uv)), doubled])
    normals = mesh.normals if mesh.normals is not None else mesh.smooth_normals
    return Mesh(mesh.vertices[kept], faces, uv=uv[kept], normals=normals[kept])


def split_at_edges(mesh: Mesh) -> Mesh:
    """Double the vertices of a mesh without normals where its triangles are more than 60 degrees apart.

    No quadric fits a surface that bends so much between neighbours, so each side gets its own normal. Copies follow the
    original vertices; a mesh without such vertices, or with normals, is returned as it is.
    """
    if mesh.normals is not None:
        return mesh
    corners = mesh.faces.ravel()
    own = np.repeat(areas(mesh.vertices, mesh.faces), 3, axis=0)
    sums, at_edges = summed_at_places(place_of(mesh.vertices)[corners], own)
    if not at_edges.any():
        return mesh
    kinds = np.column_stack([corners, unit_or_up(sums).round(6)])
    _, first, kind = np.unique(kinds, axis=0, return_index=True, return_inverse=True)
    owner = corners[first]  # in vertex order
    is_copy = np.diff(owner, prepend=-1) == 0
    number = owner.copy()
    number[is_copy] = len(mesh.vertices) + np.arange(is_copy.sum(), dtype=np.int32)
    normals = np.concatenate([mesh.smooth_normals, np.zeros((is_copy.sum(), 3), np.float32)])
    normals[number] = unit_or_up(sums)[first]
    kept = np.concatenate([np.arange(len(mesh.vertices)), owner[is_copy]])
    uv = np.asarray(mesh.uv)[kept]
    return Mesh(mesh.vertices[kept], number[kind.reshape(-1)].reshape(-1, 3), uv=uv, normals=normals)


def is_flat(mesh: Mesh, normals: Float64) -> bool:
    """Tell whether a mesh has no curvature: each triangle has the same normal at all of its corners."""
    return bool(np.ptp(normals[mesh.faces], axis=1).max() < _BENT)


def juts_out(mesh: Mesh, normals: Float64) -> bool:
    """Tell whether hard edges jut out: at a place with several normals, the triangles fall away from their mean."""
    place, count = place_of(mesh.vertices), len(mesh.vertices)
    means = unit_or_up(summed(place, normals, count))[place]
    corner = mesh.vertices.astype(np.float64)[mesh.faces]
    into = np.repeat(corner.mean(axis=1, keepdims=True), 3, axis=1) - corner
    ways = unit_or_up(summed(mesh.faces.ravel(), unit_or_up(into.reshape(-1, 3)), count))
    turned = (normals * means).sum(axis=1) < _HARD
    return bool((turned & ((ways * means).sum(axis=1) < _BELOW)).any())


def vertex_frames(mesh: Mesh, tiles: tuple[int, int]) -> VertexFrames:
    """Return frames and quadrics of all vertices of a mesh with uv."""
    vertices = mesh.vertices.astype(np.float64)
    normals = np.asarray(mesh.normals if mesh.normals is not None else mesh.smooth_normals, np.float64)
    uv = np.asarray(mesh.uv, np.float64) * tiles
    gradients = fitted_gradients(vertices, mesh.faces, normals, uv)
    quadrics, planar = fitted_quadrics(vertices, mesh.faces, normals, gradients[:, 0])
    return VertexFrames(normals, gradients, quadrics, planar)


def fitted_gradients(vertices: Float64, faces: NDArray[np.int32], normals: Float64, uv: Float64) -> Float64:
    """(N, 2, 3) gradients of u and v in the tangent planes: least squares over the triangles' edges at each vertex."""
    x_axis = any_tangent(normals)
    y_axis = np.cross(normals, x_axis)
    usable = uv_gradients(vertices[faces], uv[faces])[1]
    corner = faces[usable]
    sums = np.zeros((len(vertices), 7))  # xx, xy, yy, and x and y times the change of u and of v
    for k in range(3):
        for other in ((k + 1) % 3, (k + 2) % 3):
            here, there = corner[:, k], corner[:, other]
            away, change = vertices[there] - vertices[here], uv[there] - uv[here]
            x, y = (np.einsum("nc,nc->n", away, axes[here]) for axes in (x_axis, y_axis))
            terms = (x * x, x * y, y * y, x * change[:, 0], y * change[:, 0], x * change[:, 1], y * change[:, 1])
            for column, values in enumerate(terms):
                sums[:, column] += np.bincount(here, values, len(vertices))
    xx, xy, yy = sums[:, 0], sums[:, 1], sums[:, 2]
    determinant = xx * yy - xy * xy
    solved = determinant > _SINGULAR * xx * yy
    divisor = np.where(solved, determinant, 1.0)
    made = np.zeros((len(vertices), 2, 3))
    for k in range(2):
        xu, yu = sums[:, 3 + 2 * k], sums[:, 4 + 2 * k]
        along_x, along_y = (yy * xu - xy * yu) / divisor, (xx * yu - xy * xu) / divisor
        made[:, k] = along_x[:, None] * x_axis + along_y[:, None] * y_axis
    return np.where(solved[:, None, None], made, 0.0)


def fitted_quadrics(
    vertices: Float64, faces: NDArray[np.int32], normals: Float64, along_x: Float64
) -> tuple[Float64, NDArray[np.bool_]]:
    """Least-squares fit of a, b and c to the neighbours of each vertex (equation 2), across seams of uv, too.

    Hard edges, where vertices at one place have several normals, separate the neighbours: each side is fitted by
    itself. If the neighbours do not determine all three coefficients, as at corners, the smallest quadric that fits is
    taken. Its size is measured in coordinates in which the neighbours are spread evenly, so that uv does not matter.

    The unit `normals` are z; `along_x`, (N, 3), lies in the tangent plane and has any length. Returns `quadrics` and
    `planar` of `VertexFrames`.
    """
    place = place_and_way(vertices, normals)
    count = int(place.max()) + 1
    first = np.zeros(count, np.int64)
    first[place] = np.arange(len(vertices))  # any vertex at the place
    # The neighbours of each place, each listed once.
    ends = place[faces]
    pairs = np.unique([ends[:, i] * count + ends[:, j] for i in range(3) for j in range(3) if i != j])
    there, other = np.divmod(pairs, count)
    there, other = there[there != other], other[there != other]
    start = np.searchsorted(there, np.arange(count + 1))
    neighbours = np.diff(start)[place]
    owner = np.repeat(np.arange(len(vertices)), neighbours)
    offset = np.arange(len(owner)) - np.repeat(np.cumsum(neighbours) - neighbours, neighbours)
    away = vertices[first[other[start[place[owner]] + offset]]] - vertices[owner]

    x_axis = unit(along_x, any_tangent(normals))
    axes = x_axis, np.cross(normals, x_axis), normals
    x, y, z = (np.einsum("nc,nc->n", away, axis[owner]) for axis in axes)
    quadrics, solved = _fitted_forms(owner, x, y, z, len(vertices))
    return quadrics, ~solved


def _fitted_forms(
    owner: NDArray[np.int64], x: Float64, y: Float64, z: Float64, count: int
) -> tuple[Float64, NDArray[np.bool_]]:
    """(count, 3) a, b and c that come closest to z at each owner's (x, y), and whether its points determine them."""
    # Positions are in units of the neighbourhood's size, so that fourth powers stay within range.
    size = np.zeros(count)
    np.maximum.at(size, owner, np.hypot(x, y))
    scale = np.maximum(size, 1e-300)
    x, y = x / scale[owner], y / scale[owner]
    # The fit uses coordinates in which the neighbours are spread evenly, so that long triangles determine as much.
    xx, xy, yy = (np.bincount(owner, terms, count) for terms in (x * x, x * y, y * y))
    solved = 4 * (xx * yy - xy * xy) > _SINGULAR * (xx + yy) ** 2
    xx, xy, yy = np.where(solved, xx, 1.0), np.where(solved, xy, 0.0), np.where(solved, yy, 1.0)
    along, skew = 1 / np.sqrt(xx), xy / xx
    across = 1 / np.sqrt(yy - xy * skew)
    forms = _least_forms(owner, along[owner] * x, across[owner] * (y - skew[owner] * x), z, count)
    whiten = np.zeros((count, 2, 2))
    whiten[:, 0, 0], whiten[:, 1, 0], whiten[:, 1, 1] = along, -across * skew, across
    forms = whiten.transpose(0, 2, 1) @ forms @ whiten / np.where(solved, scale**2, 1.0)[:, None, None]
    made = np.stack([forms[:, 0, 0], forms[:, 1, 1], 2 * forms[:, 0, 1]], axis=1)
    return np.where(solved[:, None], made, 0.0), solved


def _least_forms(owner: NDArray[np.int64], x: Float64, y: Float64, z: Float64, count: int) -> Float64:
    """(count, 2, 2) quadratic forms of (x, y) closest to z for each owner; the smallest of several equally close."""
    basis = np.stack([x * x, y * y, np.sqrt(2) * x * y], axis=1)  # the norm of the coefficients is the form's norm
    normal, right = np.zeros((count, 3, 3)), np.zeros((count, 3))
    for i in range(3):
        right[:, i] = np.bincount(owner, basis[:, i] * z, count)
        for j in range(3):
            normal[:, i, j] = np.bincount(owner, basis[:, i] * basis[:, j], count)
    values, axes = np.linalg.eigh(normal)
    determined = values > _SINGULAR * np.maximum(values[:, 2:], 1e-300)
    parts = np.einsum("nij,ni->nj", axes, right) * determined / np.where(determined, values, 1.0)
    a, b, c = np.einsum("nij,nj->in", axes, parts)
    return np.stack([a, c / np.sqrt(2), c / np.sqrt(2), b], axis=1).reshape(-1, 2, 2)
