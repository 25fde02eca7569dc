"""Synthetic depth images with known depth.

Lengths are in scene units. Surfaces lie 3 to 5 in front of the source camera. Its pose is not the identity, its pixels
are not square and its principal point is off the middle, so that wrong conventions show.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera, Projection
from pyibr.images import DepthImage

Array = NDArray[Any]
Size = tuple[int, int]


def source_camera(size: Size, projection: Projection = "perspective") -> Camera:
    """Camera that sees 80 degrees over the image's longer side (perspective), or 7 scene units (orthographic)."""
    width, height = size
    longer = max(width, height)
    f = 0.6 * longer if projection == "perspective" else longer / 7
    K = np.array([[f, 0, (width - 1) / 2 + 0.3], [0, 1.05 * f, (height - 1) / 2 - 0.2], [0, 0, 1]])
    return Camera(K, size, pose(yaw=25, pitch=-10, roll=5, center=(0.4, -1.1, 0.7)), projection=projection)


def pose(yaw: float = 0, pitch: float = 0, roll: float = 0, center: tuple[float, ...] = (0, 0, 0)) -> Array:
    """(4, 4) world_from_camera: degrees about y, then x, then z of the camera; ``center`` in the world."""
    cy, cx, cz = np.cos(np.radians([yaw, pitch, roll]))
    sy, sx, sz = np.sin(np.radians([yaw, pitch, roll]))
    world_from_camera = np.eye(4)
    world_from_camera[:3, :3] = (
        np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
        @ np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
        @ np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    )
    world_from_camera[:3, 3] = center
    return world_from_camera


def image_coordinates(size: Size) -> tuple[Array, Array]:
    """(H, W) x and y of the pixels: 0 in the image's middle, -1 and 1 at the borders of its longer side."""
    width, height = size
    y, x = np.mgrid[:height, :width].astype(np.float64)
    half = max(width, height, 2) / 2
    return (x - (width - 1) / 2) / half, (y - (height - 1) / 2) / half


def smooth_depth(a: Array, b: Array) -> Array:
    """Rolling hills between 3 and 5."""
    return 4 + 0.55 * np.sin(2.3 * a + 0.5) * np.cos(2.9 * b) + 0.35 * np.sin(4.1 * (0.6 * a + b) + 1)


def stepped_depth(a: Array, b: Array) -> Array:
    """A slanted wall behind a box, a diamond, a disc and a flight of stairs."""
    depth = 4.9 + 0.15 * a - 0.1 * b
    stairs = (a < -0.35) & (b > 0.1)
    depth = np.where(stairs, 4.7 - 0.25 * np.floor((b - 0.1) * 6), depth)
    depth = np.where((np.abs(a + 0.45) < 0.2) & (np.abs(b + 0.4) < 0.25), 3.6, depth)
    depth = np.where(np.abs(a - 0.4) + np.abs(b + 0.35) < 0.28, 3.2 + 0.3 * b, depth)
    return np.where((a - 0.35) ** 2 + (b - 0.4) ** 2 < 0.06, 4.0 - 0.5 * a, depth)


def plane_depth(a: Array, b: Array) -> Array:
    """A fronto-parallel wall."""
    return np.full_like(a + b, 4.0)


def texture(a: Array, b: Array) -> Array:
    """(H, W, 3) uint8: smooth, and different everywhere."""
    bands = np.stack([a + 0.3 * b, b - 0.2 * a, a * b + 0.5 * a], axis=-1)
    waves = 0.25 * np.sin(9 * bands + [0, 2, 4]) + 0.15 * np.sin(23 * bands[..., ::-1])
    return np.round(255 * (0.5 + waves)).astype(np.uint8)


def scene(
    depth: Callable[[Array, Array], Array], size: Size, projection: Projection = "perspective", far: float = np.inf
) -> DepthImage:
    """A depth image whose planar z is a function, ``depth``, of the image coordinates."""
    a, b = image_coordinates(size)
    return DepthImage(texture(a, b), depth(a, b).astype(np.float32), source_camera(size, projection), far=far)


@cache
def smooth(size: Size, projection: Projection = "perspective") -> DepthImage:
    """One continuous surface without any depth edge."""
    return scene(smooth_depth, size, projection)


@cache
def stepped(size: Size, projection: Projection = "perspective") -> DepthImage:
    """Depth edges along rows, columns, diagonals and a circle."""
    return scene(stepped_depth, size, projection)


@cache
def flat(size: Size, projection: Projection = "perspective") -> DepthImage:
    """A plane at depth 4: its warp is a homography."""
    return scene(plane_depth, size, projection)


@cache
def holed(size: Size, projection: Projection = "perspective") -> DepthImage:
    """The stepped scene with a disc at depth ``far``, a column of nan, and scattered pixels of depth 0 or inf."""

    def depth(a: Array, b: Array) -> Array:
        z = stepped_depth(a, b)
        z = np.where(a**2 + b**2 < 0.04, 100.0, z)
        z = np.where(np.abs(a - 0.75) < 0.04, np.nan, z)
        index = np.arange(z.size).reshape(z.shape)
        return np.where(index % 97 == 5, 0.0, np.where(index % 131 == 7, np.inf, z))

    return scene(depth, size, projection, far=100.0)


def ramp_and_empty(size: Size) -> list[DepthImage]:
    """A view with a steep ramp, which `warp` treats as a bridge between surfaces, and a view that is empty there."""
    view = smooth(size)
    near = np.interp(np.arange(size[0]), [0, 5, 9, size[0]], [1.0, 1.0, 0.2, 0.2]) * np.ones((size[1], 1))
    empty = np.full(near.shape, np.inf, np.float32)
    empty[0, 0] = 9.0
    return [DepthImage(view.color, depth.astype(np.float32), view.camera) for depth in (1 / near, empty)]
