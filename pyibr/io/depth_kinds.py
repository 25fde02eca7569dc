"""Kinds of depth in files: planar z, distances along the rays, or inverse depth, larger where surfaces are nearer."""

from __future__ import annotations

import warnings
from os import PathLike
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera
from pyibr.core.checks import numbers, positive
from pyibr.core.errors import ArgumentError
from pyibr.core.files import like
from pyibr.images.converters import (
    depth_from_euclidean,
    depth_from_relative,
    depth_from_uint16,
    euclidean_from_depth,
    uint16_from_depth,
)

DepthKind = Literal["z", "distance", "inverse", "relative"]

_Values = NDArray[np.float32]
_RANGE, _SKY_SHARE, _SHARE = 1000.0, 0.001, 0.01


def planar(
    values: _Values, kind: DepthKind, camera: Camera | None, name: object, near: float = 1.0, far: float = 10.0
) -> _Values:
    """(H, W) planar z, NaN for no depth, from values of the file `name`; near, far: for relative depth."""
    if kind == "z":
        return values
    if kind == "relative":
        return depth_from_relative(values, near=near, far=far)
    return _inverse(values) if kind == "inverse" else depth_from_euclidean(values, _fitting(camera, values, name))


def scaled(stored: NDArray[Any], depth_scale: float | None, depth_offset: float, name: object) -> _Values:
    """Values in scene units for (H, W) stored ones; integers, 0 for no depth, need a scale."""
    shift = np.float32(_finite(depth_offset) / (depth_scale or 1))
    if stored.dtype == np.uint8 and depth_scale is None:
        expected = f"stored units per scene unit for the 8 bits of {name} (for a network's depth: --depth-is relative)"
        raise ArgumentError("depth_scale", expected, "none")
    if stored.dtype.kind in "ui":
        return depth_from_uint16(stored, required(depth_scale, name)) + shift
    if depth_scale is None:
        return np.ascontiguousarray(stored, np.float32) + shift
    return (stored / positive("depth_scale", depth_scale)).astype(np.float32) + shift


def warn_of_relative(stored: NDArray[Any], name: str | PathLike[str]) -> None:
    """Warn if (H, W) values, read as z, use all levels of their integers, or span 1000 to 1, as relative depth does."""
    if stored.dtype.kind == "u":  # sensors mark lost samples by the largest level, and have few in the upper half
        slack, half = (4, 128) if stored.itemsize == 1 else (0, 1 << 15)  # JPEG moves levels
        high = (half - slack) * 255 // 128
        is_map = stored.min() <= slack and stored.max() >= high and ((stored > half) & (stored < high)).mean() > _SHARE
    else:
        known = stored[np.isfinite(stored) & (stored > 0)].astype(np.float32)
        most = known.max(initial=0)
        if np.count_nonzero(known == most) > _SKY_SHARE * known.size:  # renderers give the sky one large depth
            most = known.max(initial=0, where=known < most)
        is_map = most > _RANGE * known.min(initial=np.inf)
    if is_map:
        remedy = 'if larger is nearer, as in a network\'s map, set depth_kind="relative" (--depth-is relative)'
        warnings.warn(f"{like(name)}: is read as depth, from its least to its largest level; {remedy}", stacklevel=2)


def required(depth_scale: float | None, name: object) -> float:
    """The scale of the integers in the file `name`; ArgumentError if there is none."""
    if depth_scale is None:
        expected = (
            "stored units per scene unit (--depth-scale on the command line; 1000 for millimetres to metres) "
            f"for the integers of {name}"
        )
        raise ArgumentError("depth_scale", expected, "none")
    return positive("depth_scale", depth_scale)


def stored(
    depth: _Values,
    kind: DepthKind,
    camera: Camera | None,
    name: object,
    depth_scale: float | None,
    depth_offset: float,
    whole: bool,
) -> NDArray[Any]:
    """Values, integers or floats, to store in the file `name` for (H, W) planar z; "relative" stores planar z."""
    values = depth
    if kind == "inverse":
        values = _inverse(depth)
    elif kind == "distance":
        values = euclidean_from_depth(depth, _fitting(camera, depth, name))
    offset = _finite(depth_offset)
    if not whole:
        return (values * positive("depth_scale", depth_scale or 1.0) - offset).astype(np.float32)
    scale = required(depth_scale, name)
    if offset > 0 and (lost := (values > 0) & (values <= offset / scale)).any():
        expected = f"values above depth_offset / depth_scale = {offset / scale:g}, for the integers of {name}"
        raise ArgumentError("depth", expected, f"{values[lost].min():g}")
    return uint16_from_depth(values - np.float32(offset / scale), scale)


def _inverse(values: _Values) -> _Values:
    found = np.full(values.shape, np.nan, np.float32)
    with np.errstate(over="ignore"):  # values beyond float32 become infinite
        np.divide(1, values, out=found, where=(values > 0) & np.isfinite(values))
    return found


def _finite(depth_offset: float) -> float:
    return float(numbers("depth_offset", depth_offset, ()))


def _fitting(camera: Camera | None, values: NDArray[Any], name: object) -> Camera:
    """The camera for these distances, or ArgumentError if it is missing or has another size."""
    height, width = values.shape
    if camera is None or camera.size != (width, height):
        got = "none" if camera is None else "{}x{}".format(*camera.size)
        raise ArgumentError("camera", f"the {width}x{height} camera of the distances in {name}", got)
    return camera
