"""An image with depth: a sampled surface.

Depth in pyibr is planar: the z of a surface point in the camera's frame, in scene units. A sample whose
depth is not finite or not > 0 is invalid: nothing is known there.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera
from pyibr.core.checks import Fixed, Float64, describe, instance_of, locked, positive
from pyibr.core.errors import ArgumentError

Color = NDArray[np.uint8] | NDArray[np.float32]
Depth = NDArray[np.float32]

_IN_CACHE = 1 << 15  # samples at a time: of more, float64 values take several times longer

_ColorT = TypeVar("_ColorT", bound=Color)


class DepthImage(Fixed):
    """An image with a depth for each pixel, and the camera that took it: a sampled surface.

    Parameters
    ----------
    color : (H, W, 3) uint8, or float32 in [0, 1]
    depth : (H, W) float32
        Planar z in scene units; NaN, infinite or <= 0 where there is none. Other kinds of depth are converted
        first: `depth_from_uint16`, `depth_from_disparity`, `depth_from_euclidean`, `depth_from_mpeg`.
    camera : Camera
        Of size (W, H).
    far : float
        Samples at this depth or beyond it are background, which is no surface.

    Attributes
    ----------
    color, depth, camera, far
        As given. The arrays are kept without a copy if they are C-contiguous, and locked against writing
        through this object. Change neither them nor their originals afterwards: buffers on the device are
        kept as well.

    Raises
    ------
    ArgumentError
        If shapes, dtypes and camera do not fit together.

    Examples
    --------
    >>> import numpy as np
    >>> import pyibr as ibr
    >>> camera = ibr.Camera([[50, 0, 3], [0, 50, 6], [0, 0, 1]], (7, 13))
    >>> view = ibr.DepthImage(np.zeros((13, 7, 3), np.uint8), np.full((13, 7), 2, np.float32), camera)
    >>> bool(view.valid.all())
    True
    """

    color: Color
    depth: Depth
    camera: Camera
    far: float

    def __init__(self, color: Color, depth: Depth, camera: Camera, far: float = math.inf) -> None:
        instance_of("camera", camera, Camera, "a pyibr.Camera")
        shape = camera.height, camera.width
        self.camera = camera
        self.far = far if far == math.inf else positive("far", far, "a depth > 0")
        self.color = locked(checked_color(color, shape))
        self.depth = locked(checked_depth(depth, shape))

    def __reduce__(self) -> tuple[type[DepthImage], tuple[Color, Depth, Camera, float]]:
        return DepthImage, (self.color, self.depth, self.camera, self.far)

    def __repr__(self) -> str:
        return f"<DepthImage {self.camera.width}x{self.camera.height} {self.color.dtype} far={self.far:g}>"

    @cached_property
    def valid(self) -> NDArray[np.bool_]:
        """(H, W) True where the depth is finite, > 0 and nearer than `far`. Computed on first use."""
        return locked((self.depth > 0) & (self.depth < self.far))

    @cached_property
    def in_float(self) -> DepthImage:
        """The same image with float32 colours, itself if they are. Made on first use, so that it keeps its buffers."""
        if self.color.dtype == np.float32:
            return self
        color = (self.color * np.float32(1 / 255)).astype(np.float32)
        return DepthImage(color, self.depth, self.camera, self.far)

    @property
    def points(self) -> Float64:
        """(N, 3) float64: the valid samples in the world, in scene units, row by row."""
        y, x = np.nonzero(self.valid)
        return self.camera.unproject(np.column_stack([x, y]), self.depth[y, x].astype(np.float64))

    @cached_property
    def bounds(self) -> tuple[Float64, Float64]:
        """(low, high), each (3,), in the world: the box around the valid samples. Computed on first use."""
        return self.bounds_of(self.valid)

    def bounds_of(self, which: NDArray[np.bool_]) -> tuple[Float64, Float64]:
        """(low, high), each (3,), in the world: the box around those of the valid samples, (H, W) bool."""
        if not which.any():
            return self.camera.center, self.camera.center
        turn, x = self.camera.world_from_camera[:3, :3], np.arange(self.camera.width)
        across, perspective = turn[:, :2] @ np.linalg.inv(self.camera.K)[:2], self.camera.projection == "perspective"
        low, high = np.full(3, np.inf), np.full(3, -np.inf)
        rows = max(_IN_CACHE // self.camera.width, 1)
        for first in range(0, self.camera.height, rows):
            part = slice(first, first + rows)
            z = np.where(which[part], self.depth[part], np.float64(np.nan))
            y = np.arange(first, first + len(z))[:, None]
            for axis, ((a, b, c), along) in enumerate(zip(across, turn[:, 2], strict=True)):
                aside = a * x + (b * y + c)
                values = (aside + along) * z if perspective else aside + along * z
                low[axis] = np.fmin(low[axis], np.fmin.reduce(values, axis=None))
                high[axis] = np.fmax(high[axis], np.fmax.reduce(values, axis=None))
        return low + self.camera.center, high + self.camera.center


def checked_color(color: _ColorT, shape: tuple[int, int]) -> _ColorT:
    """Return `color` if it is an image of `shape`, or raise ArgumentError."""
    expected = f"uint8, or float32 in [0, 1], of shape {(*shape, 3)}"
    if not isinstance(color, np.ndarray):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise ArgumentError("color", expected, describe(color))
    if color.shape != (*shape, 3) or color.dtype.name not in ("uint8", "float32"):
        hint = ""
        if color.shape == shape:
            hint = ", which is gray (repeat it: np.repeat(gray[..., None], 3, 2))"
        elif color.shape == (*shape, 4):
            hint = ", which has alpha (drop it: color[..., :3])"
        raise ArgumentError("color", expected, describe(color) + hint)
    return color


def checked_depth(depth: Depth, shape: tuple[int, int]) -> Depth:
    """Return `depth` if it is planar depth of `shape`, or raise ArgumentError."""
    expected = f"float32 of shape {shape}, planar z in scene units"
    if not isinstance(depth, np.ndarray):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise ArgumentError("depth", expected, describe(depth))
    if depth.shape != shape or depth.dtype != np.float32:
        hint = ""
        if depth.dtype.kind in "iu":
            hint = " (depth_from_uint16 converts integers with a scale)"
        elif depth.dtype == np.float64:
            hint = " (convert it: depth.astype(np.float32))"
        raise ArgumentError("depth", expected, describe(depth) + hint)
    return depth
