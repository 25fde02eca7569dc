"""Conversions between planar depth and other kinds of depth."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pyibr.core.camera import Camera
from pyibr.core.checks import (
    Float64,
    checked_bool,
    describe,
    instance_of,
    numbers,
    plain_array,
    positive,
    positive_or_infinite,
)
from pyibr.core.errors import ArgumentError
from pyibr.core.undistortion import rays_of
from pyibr.images.depth_image import Depth


@np.errstate(all="ignore")
def depth_from_disparity(disparity: ArrayLike, focal: float, baseline: float, *, offset: float = 0.0) -> Depth:
    """Return depth = focal * baseline / (disparity + offset).

    Parameters
    ----------
    disparity : array_like
        In pixels; not finite where unknown. With `offset` 0, a disparity of 0 is also unknown. With another `offset`,
        replace a 0 that stands for "unknown" by NaN first.
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
    d = numbers("disparity", disparity, None, finite=False) + numbers("offset", offset, ())
    depth = positive("focal", focal) * positive("baseline", baseline) / _positive_or_nan(d)
    return depth.astype(np.float32)


@np.errstate(all="ignore")
def disparity_from_depth(depth: ArrayLike, focal: float, baseline: float, *, offset: float = 0.0) -> Depth:
    """Invert `depth_from_disparity`: float32 disparity in pixels, NaN where the depth is invalid.

    Examples
    --------
    >>> import pyibr as ibr
    >>> ibr.disparity_from_depth([2.5, 0], focal=500, baseline=0.1).tolist()
    [20.0, nan]
    """
    z = _positive_or_nan(numbers("depth", depth, None, finite=False))
    disparity = positive("focal", focal) * positive("baseline", baseline) / z
    return (disparity - numbers("offset", offset, ())).astype(np.float32)


@np.errstate(all="ignore")
def depth_from_euclidean(distance: ArrayLike, camera: Camera) -> Depth:
    """Return the planar depth of distances along the rays of `camera`.

    Parameters
    ----------
    distance : array_like (H, W)
        In scene units, from the camera's centre (perspective) or from its image plane (orthographic, where distances
        are already planar).
    camera : Camera
        Its size is (W, H).

    Returns
    -------
    (H, W) float32, NaN where the distance is not finite or <= 0.

    Examples
    --------
    >>> import numpy as np
    >>> import pyibr as ibr
    >>> camera = ibr.Camera([[1, 0, 0], [0, 1, 0], [0, 0, 1]], (2, 1))
    >>> ibr.depth_from_euclidean(np.array([[3, 2 * np.sqrt(2)]]), camera).tolist()  # ahead, and 45 degrees to the right
    [[3.0, 2.0]]
    """
    instance_of("camera", camera, Camera, "a pyibr.Camera")
    d = numbers("distance", distance, (camera.height, camera.width), finite=False)
    return (_positive_or_nan(d) / _ray_lengths(camera)).astype(np.float32)


@np.errstate(all="ignore")
def euclidean_from_depth(depth: ArrayLike, camera: Camera) -> Depth:
    """Invert `depth_from_euclidean`: (H, W) float32 distances, NaN where the depth is invalid.

    Examples
    --------
    >>> import numpy as np
    >>> import pyibr as ibr
    >>> camera = ibr.Camera([[1, 0, 0], [0, 1, 0], [0, 0, 1]], (2, 1))
    >>> [round(distance, 3) for distance in ibr.euclidean_from_depth(np.array([[3.0, 2.0]]), camera)[0].tolist()]
    [3.0, 2.828]
    """
    instance_of("camera", camera, Camera, "a pyibr.Camera")
    z = numbers("depth", depth, (camera.height, camera.width), finite=False)
    return (_positive_or_nan(z) * _ray_lengths(camera)).astype(np.float32)


@np.errstate(all="ignore")
def depth_from_uint16(stored: NDArray[np.uint16], scale: float) -> Depth:
    """Return depth = stored / scale, for the 16-bit PNG files of depth sensors.

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
    units = plain_array("stored", stored, "integers", 0)
    if units.dtype.kind not in "ui":
        raise ArgumentError("stored", "integers", describe(stored))
    depth = np.empty(units.shape, np.float32)
    np.divide(units, positive("scale", scale), out=depth, casting="same_kind")
    depth[units <= 0] = np.nan
    return depth


@np.errstate(all="ignore")
def uint16_from_depth(depth: ArrayLike, scale: float) -> NDArray[np.uint16]:
    """Invert `depth_from_uint16`, rounded to the nearest unit; 0 where the depth is invalid.

    Raises
    ------
    ArgumentError
        If a valid depth does not fit in 1 ... 65535 units.

    Examples
    --------
    >>> import pyibr as ibr
    >>> ibr.uint16_from_depth([1.5, float("nan")], scale=1000).tolist()
    [1500, 0]
    """
    z = numbers("depth", depth, None, finite=False)
    known = (z > 0) & (z < np.inf)
    units = np.where(known, z, 0.0)
    np.rint(np.multiply(units, positive("scale", scale), out=units), out=units)
    low, high = units.min(initial=np.inf, where=known), units.max(initial=0.0)
    if low < 1 or high > 65535:
        _within("depth", units[known], 1, 65535, f"1 to 65535 units of 1/{scale:g}")
    return units.astype(np.uint16)


@np.errstate(all="ignore")
def depth_from_mpeg(level: ArrayLike, near: float, far: float, *, zero_is_invalid: bool = False) -> Depth:
    """Return the depth for MPEG's normalised inverse depth.

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

    Examples
    --------
    >>> import pyibr as ibr
    >>> ibr.depth_from_mpeg([1.0, 0.0], near=2, far=10).tolist()
    [2.0, 10.0]
    """
    n = _checked_levels(level)
    _check_range(near, far)
    if checked_bool("zero_is_invalid", zero_is_invalid):
        n = np.where(n == 0, np.nan, n)
    z = near / _positive_or_nan(n) if far >= 1000 else far * near / (near + n * (far - near))
    return z.astype(np.float32)


@np.errstate(all="ignore")
def depth_from_relative(values: ArrayLike, *, near: float = 1.0, far: float = 10.0) -> Depth:
    """Return a depth for the relative inverse depth of networks, which has no unit and is greater for nearer surfaces.

    Parameters
    ----------
    values : array_like
        Integers of any width, or floats; not finite where unknown. The greatest value maps to `near`, the least to
        `far`, and 1 / depth is linear in between.
    near, far : float
        In scene units, 0 < near < far. The nearer `far` is to `near`, the flatter the scene.

    Returns
    -------
    float32, NaN where unknown. Soft edges of the network's depth stay; `sharpen_depth` sharpens them.

    Examples
    --------
    >>> import numpy as np
    >>> import pyibr as ibr
    >>> ibr.depth_from_relative(np.array([255, 85, 0], np.uint8), near=2, far=8).tolist()
    [2.0, 4.0, 8.0]
    """
    relative = numbers("values", values, None, finite=False)
    known = np.isfinite(relative)
    low, high = np.min(relative, initial=np.inf, where=known), np.max(relative, initial=-np.inf, where=known)
    if not low < high:
        raise ArgumentError("values", "values that are not all equal", describe(values))
    _check_range(near, far)
    level = (np.where(known, relative, np.nan) - low) / (high - low)
    return (1 / (1 / far + level * (1 / near - 1 / far))).astype(np.float32)


@np.errstate(all="ignore")
def mpeg_from_depth(depth: ArrayLike, near: float, far: float) -> Depth:
    """Invert `depth_from_mpeg`: float32 levels in [0, 1], 0 where the depth is invalid.

    Raises
    ------
    ArgumentError
        If a valid depth lies outside `near` ... `far`.

    Examples
    --------
    >>> import pyibr as ibr
    >>> ibr.mpeg_from_depth([2.0, 10.0], near=2, far=10).tolist()
    [1.0, 0.0]
    """
    _check_range(near, far)
    z = _positive_or_nan(numbers("depth", depth, None, finite=False))
    endless = far >= 1000
    # float32 depth may exceed the range's ends by its rounding
    _within("depth", z, near * (1 - 1e-6), math.inf if endless else far * (1 + 1e-6), f"{near:g} to {far:g}")
    level = near / z if endless else near * (far - z) / (z * (far - near))
    return np.nan_to_num(np.clip(level, 0, 1), nan=0).astype(np.float32)


@np.errstate(all="ignore")
def depth_from_zbuffer(value: ArrayLike, near: float, far: float, *, reverse: bool = False) -> Depth:
    """Return the depth of a perspective z-buffer of OpenGL, Direct3D or Vulkan.

    Parameters
    ----------
    value : array_like of floats in [0, 1]
        0 at `near`, 1 at `far` or where nothing was drawn. NaN is invalid. OpenGL's rows run upward: flip them first.
    near, far : float
        Depths of the clip planes in scene units, 0 < near < far; `far` may be infinite.
    reverse : bool
        1 at `near`, 0 at `far`, as in Unity and Unreal.

    Returns
    -------
    float32, NaN where invalid and where nothing was drawn.

    Examples
    --------
    >>> import pyibr as ibr
    >>> ibr.depth_from_zbuffer([0.0, 0.625, 1.0], near=2, far=10).tolist()
    [2.0, 4.0, nan]
    """
    n, ends = _checked_levels(value, "value"), _nearness_of_planes(near, far)
    b = 1 - n if checked_bool("reverse", reverse) else n
    drawn = np.where(b < 1, b, np.nan)
    return (1 / (ends[0] + drawn * (ends[1] - ends[0]))).astype(np.float32)


@np.errstate(all="ignore")
def zbuffer_from_depth(depth: ArrayLike, near: float, far: float, *, reverse: bool = False) -> Depth:
    """Invert `depth_from_zbuffer`: float32 values in [0, 1]; where the depth is invalid, the value of an empty pixel.

    Raises
    ------
    ArgumentError
        If a valid depth lies outside `near` ... `far`.

    Examples
    --------
    >>> import pyibr as ibr
    >>> ibr.zbuffer_from_depth([2.0, 4.0, float("nan")], near=2, far=10).tolist()
    [0.0, 0.625, 1.0]
    """
    ends = _nearness_of_planes(near, far)
    z = _positive_or_nan(numbers("depth", depth, None, finite=False))
    _within("depth", z, near * (1 - 1e-6), far * (1 + 1e-6), f"{near:g} to {far:g}")  # tolerance for float32 rounding
    b = np.nan_to_num(np.clip((ends[0] - 1 / z) / (ends[0] - ends[1]), 0, 1), nan=1)
    return (1 - b if reverse else b).astype(np.float32)


def _positive_or_nan(values: Float64) -> Float64:
    return np.where((values > 0) & (values < np.inf), values, np.nan)


def _ray_lengths(camera: Camera) -> Float64:
    """(H, W) length of each pixel's ray up to a depth of 1; 1 for an orthographic camera."""
    if camera.projection == "orthographic":
        return np.ones((camera.height, camera.width))
    x, y = np.moveaxis(rays_of(camera), 2, 0)
    return np.sqrt(x * x + y * y + 1)


def _within(argument: str, values: Float64, low: float, high: float, expected: str) -> None:
    outside = values[(values < low) | (values > high)]
    if outside.size:
        raise ArgumentError(argument, expected, f"{outside.size} values from {outside.min():g} to {outside.max():g}")


def _checked_levels(level: ArrayLike, argument: str = "level") -> Float64:
    expected = "floats in [0, 1] (divide integers by 2^bits - 1)"
    array = plain_array(argument, level, expected, math.nan)
    if array.dtype.kind != "f":
        raise ArgumentError(argument, expected, describe(array))
    levels = array.astype(np.float64)
    _within(argument, levels, 0, 1, expected)
    return levels


def _nearness_of_planes(near: float, far: float) -> tuple[float, float]:
    if positive_or_infinite("far", far, "a depth > 0, or infinity") == math.inf:
        return 1 / positive("near", near), 0.0
    _check_range(near, far)
    return 1 / near, 1 / far


def _check_range(near: float, far: float) -> None:
    if not positive("near", near) < positive("far", far):
        raise ArgumentError("far", f"a depth beyond near = {near:g}", f"{far:g}")
