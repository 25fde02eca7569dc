"""An image with depth: a sampled surface.

Depth in pyibr is planar: the z of a surface point in the camera's frame, in scene units. A sample whose
depth is not finite or not > 0 is invalid: nothing is known there.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera
from pyibr.core.checks import (
    Fixed,
    Float64,
    checked_colors,
    describe,
    fits,
    instance_of,
    locked,
    one_of,
    plain_array,
    positive,
    shape_text,
)
from pyibr.core.errors import ArgumentError
from pyibr.core.straight import rays_of
from pyibr.images.noise import noise_by_depth

Color = NDArray[np.uint8] | NDArray[np.float32]
Depth = NDArray[np.float32]
Backdrop = Literal["farthest"]

_IN_CACHE = 1 << 15  # samples at a time: of more, float64 values take several times longer


class DepthImage(Fixed):
    """An image with a depth for each pixel, and the camera that took it: a sampled surface.

    Parameters
    ----------
    color : (H, W, 3) uint8, or float32 in [0, 1]; or None
        None: depth alone. `pyibr.warp` carries depth over then, and nothing else; in pictures such a view is white.
    depth : (H, W) float32
        Planar z in scene units; NaN, infinite or <= 0 where there is none. Other kinds of depth are converted
        first: `depth_from_uint16`, `depth_from_disparity`, `depth_from_euclidean`, `depth_from_mpeg`.
    camera : Camera
        Of size (W, H). With a lens, it is drawn as `pyibr.straightened` makes it.
    far : float
        Samples at this depth or beyond it are background, which is no surface.
    backdrop : float or "farthest", optional
        A depth for what is no surface, as sky and windows, so that new views show its colours instead of holes; or
        "farthest": that of the farthest sample. `depth` is copied with it, and no `far` is left.

    Attributes
    ----------
    color, depth, camera, far
        As given, but for `backdrop`; `color` of shape (H, W, 0) if there is none. The arrays are kept without a copy
        if they are C-contiguous, and locked against writing through this object. Change neither them nor their
        originals afterwards: buffers on the device are kept as well.

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

    def __init__(
        self,
        color: Color | None,
        depth: Depth,
        camera: Camera,
        far: float = math.inf,
        backdrop: float | Backdrop | None = None,
    ) -> None:
        instance_of("camera", camera, Camera, "a pyibr.Camera")
        shape = camera.height, camera.width
        self.camera = camera
        endless = isinstance(far, (float, np.floating)) and far == math.inf
        limit = math.inf if endless else positive("far", far, "a depth > 0")
        none = np.empty((*shape, 0), np.uint8)
        self.color = locked(none if color is None else checked_colors("color", color, (*shape, 3)))
        given = checked_depth(depth, shape)
        self.depth = locked(given if backdrop is None else _backed(given, limit, backdrop))
        self.far = limit if backdrop is None else math.inf

    def __reduce__(self) -> tuple[type[DepthImage], tuple[Color | None, Depth, Camera, float]]:
        return DepthImage, (self.color if self.has_color else None, self.depth, self.camera, self.far)

    def __repr__(self) -> str:
        color = self.color.dtype if self.has_color else "depth alone"
        return f"<DepthImage {self.camera.width}x{self.camera.height} {color} far={self.far:g}>"

    @property
    def has_color(self) -> bool:
        """Whether it is more than depth alone."""
        return self.color.shape[2] > 0

    @cached_property
    def shown(self) -> Color:
        """(H, W, 3) the colours; white if it has none. Made on first use."""
        return self.color if self.has_color else locked(np.full((*self.depth.shape, 3), 255, np.uint8))

    @cached_property
    def in_color(self) -> DepthImage:
        """The same image with the colours it is shown in; itself if it has any. Made on first use."""
        return self if self.has_color else DepthImage(self.shown, self.depth, self.camera, self.far)

    @cached_property
    def valid(self) -> NDArray[np.bool_]:
        """(H, W) True where the depth is finite, > 0, nearer than `far`, and in the lens's sight. Made on first use."""
        valid = (self.depth > 0) & (self.depth < self.far)
        if self.camera.lens is not None:
            valid &= np.isfinite(rays_of(self.camera)[..., 0])
        return locked(valid)

    @cached_property
    def in_float(self) -> DepthImage:
        """The same image with float32 colours, itself if they are. Made on first use, so that it keeps its buffers."""
        if self.color.dtype == np.float32:
            return self
        color = (self.shown * np.float32(1 / 255)).astype(np.float32)
        return DepthImage(color, self.depth, self.camera, self.far)

    @cached_property
    def noise(self) -> tuple[float, float, float]:
        """(a, b, c): at depth z its noise has a standard deviation of about a z^2 + b z + c. Found on first use."""
        return noise_by_depth(self.depth, self.far)

    @property
    def points(self) -> Float64:
        """(N, 3) float64: the valid samples in the world, in scene units, row by row."""
        return self._points_of(self.valid)

    def _points_of(self, which: NDArray[np.bool_]) -> Float64:
        z = self.depth[which].astype(np.float64)
        local = np.column_stack([rays_of(self.camera)[which], z])
        if self.camera.projection == "perspective":
            local[:, :2] *= z[:, None]
        return local @ self.camera.world_from_camera[:3, :3].T + self.camera.center

    @cached_property
    def bounds(self) -> tuple[Float64, Float64]:
        """(low, high), each (3,), in the world: the box around the valid samples. Computed on first use."""
        return self.bounds_of(self.valid)

    def bounds_of(self, which: NDArray[np.bool_]) -> tuple[Float64, Float64]:
        """(low, high), each (3,), in the world: the box around those of the valid samples, (H, W) bool."""
        if not which.any():
            return self.camera.center, self.camera.center
        if self.camera.lens is not None:
            points = self._points_of(which)
            return np.nanmin(points, axis=0), np.nanmax(points, axis=0)
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


def _backed(depth: Depth, far: float, backdrop: float | Backdrop) -> Depth:
    """The depth with a surface where there is none before `far`."""
    valid = (depth > 0) & (depth < far)
    if isinstance(backdrop, str):
        one_of("backdrop", backdrop, Backdrop, " or a depth > 0")
        if not valid.any():
            raise ArgumentError("backdrop", "a depth > 0 for a view without any", describe(backdrop))
        behind = depth[valid].max()
    else:
        behind = np.float32(positive("backdrop", backdrop, 'a depth > 0 or "farthest"'))
    return np.where(valid, depth, behind)


def checked_depth(depth: object, shape: tuple[int | None, ...], argument: str = "depth") -> Depth:
    """Return planar depth of `shape` (None fits any length) as float32, NaN where masked, or raise ArgumentError."""
    expected = f"float32 of shape {shape_text(shape)}, planar z in scene units"
    array = plain_array(argument, depth, expected, math.nan)
    if not fits(array, shape) or 0 in array.shape or array.dtype.kind != "f":
        hint = " (depth_from_uint16 converts integers with a scale)" if array.dtype.kind in "iu" else ""
        raise ArgumentError(argument, expected, describe(array if isinstance(depth, np.ndarray) else depth) + hint)
    with np.errstate(over="ignore"):  # what float32 does not hold is infinite
        return array.astype(np.float32, copy=False)
