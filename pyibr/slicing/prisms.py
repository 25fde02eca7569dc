"""The displacement volume of a mesh: each triangle's prism along its corners' normals."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pyibr.core.checks import Float64
from pyibr.meshes.mesh import Mesh
from pyibr.meshes.normals import any_tangent, place_of, unit, uv_gradients

Float32 = NDArray[np.float32]


_AGAINST = 1e-3  # normals at a place cancel out if the length of their mean is below this
_FLAT = 1e-6  # height over longest side below which float32 treats a triangle as a line


@dataclass(frozen=True)
class Volume:
    """A displacement volume: a prism for each triangle, with walls shared by neighbours."""

    points: Float32  # (V, 3) in the world: the base's vertices, then their copies moved by `scale`
    uv: Float32  # (V / 2, 2) tiled, of the base's vertices
    corners: NDArray[np.int32]  # (T, 6) of the prisms: the triangle's, then the corners above them
    frames: Float32  # (T, 3, 3) slicing directions a (normal), b (along u), c (along v): unit length, at right angles
    tilts: Float32  # (T, 3, 3) vectors from each corner to the corner above it, as in kernels/slicing/surface.cl
    ends: NDArray[np.int32]  # (T,) 1: a side of the triangle is a border of the mesh
    gradients: Float32  # (T, 2, 3) of u and v (tiled), in the world
    normals: Float32  # (V / 2, 3) of the base's vertices, unit length

    @cached_property
    def bounds(self) -> tuple[Float32, Float32]:
        """(low, high), each (3,): bounds of the points that prisms use."""
        used = self.points[self.corners.ravel()] if len(self.corners) else self.points
        return used.min(axis=0), used.max(axis=0)


def extruded(base: Mesh, scale: float, tiles: tuple[int, int]) -> Volume:
    """Return the volume between a mesh with uv and its copy moved by `scale` along normals, one for each place."""
    vertices = base.vertices.astype(np.float64)
    faces = _with_area(vertices, base.faces)
    normals = np.asarray(base.normals if base.normals is not None else base.smooth_normals, np.float64)
    uv = np.asarray(base.uv, np.float64) * tiles
    ways = scale * _one_at_each_place(base, normals, faces)
    points = np.concatenate([vertices, vertices + ways])
    frames, gradients = _frames(vertices[faces], normals[faces], uv[faces])
    tilts = _tilts(vertices[faces], ways[faces], scale * frames[:, 0])
    arrays = (points, uv, frames, tilts, gradients, normals)
    single = [np.ascontiguousarray(values, np.float32) for values in arrays]
    corners = np.ascontiguousarray(np.concatenate([faces, faces + len(vertices)], axis=1), np.int32)
    ends = _at_borders(place_of(base.vertices)[faces])
    return Volume(single[0], single[1], corners, single[2], single[3], ends, single[4], single[5])


def _one_at_each_place(base: Mesh, normals: Float64, faces: NDArray[np.int32]) -> Float64:
    """Return normals along which vertices at one place stay together: the mean where several normals differ.

    Normals that cancel out, as on two sheets back to back, are not averaged.
    """
    place = place_of(base.vertices)
    places, used = len(place), np.unique(faces)
    kinds = np.unique(np.column_stack([place, normals])[used], axis=0)
    of_kind = kinds[:, 0].astype(np.int64)
    count = np.bincount(of_kind, minlength=places)
    sums = np.stack([np.bincount(of_kind, kinds[:, axis], places) for axis in (1, 2, 3)], axis=1)
    length = np.linalg.norm(sums, axis=1)
    mean = sums / np.where(length > 0, length, 1)[:, None]
    several = (count > 1) & (length > _AGAINST * count)
    return np.where(several[place, None], mean[place], normals)


def _with_area(vertices: Float64, faces: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the triangles with an area: degenerate triangles have no volume above them."""
    sides = vertices[faces[:, 1:]] - vertices[faces[:, :1]]
    area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    longest = np.maximum(np.linalg.norm(sides, axis=2).max(axis=1), np.linalg.norm(sides[:, 1] - sides[:, 0], axis=1))
    return faces[area > _FLAT * longest**2]


def _at_borders(faces: NDArray[np.int64]) -> NDArray[np.int32]:
    """Return 1 for triangles with a side that no other triangle has; `faces`: (T, 3) places of their corners."""
    sides = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    _, kind, count = np.unique(sides, axis=0, return_inverse=True, return_counts=True)
    return (count[kind.ravel()] == 1).reshape(-1, 3).any(axis=1).astype(np.int32)


def _tilts(corners: Float64, ways: Float64, across: Float64) -> Float64:
    """Return `ways` as multiples of a triangle's sides, from its first corner to the other two, and of `across`."""
    sides = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], across], axis=2)
    return np.asarray(np.linalg.solve(sides, ways.transpose(0, 2, 1)), np.float64).transpose(0, 2, 1)


def _frames(corners: Float64, normals: Float64, uv: Float64) -> tuple[Float64, Float64]:
    """Return slicing directions and gradients of u and v for each triangle; arbitrary if it or its uv has no area."""
    sides = corners[:, 1:] - corners[:, :1]
    a = unit(np.cross(sides[:, 0], sides[:, 1]), np.array([0.0, 0.0, 1.0]))
    a *= np.where((a * normals.sum(axis=1)).sum(axis=1, keepdims=True) < 0, -1.0, 1.0)
    gradients = uv_gradients(corners, uv)[0]
    b = unit(gradients[:, 0], any_tangent(a))
    c = np.cross(a, b)
    c *= np.where((c * gradients[:, 1]).sum(axis=1, keepdims=True) < 0, -1.0, 1.0)
    return np.stack([a, b, c], axis=1), gradients
