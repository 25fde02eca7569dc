"""Checks of arguments that more than one module needs."""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import cached_property
from typing import Any, TypeVar, cast, get_args
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from pyibr.core.errors import ArgumentError

Float64 = NDArray[np.float64]
_Kind = TypeVar("_Kind")
ArrayT = TypeVar("ArrayT", bound=NDArray[np.generic])


def describe(value: object) -> str:
    """Say in a few words what came, for an error message."""
    if isinstance(value, np.ndarray):
        array = cast("NDArray[np.generic]", value)
        return f"an array of shape {array.shape} and dtype {array.dtype}"
    text = repr(value)
    return f"{type(value).__name__} {text if len(text) <= 80 else text[:77] + '...'}"


def shape_text(shape: tuple[int | None, ...]) -> str:
    """Write a shape as NumPy prints it, with N for a free length."""
    inner = ", ".join("N" if n is None else str(n) for n in shape)
    return f"({inner},)" if len(shape) == 1 else f"({inner})"


def numbers(argument: str, value: object, shape: tuple[int | None, ...], finite: bool = True) -> Float64:
    """Return `value` as a float64 array of `shape` (None fits any length) or raise ArgumentError."""
    expected = f"{'finite ' if finite else ''}numbers of shape {shape_text(shape)}"
    try:
        array: NDArray[np.generic] = np.asarray(value)
    except (TypeError, ValueError):
        raise ArgumentError(argument, expected, describe(value)) from None
    fits = array.ndim == len(shape) and all(n in (None, m) for n, m in zip(shape, array.shape, strict=True))
    if array.dtype.kind not in "iuf" or not fits:
        raise ArgumentError(argument, expected, describe(array if array.dtype.kind != "O" else value))
    result = array.astype(np.float64)
    if finite and not np.isfinite(result).all():
        raise ArgumentError(argument, expected, f"{np.count_nonzero(~np.isfinite(result))} that are not finite")
    return result


def positive(argument: str, value: object, expected: str = "a finite number > 0") -> float:
    """Return `value` as a float > 0 or raise ArgumentError."""
    array: NDArray[np.generic] = np.asarray(value)
    if array.ndim == 0 and array.dtype.kind in "iuf":
        number = float(cast("float", value))
        if 0 < number < math.inf:
            return number
    raise ArgumentError(argument, expected, describe(value))


def locked(array: ArrayT) -> ArrayT:
    """Return a C-contiguous, unwritable view of `array`, copied only if it must be."""
    view = np.ascontiguousarray(array).view()
    view.flags.writeable = False
    return cast("ArrayT", view)


def number_from(argument: str, value: float, least: float, most: float, expected: str) -> float:
    """Return `value` as a finite float from `least` to `most` or raise ArgumentError."""
    is_number = isinstance(value, (int, float, np.number)) and not isinstance(value, bool)  # pyright: ignore[reportUnnecessaryIsInstance]
    if is_number and least <= value <= most and math.isfinite(value):
        return float(value)
    raise ArgumentError(argument, expected, repr(value))


def instance_of(argument: str, value: object, kind: type[_Kind], name: str) -> _Kind:
    """Return `value` if it is of this class, which users know by `name`, or raise ArgumentError."""
    if isinstance(value, kind):
        return value
    raise ArgumentError(argument, name, describe(value))


def true_or_false(argument: str, value: object) -> bool:
    """Return `value` if it is a bool or raise ArgumentError."""
    return instance_of(argument, value, bool, "True or False")


def whole_from(argument: str, value: int, least: int, most: int, expected: str = "") -> int:
    """Return `value` as an int from `least` to `most` or raise ArgumentError."""
    if isinstance(value, (int, np.integer)) and not isinstance(value, bool) and least <= value <= most:  # pyright: ignore[reportUnnecessaryIsInstance]
        return int(value)
    raise ArgumentError(argument, expected or f"a whole number from {least} to {most}", describe(value))


def read_only(array: Float64) -> Float64:
    """Lock `array` against writing and return it."""
    array.flags.writeable = False
    return array


def checked_size(size: object) -> tuple[int, int]:
    """Return `size` as (width, height), two ints > 0, or raise ArgumentError."""
    is_sequence = isinstance(size, (tuple, list, np.ndarray))
    values = tuple(cast("Iterable[object]", size)) if is_sequence else ()
    if len(values) == 2 and all(isinstance(v, (int, np.integer)) and not isinstance(v, bool) for v in values):
        width, height = (int(cast("int", v)) for v in values)
        if width > 0 and height > 0:
            return width, height
    raise ArgumentError("size", "(width, height), two integers > 0", describe(size))


def checked_intrinsics(K: object) -> Float64:
    """Return `K` as a new (3, 3) array or raise ArgumentError."""
    matrix = numbers("K", K, (3, 3))
    fixed = np.abs([matrix[1, 0], matrix[2, 0], matrix[2, 1], matrix[2, 2] - 1])
    if fixed.max() > 1e-9 or min(matrix[0, 0], matrix[1, 1]) <= 0:
        form = "[[fx, s, cx], [0, fy, cy], [0, 0, 1]] with fx, fy > 0"
        raise ArgumentError("K", form, str(matrix.tolist()))
    matrix[1, 0] = 0
    matrix[2] = 0, 0, 1
    return matrix


def checked_pose(world_from_camera: object) -> Float64:
    """Return a rigid motion as a new (4, 4) array or raise ArgumentError."""
    name, rigid = "world_from_camera", "a rigid motion [[R, t], [0, 0, 0, 1]] with R^T R = 1 and det R = 1"
    pose = numbers(name, world_from_camera, (4, 4))
    if np.abs(pose[3] - (0, 0, 0, 1)).max() > 1e-9:
        raise ArgumentError(name, rigid, f"last row {pose[3].tolist()}")
    rotation = pose[:3, :3]
    error = np.abs(rotation.T @ rotation - np.eye(3)).max()
    if error > 1e-5:
        raise ArgumentError(name, rigid, f"R^T R off by {error:.2g}")
    if np.linalg.det(rotation) < 0:
        raise ArgumentError(name, rigid, "det R = -1, a mirrored frame")
    pose[3] = 0, 0, 0, 1
    return pose


def one_of(argument: str, value: object, choices: Any, also: str = "") -> None:
    """Raise ArgumentError unless `value` is one of a Literal's strings."""
    if not isinstance(value, str) or value not in get_args(choices):
        expected = ", ".join(f'"{choice}"' for choice in get_args(choices))
        raise ArgumentError(argument, f"one of {expected}{also}", repr(value))


def checked_image(argument: str, color: NDArray[Any]) -> NDArray[Any]:
    """Return `color` if it is an image of three channels, or raise ArgumentError."""
    expected = "uint8, or float32 in [0, 1], of shape (h, w, 3)"
    if not isinstance(color, np.ndarray) or color.ndim != 3 or color.shape[2] != 3 or 0 in color.shape:  # pyright: ignore[reportUnnecessaryIsInstance]
        raise ArgumentError(argument, expected, describe(color))
    if color.dtype.name not in ("uint8", "float32"):
        raise ArgumentError(argument, expected, describe(color))
    return color


_TEXELS_MOST = 1 << 21  # from 0 on: float32 tells their places within half a texel, as IN_TILE of the kernels needs


def check_tiled(uv: NDArray[Any], tiles: tuple[int, int], *maps: NDArray[Any] | None) -> None:
    """Raise ArgumentError if a map's repetitions go on for longer than kernels can count its texels."""
    for image in maps:
        if image is None:
            continue
        farthest = np.abs(uv).max(axis=0) * tiles * (image.shape[1], image.shape[0])
        if (farthest > _TEXELS_MOST).any():
            size = f"{image.shape[1]}x{image.shape[0]}"
            expected = f"uv * tiles * a map's size up to {_TEXELS_MOST} texels"
            raise ArgumentError("uv", expected, f"{farthest.max():.4g} of a map of {size}")


class Fixed:
    """What is drawn from buffers on the device: its attributes cannot be set again once it is made.

    Copies and pickles leave the buffers behind.
    """

    @cached_property
    def device_cache(self) -> WeakKeyDictionary[Any, dict[str, Any]]:
        """What it has on each device, by session; see `pyibr.opencl.kept`."""
        return WeakKeyDictionary()

    def __getstate__(self) -> dict[str, object]:
        return {name: value for name, value in self.__dict__.items() if name != "device_cache"}

    def __setstate__(self, state: dict[str, object]) -> None:
        for name, value in state.items():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False
            self.__dict__[name] = value

    def __setattr__(self, name: str, value: object) -> None:
        if name in self.__dict__ or isinstance(getattr(type(self), name, None), property):
            raise AttributeError(f"{type(self).__name__}.{name} cannot be changed: make a new one")
        super().__setattr__(name, value)
