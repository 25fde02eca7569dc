"""Images with depth, and converters from other kinds of depth.

Depth in pyibr is planar: the z of a surface point in the camera's frame, in scene units. A sample whose
depth is not finite or not > 0 is invalid: nothing is known there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from typing import TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pyibr._check import Float64, checked_intrinsics, describe, numbers, positive
from pyibr.camera import Camera
from pyibr.errors import ArgumentError, MissingPackageError

Color = NDArray[np.uint8] | NDArray[np.float32]
Depth = NDArray[np.float32]

_IN_CACHE = 1 << 15  # samples at a time: of more, float64 values take several times longer

_ColorT = TypeVar("_ColorT", bound=Color)
_ArrayT = TypeVar("_ArrayT", bound=NDArray[np.generic])


class DepthImage:
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
        if not isinstance(camera, Camera):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise ArgumentError("camera", "a pyibr.Camera", describe(camera))
        shape = camera.height, camera.width
        self.camera = camera
        self.far = far if far == math.inf else positive("far", far, "a depth > 0")
        self.color = _locked(_checked_color(color, shape))
        self.depth = _locked(_checked_depth(depth, shape))
        # The OpenCL side keeps its buffers here, so that they live as long as the image.
        self.device_cache: dict[object, object] = {}

    def __reduce__(self) -> tuple[type[DepthImage], tuple[Color, Depth, Camera, float]]:
        return DepthImage, (self.color, self.depth, self.camera, self.far)

    def __repr__(self) -> str:
        return f"<DepthImage {self.camera.width}x{self.camera.height} {self.color.dtype} far={self.far:g}>"

    @cached_property
    def valid(self) -> NDArray[np.bool_]:
        """(H, W) True where the depth is finite, > 0 and nearer than `far`. Computed on first use."""
        return _locked((self.depth > 0) & (self.depth < self.far))

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


class PixelClass(IntEnum):
    """What a pixel of a new view is. Of several views' answers for a hole the least counts: what knows most.

    A hole's class is what begins beyond the last place where the pixel's ray was seen to pass through free space; of a
    ray that never was, what it began in.

    Examples
    --------
    >>> import pyibr as ibr
    >>> ibr.PixelClass(1).name
    'HIDDEN'
    """

    SEEN = 0
    """The source saw what is there."""
    HIDDEN = 1
    """What is there was hidden from the source by something nearer."""
    UNOBSERVED = 2
    """The source has no depth there."""
    OUTSIDE = 3
    """What is there lies outside of the source's image."""


@dataclass(frozen=True, eq=False)
class Frame:
    """A rendered view.

    Attributes
    ----------
    color : (H, W, 3)
        In the dtype of the input's colour; black where not valid, unless holes were filled.
    depth : (H, W) float32
        Planar z in `camera`'s frame; NaN where not valid.
    valid : (H, W) bool
        False in holes: pixels that no surface was seen through.
    camera : Camera
    classes : (H, W) uint8, or None
        If they were asked for: what each pixel is, a `PixelClass`.
    source : (H, W, 2) float32, or None
        If they were asked for: the place (x, y) in the source where each pixel's ray meets the surface, between its
        samples (whatever `sample` is); NaN where not valid. What belongs to the source (labels, features, flow)
        is carried over with it, by `cv2.remap` or by indexing.
    view : (H, W) int32, or None
        If they were asked for: the number of the view that it comes from, -1 where not valid.
    """

    color: Color
    depth: Depth
    valid: NDArray[np.bool_]
    camera: Camera
    classes: NDArray[np.uint8] | None = None
    source: NDArray[np.float32] | None = None
    view: NDArray[np.int32] | None = None

    def __repr__(self) -> str:
        return f"<Frame {self.camera.width}x{self.camera.height} {self.color.dtype}>"


def _locked(array: _ArrayT) -> _ArrayT:
    """Return a C-contiguous, unwritable view of `array`, copied only if it must be."""
    view = np.ascontiguousarray(array).view()
    view.flags.writeable = False
    return cast("_ArrayT", view)


def _checked_color(color: _ColorT, shape: tuple[int, int]) -> _ColorT:
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


def _checked_depth(depth: Depth, shape: tuple[int, int]) -> Depth:
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


def depth_from_disparity(disparity: ArrayLike, focal: float, baseline: float, offset: float = 0.0) -> Depth:
    """Return depth = focal * baseline / (disparity + offset).

    Parameters
    ----------
    disparity : array_like
        In pixels. Not finite is unknown. With `offset` 0, so is 0; otherwise a 0 that stands for "unknown"
        must be made NaN first.
    focal : float
        In pixels.
    baseline : float
        In scene units.
    offset : float
        Added to the disparity, in pixels: the difference of the two principal points (`doffs` of Middlebury).

    Returns
    -------
    float32 of the disparity's shape, NaN where unknown or where disparity + offset <= 0.

    Examples
    --------
    >>> import pyibr as ibr
    >>> ibr.depth_from_disparity([20, 0], focal=500, baseline=0.1).tolist()
    [2.5, nan]
    """
    d = np.asarray(disparity, np.float64) + offset
    depth = positive("focal", focal) * positive("baseline", baseline) / _positive_or_nan(d)
    return depth.astype(np.float32)


def disparity_from_depth(depth: ArrayLike, focal: float, baseline: float, offset: float = 0.0) -> Depth:
    """Invert `depth_from_disparity`: float32 disparity in pixels, NaN where the depth is invalid."""
    z = _positive_or_nan(np.asarray(depth, np.float64))
    return (positive("focal", focal) * positive("baseline", baseline) / z - offset).astype(np.float32)


def depth_from_euclidean(distance: ArrayLike, camera: Camera) -> Depth:
    """Return the planar depth of distances along the rays of `camera`.

    Parameters
    ----------
    distance : array_like (H, W)
        In scene units from the camera's centre (perspective) or from its image plane (orthographic, whose
        distances are planar already).
    camera : Camera
        Of size (W, H).

    Returns
    -------
    (H, W) float32, NaN where the distance is not finite or <= 0.
    """
    d = numbers("distance", distance, (camera.height, camera.width), finite=False)
    return (_positive_or_nan(d) / _ray_lengths(camera)).astype(np.float32)


def euclidean_from_depth(depth: ArrayLike, camera: Camera) -> Depth:
    """Invert `depth_from_euclidean`: (H, W) float32 distances, NaN where the depth is invalid."""
    z = numbers("depth", depth, (camera.height, camera.width), finite=False)
    return (_positive_or_nan(z) * _ray_lengths(camera)).astype(np.float32)


def depth_from_uint16(stored: NDArray[np.uint16], scale: float) -> Depth:
    """Return depth = stored / scale, as depth sensors write it into 16-bit PNG files.

    Parameters
    ----------
    stored : uint16, or other integers
        0 (or less) means no depth.
    scale : float
        Stored units per scene unit: 1000 for millimetres to metres, 5000 for the TUM data sets.

    Returns
    -------
    float32 of the same shape, NaN where there is no depth.

    Examples
    --------
    >>> import numpy as np
    >>> import pyibr as ibr
    >>> ibr.depth_from_uint16(np.array([1500, 0], np.uint16), scale=1000).tolist()
    [1.5, nan]
    """
    if stored.dtype.kind not in "ui":
        raise ArgumentError("stored", "integers", describe(stored))
    depth = (stored / positive("scale", scale)).astype(np.float32)
    depth[stored <= 0] = np.nan
    return depth


def uint16_from_depth(depth: ArrayLike, scale: float) -> NDArray[np.uint16]:
    """Invert `depth_from_uint16`, rounded to the nearest unit; 0 where the depth is invalid.

    Raises
    ------
    ArgumentError
        If a valid depth does not fit in 1 ... 65535 units.
    """
    units = np.rint(_positive_or_nan(np.asarray(depth, np.float64)) * positive("scale", scale))
    _within("depth", units, 1, 65535, f"1 to 65535 units of 1/{scale:g}")
    return np.nan_to_num(units, nan=0).astype(np.uint16)


def depth_from_mpeg(level: ArrayLike, near: float, far: float, zero_is_invalid: bool = False) -> Depth:
    """Return the depth of MPEG's normalised inverse depth.

    Parameters
    ----------
    level : array_like of floats in [0, 1]
        A stored integer divided by 2^bits - 1: 1 at `near`, 0 at `far`. NaN is invalid.
    near, far : float
        The depth range in scene units, 0 < near < far. As in the MPEG test model, a `far` of 1000 or more
        stands for infinity: depth = near / level.
    zero_is_invalid : bool
        Level 0 means no depth (`HasInvalidDepth`).

    Returns
    -------
    float32, NaN where invalid.
    """
    n = _checked_levels(level)
    _check_range(near, far)
    if zero_is_invalid:
        n = np.where(n == 0, np.nan, n)
    z = near / _positive_or_nan(n) if far >= 1000 else far * near / (near + n * (far - near))
    return z.astype(np.float32)


def mpeg_from_depth(depth: ArrayLike, near: float, far: float) -> Depth:
    """Invert `depth_from_mpeg`: float32 levels in [0, 1], 0 where the depth is invalid.

    Raises
    ------
    ArgumentError
        If a valid depth lies outside `near` ... `far`.
    """
    _check_range(near, far)
    z = _positive_or_nan(np.asarray(depth, np.float64))
    endless = far >= 1000
    # float32 depth at the very ends may lie beyond them by its rounding
    _within("depth", z, near * (1 - 1e-6), math.inf if endless else far * (1 + 1e-6), f"{near:g} to {far:g}")
    level = near / z if endless else near * (far - z) / (z * (far - near))
    return np.nan_to_num(np.clip(level, 0, 1), nan=0).astype(np.float32)


def undistort(color: _ColorT, depth: Depth, K: ArrayLike, distortion: ArrayLike) -> tuple[_ColorT, Depth, Float64]:
    """Remove a lens's distortion from an image and its depth, with OpenCV.

    Parameters
    ----------
    color : (H, W, 3) uint8 or float32
    depth : (H, W) float32
    K : array_like (3, 3)
        Of the distorted image.
    distortion : array_like
        OpenCV's 4, 5, 8, 12 or 14 coefficients: k1 k2 p1 p2 [k3 [k4 k5 k6 [...]]].

    Returns
    -------
    color : (H, W, 3)
        Interpolated linearly; black where the lens did not see.
    depth : (H, W) float32
        The nearest sample, so that edges stay edges; NaN where the lens did not see.
    K : (3, 3) float64
        Of the result, which is that of the input.

    Raises
    ------
    MissingPackageError
        If OpenCV is not installed.
    """
    try:
        import cv2
    except ImportError:
        raise MissingPackageError("undistort needs OpenCV: pip install opencv-python-headless") from None
    intrinsics = checked_intrinsics(K)
    coefficients = numbers("distortion", np.ravel(np.asarray(distortion)), (None,))
    if len(coefficients) not in (4, 5, 8, 12, 14):
        raise ArgumentError("distortion", "4, 5, 8, 12 or 14 coefficients", f"{len(coefficients)}")
    shape = np.shape(depth)[:2]
    color, depth = _checked_color(color, shape), _checked_depth(depth, shape)
    map_x, map_y = cv2.initUndistortRectifyMap(
        intrinsics, coefficients, np.eye(3), intrinsics, shape[::-1], cv2.CV_32FC1
    )
    straight = cv2.remap(color, map_x, map_y, cv2.INTER_LINEAR, borderValue=0)
    z = cv2.remap(depth, map_x, map_y, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=math.nan)
    return cast("_ColorT", straight), cast("Depth", z), intrinsics


def _positive_or_nan(values: Float64) -> Float64:
    return np.where((values > 0) & (values < np.inf), values, np.nan)


def _ray_lengths(camera: Camera) -> Float64:
    """Length of K^-1 (x, y, 1) at each pixel, (H, W); 1 for an orthographic camera."""
    if camera.projection == "orthographic":
        return np.ones((camera.height, camera.width))
    y, x = np.mgrid[: camera.height, : camera.width].astype(np.float64)
    inverse = np.linalg.inv(camera.K)
    rays = inverse[:2, 0, None, None] * x + inverse[:2, 1, None, None] * y + inverse[:2, 2, None, None]
    return np.sqrt(rays[0] ** 2 + rays[1] ** 2 + 1)


def _within(argument: str, values: Float64, low: float, high: float, expected: str) -> None:
    outside = values[(values < low) | (values > high)]
    if outside.size:
        raise ArgumentError(argument, expected, f"{outside.size} values from {outside.min():g} to {outside.max():g}")


def _checked_levels(level: ArrayLike) -> Float64:
    array = np.asarray(level)
    expected = "floats in [0, 1] (divide integers by 2^bits - 1)"
    if array.dtype.kind != "f":
        raise ArgumentError("level", expected, describe(array))
    levels = array.astype(np.float64)
    _within("level", levels, 0, 1, expected)
    return levels


def _check_range(near: float, far: float) -> None:
    if not positive("near", near) < positive("far", far):
        raise ArgumentError("far", f"a depth beyond near = {near:g}", f"{far:g}")
