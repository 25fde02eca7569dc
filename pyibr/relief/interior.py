"""Search for the point of a relief's base above an eye that lies within the relief.

Rays from such an eye start in the relief: around the eye, they meet no front of the base through which they can enter.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pyibr.core.checks import Float64
from pyibr.meshes.heights import Float32

_NEWTON_STEPS = 4
_CROSSINGS_MAX = 64  # steps from triangle to triangle in the search for the triangle above a point
_OUTSIDE = -1e-6  # a point is inside a triangle if no barycentric weight is below this; not 0, to allow for rounding


@dataclass(frozen=True)
class InteriorPoint:
    """A point within the relief, below its base."""

    triangle: int  # index of the drawn mesh's triangle above the point
    uv: Float64  # (2,) tiles included
    depth: float  # below the base, 1 at the bottom of the relief


class Interior:
    """A relief's base, for finding points within the relief below it.

    Its arrays are the drawn mesh's vertices (N, 3), uv (N, 2), tiles included, and faces (M, 3); and `offsets` and
    `beside` of `ReliefSurface`.
    """

    def __init__(
        self,
        vertices: Float32,
        offsets: Float64,
        uv: Float64,
        faces: NDArray[np.int32],
        beside: NDArray[np.int32],
    ) -> None:
        self._vertices, self._offsets, self._uv = vertices.astype(np.float64), offsets, uv
        self._faces, self._beside = faces, beside

    @cached_property
    def _boxes(self) -> tuple[Float64, Float64]:
        """Low and high corners, (3, M) each, of the box around the relief below each triangle."""
        corners = np.concatenate([self._vertices[self._faces], (self._vertices - self._offsets)[self._faces]], axis=1)
        low, high = corners.min(axis=1), corners.max(axis=1)
        return np.ascontiguousarray(low.T), np.ascontiguousarray(high.T)

    def interior_point(self, eye: Float64) -> InteriorPoint | None:
        """Find the point of the base above a world point within the relief; None for all other points.

        The search for the triangle above the point starts at the nearest triangle (kernels/relief/walk.h).
        """
        low, high = self._boxes
        near = np.flatnonzero((low[0] <= eye[0]) & (eye[0] <= high[0]))
        for axis in (1, 2):
            near = near[(low[axis, near] <= eye[axis]) & (eye[axis] <= high[axis, near])]
        corners = self._vertices[self._faces[near]]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        solid = (across != 0).any(axis=1)
        near, corners, across = near[solid], corners[solid], across[solid]
        if not len(near):
            return None
        away = eye - np.einsum("tk,tkc->tc", nearest_weights(corners, across, eye), corners)
        triangle = int(near[np.linalg.norm(away, axis=1).argmin()])
        for _ in range(_CROSSINGS_MAX):
            weights, depth = self._place(triangle, eye)
            if not np.isfinite(depth):
                return None
            if weights.min() >= _OUTSIDE:
                uv = weights @ self._uv[self._faces[triangle]]
                return InteriorPoint(triangle, uv, depth) if 0 < depth < 1 else None
            side = int(self._beside[triangle, weights.argmin()])
            if side < 0:
                return None
            triangle = side // 3
        return None

    def _place(self, triangle: int, point: Float64) -> tuple[Float64, float]:
        """Return the weights (3,) of the corners, and the depth, of a point in the prism below a triangle."""
        corners, offsets = (rows[self._faces[triangle]] for rows in (self._vertices, self._offsets))
        weights, depth = np.full(3, 1 / 3), 0.0
        for _ in range(_NEWTON_STEPS):
            here = corners - depth * offsets
            matrix = np.column_stack([here[1] - here[0], here[2] - here[0], -weights @ offsets])
            try:
                second, third, deeper = np.linalg.solve(matrix, point - weights @ here)
            except np.linalg.LinAlgError:
                return weights, np.nan
            weights, depth = weights + np.array([-second - third, second, third]), depth + float(deeper)
        return weights, depth


def nearest_weights(corners: Float64, across: Float64, point: Float64) -> Float64:
    """(T, 3) weights of the corners (T, 3, 3) at the triangles' points nearest to a point; across: (T, 3) normals."""
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
