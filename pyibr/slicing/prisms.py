"""The displacement volume of a mesh: each triangle's prism along its corners' normals, as tetrahedra."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pyibr.core.checks import Float64
from pyibr.meshes.mesh import Mesh
from pyibr.meshes.normals import place_of
from pyibr.meshes.tangents import unit, uv_gradients

Float32 = NDArray[np.float32]


_AGAINST = 1e-3  # of the length that normals of one direction would have: what is shorter points nowhere
_FLAT = 1e-6  # of its longest side: the height of a triangle that float32 takes for a line


@dataclass(frozen=True)
class Volume:
    """A displacement volume: each triangle's prism as three tetrahedra, walls shared by neighbours.

    Attributes
    ----------
    points : (V, 3) float32
        Corners, in the world: the base's, then those `scale` above them.
    places : (V, 3) float32
        u and v (tiled) and height of each.
    corners : (3 T, 4) int32
        Of the tetrahedra, three in a row for each triangle.
    frames : (T, 3, 3) float32
        The slicing directions a (the normal), b (along u) and c (along v): unit length, at right angles.
    gradients : (T, 2, 3) float32
        Of u and v (tiled), in the world.
    normals : (V / 2, 3) float32
        Of the base's vertices, unit length.
    bounds : low (3,), high (3,)
    """

    points: Float32
    places: Float32
    corners: NDArray[np.int32]
    frames: Float32
    gradients: Float32
    normals: Float32

    @cached_property
    def bounds(self) -> tuple[Float32, Float32]:
        """Of the points that tetrahedra use."""
        used = self.points[self.corners.ravel()] if len(self.corners) else self.points
        return used.min(axis=0), used.max(axis=0)


def extruded(base: Mesh, scale: float, tiles: tuple[int, int]) -> Volume:
    """The volume between a mesh with uv and the same `scale` farther along its normals, one at each place."""
    vertices = base.vertices.astype(np.float64)
    faces = _with_area(vertices, base.faces)
    normals = np.asarray(base.normals if base.normals is not None else base.smooth_normals, np.float64)
    uv = np.asarray(base.uv, np.float64) * tiles
    count = len(vertices)
    points = np.concatenate([vertices, vertices + scale * _one_at_each_place(base, normals, faces)])
    places = np.column_stack([np.concatenate([uv, uv]), np.repeat([0.0, 1.0], count)])

    # The diagonal of a wall goes from the corner of lower rank up: neighbours agree, across seams of uv, too.
    rank = place_of(base.vertices)
    order = np.argsort(rank[faces], axis=1, kind="stable")
    i, j, k = np.take_along_axis(faces, order, axis=1).T
    top_i, top_j, top_k = i + count, j + count, k + count
    corners = np.stack([i, j, k, top_k, i, j, top_j, top_k, i, top_i, top_j, top_k], axis=1).reshape(-1, 4)

    frames, gradients = _frames(vertices[faces], normals[faces], uv[faces])
    single = [np.ascontiguousarray(values, np.float32) for values in (points, places, frames, gradients, normals)]
    return Volume(single[0], single[1], np.ascontiguousarray(corners, np.int32), single[2], single[3], single[4])


def _one_at_each_place(base: Mesh, normals: Float64, faces: NDArray[np.int32]) -> Float64:
    """Normals along which vertices of faces at one place stay together: where several differ, their mean.

    Where they cancel out, as on two sheets back to back, each keeps its own.
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
    """The triangles that are more than a line: others have no volume above them."""
    sides = vertices[faces[:, 1:]] - vertices[faces[:, :1]]
    area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    longest = np.maximum(np.linalg.norm(sides, axis=2).max(axis=1), np.linalg.norm(sides[:, 1] - sides[:, 0], axis=1))
    return faces[area > _FLAT * longest**2]


def _frames(corners: Float64, normals: Float64, uv: Float64) -> tuple[Float64, Float64]:
    """Slicing directions and gradients of u and v, per triangle; any directions where uv or the triangle is flat."""
    sides = corners[:, 1:] - corners[:, :1]
    a = unit(np.cross(sides[:, 0], sides[:, 1]), np.array([0.0, 0.0, 1.0]))
    a *= np.where((a * normals.sum(axis=1)).sum(axis=1, keepdims=True) < 0, -1.0, 1.0)
    gradients = uv_gradients(corners, uv)[0]
    least = np.eye(3)[np.abs(a).argmin(axis=1)]
    b = unit(gradients[:, 0], unit(np.cross(a, least), np.array([1.0, 0.0, 0.0])))
    c = np.cross(a, b)
    c *= np.where((c * gradients[:, 1]).sum(axis=1, keepdims=True) < 0, -1.0, 1.0)
    return np.stack([a, b, c], axis=1), gradients
