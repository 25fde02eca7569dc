"""Maps between the pixel spaces of two cameras: the warp equation (kernels/lib/pixelspace.h).

A point is homogeneous (U, V, W, Q): pixel (U/W, V/W), nearness Q/W, which is 1/z for a perspective camera and -z for
an orthographic one. One 4x4 matrix carries it from the source to the target; its last column is the epipole.
"""

from __future__ import annotations

import functools
import itertools
import math
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from pyibr.core.camera import Camera
from pyibr.core.checks import Float64

_GRID = [part.ravel() for part in np.meshgrid(np.linspace(0.1, 0.9, 5), np.linspace(0.1, 0.9, 5))]

_ROUNDING = 1e-10  # relative error of products of a few matrices in float64
_ROUNDING_FAR = 1e-15  # error of positions at a distance of 1 from the world's origin

_FAR = 1e9  # scene units: the greatest length that cameras allow

NO_PARALLAX = 1e-3
"""In pixels: cameras with less parallax count as differing by a rotation (or a zoom) alone."""


@dataclass(frozen=True)
class Rectangle:
    """Pixels low_x ... high_x - 1, low_y ... high_y - 1."""

    low_x: int
    high_x: int
    low_y: int
    high_y: int

    @property
    def empty(self) -> bool:
        """Tell whether the rectangle holds no pixel."""
        return self.low_x >= self.high_x or self.low_y >= self.high_y


def pitch(width: int) -> int:
    """Row length of nearness images: whole packets, with room past the last pixel or for a ring, not a power of two.

    If the row length is a power of two, a column falls into few lines of the cache, and column-wise walks miss it.
    """
    padded = (-(-(width + 2) // 16) + 1) * 16
    return padded + 16 if padded % 256 == 0 else padded


def longer_side(camera: Camera) -> float:
    """Longer side of an orthographic camera's field of view, in scene units: the scale of its depths."""
    return float(max(camera.width / camera.K[0, 0], camera.height / camera.K[1, 1]))


def frustum(camera: Camera) -> Float64:
    """(5, 4) planes of a camera's view in the world: a x + b y + c z + d >= 0 inside, unit normals."""
    (width, height), (u, v, w, q) = camera.size, camera.pixel_matrix @ camera.camera_from_world
    before = w if camera.projection == "perspective" else -q
    sides = u + 0.5 * w, (width - 0.5) * w - u, v + 0.5 * w, (height - 0.5) * w - v
    planes = np.array([*sides, before])
    return planes / np.linalg.norm(planes[:, :3], axis=1, keepdims=True)


def pixel_size(camera: Camera, point: Float64) -> float:
    """Scene units that a pixel covers at a point in the world."""
    z = float(camera.camera_from_world[2, :3] @ point + camera.camera_from_world[2, 3])
    return (abs(z) if camera.projection == "perspective" else 1.0) / float(min(camera.K[0, 0], camera.K[1, 1]))


@dataclass(frozen=True, eq=False)
class CameraPair:
    """The map between two cameras, without the parts that depend on the source's samples; from `camera_pair`."""

    src: Camera
    """The source, whose samples have depth."""
    dst: Camera
    """The target."""

    @cached_property
    def dst_from_src(self) -> Float64:
        """(4, 4) float64."""
        return _pixels_from_pixels(self.dst, self.src)

    @cached_property
    def src_from_dst(self) -> Float64:
        """(4, 4) float64."""
        return _pixels_from_pixels(self.src, self.dst)

    @cached_property
    def aligned(self) -> bool:
        """Tell whether epipolar lines run along rows or columns of both images, as in stereo pairs and light fields."""
        ends = self.dst_from_src[:3, 3], self.src_from_dst[:3, 3]
        return all(np.count_nonzero(end) == 1 and end[2] == 0.0 for end in ends)

    @cached_property
    def off_samples(self) -> float:
        """Largest distance, in pixels, from aligned lines through the target's pixels to the source's samples."""
        ends = self.dst_from_src[:2, 3], self.src_from_dst[:2, 3]
        target_axis, source_axis = (int(np.argmin(end != 0)) for end in ends)
        pixels = np.zeros((3, self.dst.size[target_axis]))
        pixels[target_axis], pixels[2] = np.arange(pixels.shape[1]), 1.0
        rows = self.src_from_dst[[source_axis, 2], :3] @ pixels
        with np.errstate(divide="ignore", invalid="ignore"):
            across = rows[0] / rows[1]
            off = np.abs(across - np.rint(across))
        return float(np.where(np.isfinite(off), off, 0.5).max())  # lines at infinity pass through no samples

    @cached_property
    def corners(self) -> list[list[float]]:
        """(U, V, W) in the target for the source's corners at nearness 0; last, the change per unit of nearness."""
        last_x, last_y = self.src.width - 0.5, self.src.height - 0.5
        at_infinity = [(x, y, 1.0, 0.0) for x, y in itertools.product((-0.5, last_x), (-0.5, last_y))]
        return (self.dst_from_src[:3] @ np.array([*at_infinity, (0, 0, 0, 1)]).T).T.tolist()

    @cached_property
    def grid(self) -> tuple[Float64, Float64]:
        """Target positions of a grid of source pixels and their right and lower neighbours.

        (4, 3, 25) homogeneous at nearness 0, and (4, 1, 1) their change per unit of nearness.
        """
        x, y = (part * (size - 1) for part, size in zip(_GRID, self.src.size, strict=True))
        points = np.array([[x, x + 1, x], [y, y, y + 1], [np.ones_like(x)] * 3])
        return np.tensordot(self.dst_from_src[:, :3], points, 1), self.dst_from_src[:, 3, None, None]


@functools.lru_cache(maxsize=256)
def camera_pair(src: Camera, dst: Camera) -> CameraPair:
    """The pair, cached for repeated use of the same cameras."""
    return CameraPair(src, dst)


class Ranged(Protocol):
    """Samples with a range of nearness; reading the range may have to wait."""

    @property
    def low(self) -> float: ...
    @property
    def high(self) -> float: ...


@dataclass(frozen=True)
class PixelMap:
    """The map between two cameras, for the source's samples of a range of nearness."""

    pair: CameraPair
    samples: Ranged

    @cached_property
    def low(self) -> float:
        """Least nearness of the source's samples."""
        return self.samples.low

    @cached_property
    def high(self) -> float:
        """Greatest nearness of the source's samples."""
        return self.samples.high

    @property
    def epipole(self) -> Float64:
        """(3,) homogeneous pixel of the source's centre in the target; negative W: an antipode; 0: no epipole."""
        return self.pair.dst_from_src[:3, 3] if self.parallax >= NO_PARALLAX else np.zeros(3)

    @cached_property
    def parallax(self) -> float:
        """Largest motion of the source's corners in the target, in pixels, between two distant depths.

        For a perspective source, the depths are infinity and the nearest sample's. For an orthographic one, they are
        the farthest sample's, and one nearer than that by the longer side of the camera's field of view.
        """
        src = self.pair.src
        perspective = src.projection == "perspective"
        ends = (0.0, self.high) if perspective else (self.low, self.high + longer_side(src))
        largest = 0.0
        for (u0, v0, w0), (u1, v1, w1) in zip(*map(self._corners, ends), strict=True):
            if w0 <= 0 or w1 <= 0:
                return math.inf
            largest = max(largest, math.hypot(u0 / w0 - u1 / w1, v0 / w0 - v1 / w1))
        return largest

    @cached_property
    def most_motion(self) -> float:
        """Upper bound on the motion of any source position in the target, in pixels per unit of nearness."""
        b = self.pair.dst_from_src[:3, 3]
        points = [*self._corners(self.low), *self._corners(self.high)]
        least = min(w for _, _, w in points)
        if least <= 0:
            return math.inf
        return max(max(abs(b[0] - b[2] * u / w), abs(b[1] - b[2] * v / w)) for u, v, w in points) / least

    @cached_property
    def reach(self) -> Rectangle:
        """The target's pixels that the source's samples, or the surface between them, may cover."""
        width, height = self.pair.dst.size
        points = [*self._corners(self.low), *self._corners(self.high)]
        before = [w for _, _, w in points if w > 0]
        if not before:
            return Rectangle(0, 0, 0, 0)
        if len(before) < len(points):
            beyond = (
                (u + 2 * w < 0, u - (width + 1) * w > 0, v + 2 * w < 0, v - (height + 1) * w > 0) for u, v, w in points
            )  # a half-space that holds all points also holds everything between them
            return Rectangle(0, 0, 0, 0) if any(map(all, zip(*beyond, strict=True))) else Rectangle(0, width, 0, height)
        x, y = [u / w for u, _, w in points], [v / w for _, v, w in points]
        return Rectangle(
            math.floor(min(max(min(x), 0), width)),
            math.ceil(min(max(max(x), -2), width - 1)) + 1,
            math.floor(min(max(min(y), 0), height)),
            math.ceil(min(max(max(y), -2), height - 1)) + 1,
        )

    @cached_property
    def density(self) -> float:
        """Source pixels per target pixel along an axis, at the middle nearness, where the target sees them."""
        u, v, w, _ = self._middle
        with np.errstate(divide="ignore", invalid="ignore"):
            x, y = u / w, v / w
            area = np.abs((x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0]))
            width, height = self.pair.dst.size
            near = (x[0] > -width) & (x[0] < 2 * width) & (y[0] > -height) & (y[0] < 2 * height)
            areas = area[(w[0] > 0) & near & (area > 0)]
        return _middle_of(areas) ** -0.5 if len(areas) else 1.0

    @cached_property
    def typical(self) -> float:
        """Nearness in the target of a point at the source's middle nearness, in front of both cameras."""
        _, _, w, q = self._middle
        ahead = w[0] > 0
        return _middle_of(q[0][ahead] / w[0][ahead]) if ahead.any() else 1.0

    @cached_property
    def range_in_target(self) -> tuple[float, float]:
        """Least and greatest nearness in the target of any place in the source at a nearness from `low` to `high`."""
        x, y = (-0.5, self.pair.src.width - 0.5), (-0.5, self.pair.src.height - 0.5)
        points = np.array([(*place, 1.0, n) for place in itertools.product(x, y) for n in (self.low, self.high)])
        _, _, w, q = self.pair.dst_from_src @ points.T
        if (w <= 0).any():
            return (0.0 if self.pair.dst.projection == "perspective" else -_FAR), _FAR
        return float((q / w).min()), float((q / w).max())

    @cached_property
    def _middle(self) -> Float64:
        """(4, 3, 25) homogeneous target positions of the pair's grid at the middle nearness."""
        at_infinity, per_nearness = self.pair.grid
        return at_infinity + 0.5 * (self.low + self.high) * per_nearness

    def _corners(self, nearness: float) -> list[tuple[float, float, float]]:
        """(U, V, W) in the target of the source's corners at a nearness."""
        *corners, (b_u, b_v, b_w) = self.pair.corners
        return [(u + nearness * b_u, v + nearness * b_v, w + nearness * b_w) for u, v, w in corners]


def _pixels_from_pixels(one: Camera, other: Camera) -> Float64:
    """(4, 4) from the pixel space of `other` to that of `one`; rounding errors become 0: parallel cameras stay so."""
    pose = one.camera_from_world @ other.world_from_camera
    turn, step = pose[:3, :3], pose[:3, 3]
    turn[np.abs(turn) < _ROUNDING] = 0.0
    far = max(float(np.abs(one.center).max()), float(np.abs(other.center).max()))
    step[np.abs(step) < max(_ROUNDING * float(np.abs(step).max()), _ROUNDING_FAR * far)] = 0.0
    made = one.pixel_matrix @ pose @ np.linalg.inv(other.pixel_matrix)
    made[np.abs(made) < _ROUNDING * np.abs(made).max(axis=1, keepdims=True) / max(*other.size, 1)] = 0.0
    return made


def _middle_of(values: Float64) -> float:
    """The upper median, without NumPy's `median`, which imports masked arrays on first use."""
    return float(np.sort(values)[len(values) // 2])
