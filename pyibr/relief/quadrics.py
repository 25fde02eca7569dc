"""What relief mapping knows of a mesh at its vertices: how uv runs, and how the surface bends (section 3).

Around each vertex the mesh is approximated by z = a x^2 + b y^2 in the vertex's tangent frame: z along the normal, x
along the direction in which u grows fastest, y at right angles to both.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pyibr._check import Float64
from pyibr.mesh import Mesh
from pyibr.tangents import unit, uv_gradients

_SINGULAR = 1e-6  # of the normal equations' diagonal: less determinant than that is rounding


@dataclass(frozen=True)
class VertexFrames:
    """A mesh's vertices for relief mapping.

    Attributes
    ----------
    normals : (N, 3) float64
        Unit length.
    gradients : (N, 2, 3) float64
        Of u and v (tiled), in the tangent plane, per scene unit: 1 / length is a tile's size there. Zero where no
        triangle with usable uv meets the vertex.
    quadrics : (N, 2) float64
        a and b, per scene unit.
    planar : (N,) bool
        Where no quadric could be fitted: fewer than two neighbours, or neighbours that determine none. a = b = 0.
    """

    normals: Float64
    gradients: Float64
    quadrics: Float64
    planar: NDArray[np.bool_]


def vertex_frames(mesh: Mesh, tiles: tuple[int, int]) -> VertexFrames:
    """Frames and quadrics of all vertices of a mesh with uv."""
    vertices = mesh.vertices.astype(np.float64)
    normals = np.asarray(mesh.normals if mesh.normals is not None else mesh.smooth_normals, np.float64)
    uv = np.asarray(mesh.uv, np.float64) * tiles
    per_face, usable = uv_gradients(vertices[mesh.faces], uv[mesh.faces])
    sides = vertices[mesh.faces[:, 1:]] - vertices[mesh.faces[:, :1]]
    area = np.where(usable, np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1), 0.0)
    corner, weight = mesh.faces.ravel(), np.repeat(area, 3)
    total = np.maximum(np.bincount(corner, weight, len(vertices)), 1e-300)
    gradients = np.zeros((len(vertices), 2, 3))
    for k in range(2):
        for axis in range(3):
            values = weight * np.repeat(per_face[:, k, axis], 3)
            gradients[:, k, axis] = np.bincount(corner, values, len(vertices)) / total
    gradients -= np.einsum("nkc,nc->nk", gradients, normals)[..., None] * normals[:, None]
    quadrics, planar = fitted_quadrics(vertices, mesh.faces, normals, gradients[:, 0])
    return VertexFrames(normals, gradients, quadrics, planar)


def fitted_quadrics(
    vertices: Float64, faces: NDArray[np.int32], normals: Float64, along_x: Float64
) -> tuple[Float64, NDArray[np.bool_]]:
    """Least-squares fit of a and b to the neighbours of each vertex (equation 2), across seams of uv, too.

    Parameters
    ----------
    vertices : (N, 3) float64
    faces : (M, 3) int32
    normals : (N, 3) float64
        Unit length: z.
    along_x : (N, 3) float64
        In the tangent plane, of any length.

    Returns
    -------
    quadrics : (N, 2) float64
    planar : (N,) bool
        Where the neighbours determine no quadric; a = b = 0.
    """
    place = np.unique(vertices, axis=0, return_inverse=True)[1].reshape(-1)
    count = int(place.max()) + 1
    first = np.zeros(count, np.int64)
    first[place] = np.arange(len(vertices))  # any vertex at the place
    # Each place's neighbours, once each.
    ends = place[faces]
    pairs = np.concatenate([ends[:, [i, j]] for i in range(3) for j in range(3) if i != j])
    pairs = np.unique(pairs[pairs[:, 0] != pairs[:, 1]], axis=0)
    start = np.searchsorted(pairs[:, 0], np.arange(count + 1))
    neighbours = np.diff(start)[place]
    owner = np.repeat(np.arange(len(vertices)), neighbours)
    offset = np.arange(len(owner)) - np.repeat(np.cumsum(neighbours) - neighbours, neighbours)
    away = vertices[first[pairs[start[place[owner]] + offset, 1]]] - vertices[owner]

    x_axis = unit(along_x, _any_tangent(normals))
    y_axis = np.cross(normals, x_axis)
    # At the scale of the neighbourhood, so that fourth powers stay within range.
    size = np.zeros(len(vertices))
    np.maximum.at(size, owner, np.linalg.norm(away, axis=1))
    away /= np.maximum(size, 1e-300)[owner, None]
    x, y, z = (np.einsum("nc,nc->n", away, axes[owner]) for axes in (x_axis, y_axis, normals))

    def sums(values: Float64) -> Float64:
        return np.bincount(owner, values, len(vertices))

    xx, xy, yy = sums(x**4), sums(x * x * y * y), sums(y**4)
    xz, yz = sums(x * x * z), sums(y * y * z)
    determinant = xx * yy - xy * xy
    solved = (neighbours >= 2) & (determinant > _SINGULAR * xx * yy) & (size > 0)
    divisor = np.where(solved, determinant * size, 1.0)
    quadrics = np.stack([yy * xz - xy * yz, xx * yz - xy * xz], axis=1) / divisor[:, None]
    return np.where(solved[:, None], quadrics, 0.0), ~solved


def _any_tangent(normals: Float64) -> Float64:
    """Unit vectors at right angles to the normals."""
    least = np.eye(3)[np.abs(normals).argmin(axis=1)]
    return unit(np.cross(normals, least), np.array([1.0, 0.0, 0.0]))
