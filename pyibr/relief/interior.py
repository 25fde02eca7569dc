"""Eyes below the base of a relief, within its layer: where they are, and the window through which their rays start.

From there no front of the base lies around the eye for rays to enter. So a triangle is put right before it, as large as
the picture, and rays enter by that: at the eye's depth, in the frame of the surface that runs through the eye at the
same distance below the base.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera
from pyibr.core.checks import Float64
from pyibr.meshes.heights import Float32
from pyibr.meshes.tangents import unit
from pyibr.opencl.headers import constant

_NO_WEIGHT = 1e-9  # of a corner: the foot is on the side opposite
_SAME_WAY = 1e-7  # of the relief's depth: feet that are equally near
_NO_GAP = 1e-6  # of the greatest coordinate: vertices that are one, but for rounding
_FOCUS = 0.1  # of the radius of curvature: surfaces below the base bend no more than there
_LEAST_DEPTH = 1e-6  # of the relief's: of rays that start below the base


@dataclass(frozen=True)
class InteriorPoint:
    """Frame and depth of a point within the relief, interpolated from the base's vertices.

    Attributes
    ----------
    uv : (2,) float64
        Tiles included.
    normal : (3,) float64
    gradients : (2, 3) float64
        Of u and v.
    bending : (3, 3) float64
        Second derivatives along the normal of the quadric, over tangents in the world.
    depth : float
        Below the base, 1 at the bottom of the relief.
    """

    uv: Float64
    normal: Float64
    gradients: Float64
    bending: Float64
    depth: float

    @property
    def quadric(self) -> Float64:
        """(3,) a, b and c: x along the gradient of u."""
        x = unit(self.gradients[0], np.zeros(3))
        y = np.cross(self.normal, x)
        return np.array([0.5 * x @ self.bending @ x, 0.5 * y @ self.bending @ y, x @ self.bending @ y])


class Interior:
    """A relief's base, to find points within the relief below it.

    Parameters
    ----------
    vertices : (N, 3)
    faces : (M, 3) int32
    rows : (N, VERTEX_FLOATS) float32
        What kernels know of each vertex (kernels/relief/entry.h).
    scale : float
        The relief's depth.
    bends : bool
        The relief follows the vertices' quadrics.
    """

    def __init__(self, vertices: Float32, faces: NDArray[np.int32], rows: Float32, scale: float, bends: bool) -> None:
        self._vertices, self._faces, self._rows = vertices, faces, rows
        self._scale, self._bends = scale, bends

    @cached_property
    def _boxes(self) -> tuple[Float64, Float64]:
        """Low and high corners, (3, M) each, of what is within the relief's depth of each triangle."""
        corners = self._vertices.astype(np.float64)[self._faces]
        low, high = corners.min(axis=1) - self._scale, corners.max(axis=1) + self._scale
        return np.ascontiguousarray(low.T), np.ascontiguousarray(high.T)

    @cached_property
    def _on_border(self) -> NDArray[np.bool_]:
        """(M, 3): does no other triangle have the side opposite to the corner? Sides across seams of uv are one."""
        extent = float(np.abs(self._vertices).max(initial=1e-30))
        rounded = np.rint(self._vertices.astype(np.float64) / (_NO_GAP * extent))
        place = np.unique(rounded, axis=0, return_inverse=True)[1].reshape(-1)
        ends = place[self._faces[:, [[1, 2], [2, 0], [0, 1]]]]
        number, count = np.unique(
            np.sort(ends, axis=2).reshape(-1, 2), axis=0, return_inverse=True, return_counts=True
        )[1:]
        return (count == 1)[number.reshape(-1, 3)]

    def interior_point(self, eye: Float64) -> InteriorPoint | None:
        """Find the base above a point that lies less than the relief's depth below it; None for all others.

        The base's nearest point tells. Where that is on an open border, the point is beside the relief.
        """
        low, high = self._boxes
        near = np.flatnonzero((low[0] <= eye[0]) & (eye[0] <= high[0]))
        for axis in (1, 2):
            near = near[(low[axis, near] <= eye[axis]) & (eye[axis] <= high[axis, near])]
        if not len(near):
            return None
        corners = self._vertices.astype(np.float64)[self._faces[near]]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        solid = (across != 0).any(axis=1)
        near, corners, across = near[solid], corners[solid], across[solid]
        weights = nearest_weights(corners, across, eye)
        away = eye - np.einsum("tk,tkc->tc", weights, corners)
        distance = np.linalg.norm(away, axis=1)
        feet = np.flatnonzero(distance <= distance.min(initial=np.inf) + _SAME_WAY * self._scale)
        if not len(feet) or ((weights[feet] <= _NO_WEIGHT) & self._on_border[near[feet]]).any():
            return None
        # Of triangles that share the foot, the one that is the most square to the way there tells on which side it is.
        height = np.einsum("tc,tc->t", away[feet], unit(across[feet], np.zeros(3)))
        foot = feet[np.abs(height).argmax()]
        if away[foot] @ across[foot] >= 0:
            return None
        return self._place(weights[foot] @ self._rows[self._faces[near[foot]]].astype(np.float64), away[foot])

    def _place(self, row: Float64, away: Float64) -> InteriorPoint | None:
        """The place of a point `away` from the base's, of which `row` tells."""
        if not np.isfinite(row).all():
            return None
        normal, along_u, along_v = unit(row[2:5], np.zeros(3)), row[5:8], row[8:11]
        x = unit(along_u, np.zeros(3))
        axes = np.stack([x, np.cross(normal, x)], axis=1)
        bending = np.array([[2 * row[11], row[13]], [row[13], 2 * row[12]]]) * self._bends
        aside = axes.T @ away
        depth = float(0.5 * aside @ bending @ aside - away @ normal)
        if not 0 < depth < self._scale:
            return None
        # A surface that bends by k bends by k / (1 + depth k) there, and what lies on it is as much closer together.
        curvatures, directions = np.linalg.eigh(bending)
        closer = 1 / np.maximum(1 + depth * curvatures, _FOCUS)
        principal = axes @ directions
        squeeze = np.eye(3) + principal @ np.diag(closer - 1) @ principal.T
        moved = unit(normal - axes @ bending @ aside, normal)
        gradients = np.stack([along_u, along_v])
        uv = row[:2] + gradients @ away
        gradients = gradients @ squeeze
        gradients -= np.outer(gradients @ moved, moved)
        below = principal @ np.diag(curvatures * closer) @ principal.T
        return InteriorPoint(uv, moved, gradients, below, depth / self._scale)


def nearest_weights(corners: Float64, across: Float64, point: Float64) -> Float64:
    """(T, 3) weights of the corners (T, 3, 3) at triangles' nearest points to a point; across: (T, 3) their normals."""
    square = np.einsum("tc,tc->t", across, across)
    to_corners = corners - point
    inside = np.stack(
        [
            np.einsum("tc,tc->t", np.cross(to_corners[:, (k + 1) % 3], to_corners[:, (k + 2) % 3]), across) / square
            for k in range(3)
        ],
        axis=1,
    )
    best, least = inside, np.where((inside >= 0).all(axis=1), -1.0, np.inf)
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        side = corners[:, j] - corners[:, i]
        along = -np.einsum("tc,tc->t", to_corners[:, i], side) / np.maximum(np.einsum("tc,tc->t", side, side), 1e-300)
        weights = np.zeros_like(best)
        weights[:, j] = along.clip(0, 1)
        weights[:, i] = 1 - weights[:, j]
        distance = np.linalg.norm(np.einsum("tk,tkc->tc", weights, to_corners), axis=1)
        nearer = distance < least
        best, least = np.where(nearer[:, None], weights, best), np.where(nearer, distance, least)
    return best


def window(place: InteriorPoint, camera: Camera, distance: float, scale: float) -> tuple[Float32, Float32]:
    """A triangle `distance` before a camera's centre at a place, which covers its picture: pixels and vertices.

    Returns
    -------
    projected : (3, 4) float32
        Homogeneous pixel space; counter-clockwise, as fronts are.
    rows : (3, VERTEX_FLOATS of kernels/relief/entry.h) float32
        What kernels know of each vertex.
    """
    width, height = camera.size
    pixels = np.array([[-1, -1], [-1, 2 * height + 1], [2 * width + 1, -1]], np.float64)
    offset = camera.unproject(pixels, np.full(3, distance)) - camera.center
    uv = place.uv + offset @ place.gradients.T
    depth = np.maximum(place.depth - offset @ place.normal / scale, _LEAST_DEPTH)
    frame = np.concatenate([place.normal, place.gradients.ravel(), place.quadric])
    values = np.column_stack([uv, np.broadcast_to(frame, (3, len(frame))), depth])
    rows = np.zeros((3, int(constant("relief/entry.h", "VERTEX_FLOATS"))), np.float32)
    with np.errstate(over="ignore"):  # rays of numbers that are not finite are not searched
        rows[:, : values.shape[1]] = values
    projected = np.column_stack([pixels * distance, np.full(3, distance), np.ones(3)])
    return projected.astype(np.float32), rows
