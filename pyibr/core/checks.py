"""Checks of arguments that more than one module needs."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable
from functools import cached_property
from typing import Any, ClassVar, TypeVar, cast
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from pyibr.core.errors import ArgumentError

Float64 = NDArray[np.float64]

_LENGTH_MAX = 1e18
"""Scene units from the world's origin, and pixels: products of two lengths still fit into single precision."""

_Kind = TypeVar("_Kind")
ArrayT = TypeVar("ArrayT", bound=NDArray[np.generic])


def describe(value: object) -> str:
    """Describe a received value in a few words for an error message."""
    if isinstance(value, np.ndarray):
        array = cast("NDArray[np.generic]", value)
        return f"an array of shape {array.shape} and dtype {array.dtype}"
    text = " ".join(repr(value).split())
    return f"{type(value).__name__} {text if len(text) <= 80 else text[:77] + '...'}"


def shape_text(shape: tuple[int | None, ...]) -> str:
    """Write a shape as NumPy prints it, with N for a free length."""
    inner = ", ".join("N" if n is None else str(n) for n in shape)
    return f"({inner},)" if len(shape) == 1 else f"({inner})"


def plain_array(argument: str, value: object, expected: str, masked: float | None = None) -> NDArray[Any]:
    """Return `value` as an array of NumPy's own class and native byte order, without a copy if possible.

    expected: for the error message. masked: replaces masked elements; without it, or if the dtype cannot hold it, they
    are refused, because their meaning is unknown.
    """
    if _is_masked(value):
        array = cast("np.ma.MaskedArray[Any, Any]", value)
        if masked is None or not np.can_cast(np.min_scalar_type(masked), array.dtype, "same_kind"):
            count = int(np.count_nonzero(np.ma.getmaskarray(array)))
            raise ArgumentError(argument, expected, f"{describe(array)}, {count} of them masked")
        value = array.filled(masked)
    try:
        made: NDArray[Any] = np.asarray(value)
    except (TypeError, ValueError, RuntimeError):
        raise ArgumentError(argument, expected, describe(value)) from None
    return made if made.dtype.isnative else made.astype(made.dtype.newbyteorder("="))


def _is_masked(value: object) -> bool:
    """Tell whether the value is an array with masked elements."""
    # NumPy imports masked arrays on first use; plain arrays avoid that.
    if type(value) is np.ndarray or not isinstance(value, np.ndarray):
        return False
    return bool(np.ma.is_masked(cast("NDArray[Any]", value)))


def fits(array: NDArray[Any], shape: tuple[int | None, ...]) -> bool:
    """Tell whether an array has `shape`, in which None fits any length."""
    if array.shape == shape:
        return True
    return array.ndim == len(shape) and all(n in (None, m) for n, m in zip(shape, array.shape, strict=True))


def numbers(argument: str, value: object, shape: tuple[int | None, ...] | None, finite: bool = True) -> Float64:
    """Return `value` as a float64 array of `shape` (None fits any length, or any shape) or raise ArgumentError.

    Masked elements become NaN; with `finite`, they are refused.
    """
    expected = f"{'finite ' if finite else ''}numbers{f' of shape {shape_text(shape)}' if shape is not None else ''}"
    if not finite and _is_masked(value) and cast("NDArray[Any]", value).dtype.kind in "iu":
        value = cast("NDArray[Any]", value).astype(np.float64)  # integers hold no NaN
    array = plain_array(argument, value, expected, None if finite else math.nan)
    if array.dtype.kind not in "iuf" or not (shape is None or fits(array, shape)):
        raise ArgumentError(argument, expected, describe(array if array.dtype.kind != "O" else value))
    result = array.astype(np.float64)
    if finite and not np.isfinite(result).all():
        raise ArgumentError(argument, expected, f"{np.count_nonzero(~np.isfinite(result))} that are not finite")
    return result


def checked_box(argument: str, value: object) -> Float64:
    """Return `value` as the low and the high corner of a box, (2, 3), or raise ArgumentError."""
    box = numbers(argument, value, (2, 3))
    if not (box[0] < box[1]).all():
        raise ArgumentError(argument, "a box, its low corner before its high one", f"{box[0]} and {box[1]}")
    return box


def positive(argument: str, value: object, expected: str = "a finite number > 0") -> float:
    """Return `value` as a float > 0 or raise ArgumentError."""
    array = plain_array(argument, value, expected)
    if array.ndim == 0 and array.dtype.kind in "iuf":
        number = float(array)
        if 0 < number < math.inf:
            return number
    raise ArgumentError(argument, expected, describe(value))


def positive_or_infinite(argument: str, value: float, expected: str) -> float:
    """Return `value` as a float > 0, infinity included, or raise ArgumentError."""
    is_endless = isinstance(value, (float, np.floating)) and value == math.inf
    return math.inf if is_endless else positive(argument, value, expected)


def locked(array: ArrayT) -> ArrayT:
    """Return a C-contiguous, unwritable view of `array`, copied only if it must be."""
    view = np.ascontiguousarray(array).view()
    view.flags.writeable = False
    return cast("ArrayT", view)


def number_from(argument: str, value: float, minimum: float, maximum: float, expected: str) -> float:
    """Return `value` as a finite float from `minimum` to `maximum` or raise ArgumentError."""
    is_number = isinstance(value, (int, float, np.number)) and not isinstance(value, bool)  # pyright: ignore[reportUnnecessaryIsInstance]
    if is_number and minimum <= value <= maximum and math.isfinite(value):
        return float(value)
    raise ArgumentError(argument, expected, describe(value))


def instance_of(argument: str, value: object, kind: type[_Kind], name: str) -> _Kind:
    """Return `value` if it is of class `kind`, called `name` in the message, or raise ArgumentError."""
    if isinstance(value, kind):
        return value
    raise ArgumentError(argument, name, describe(value))


def byte_color(argument: str, value: object) -> NDArray[np.uint8]:
    """Return a colour (3,) of numbers from 0 to 255, rounded, or raise ArgumentError."""
    color = numbers(argument, value, (3,))
    if (color < 0).any() or (color > 255).any():
        raise ArgumentError(argument, "(r, g, b), 0 to 255", describe(value))
    return np.rint(color).astype(np.uint8)


def checked_bool(argument: str, value: object) -> bool:
    """Return a Python or NumPy bool as a bool, or raise ArgumentError."""
    if isinstance(value, np.bool_):
        return bool(cast("Any", value))
    return instance_of(argument, value, bool, "True or False")


def integer_from(argument: str, value: int, minimum: int, maximum: int, expected: str = "") -> int:
    """Return `value` as an int from `minimum` to `maximum` or raise ArgumentError."""
    if isinstance(value, (int, np.integer)) and not isinstance(value, bool) and minimum <= value <= maximum:  # pyright: ignore[reportUnnecessaryIsInstance]
        return int(value)
    raise ArgumentError(argument, expected or f"a whole number from {minimum} to {maximum}", describe(value))


def read_only(array: Float64) -> Float64:
    """Lock `array` against writing and return it."""
    array.flags.writeable = False
    return array


def checked_size(size: object, argument: str = "size", meaning: str = "(width, height)") -> tuple[int, int]:
    """Return `size` as (width, height), two ints > 0, or raise ArgumentError."""
    is_sequence = isinstance(size, (tuple, list, np.ndarray))
    values = tuple(cast("Iterable[object]", size)) if is_sequence else ()
    if len(values) == 2 and all(isinstance(v, (int, np.integer)) and not isinstance(v, bool) for v in values):
        width, height = (int(cast("int", v)) for v in values)
        if width > 0 and height > 0:
            return width, height
    raise ArgumentError(argument, f"{meaning}, two integers > 0", describe(size))


_OUTER = np.pad(np.zeros((3, 3), np.bool_), (0, 1), constant_values=True)  # the last row and column of 4 x 4


def checked_intrinsics(K: object) -> Float64:
    """Return `K`, (3, 3) or the corner of a 4 x 4 identity, as a new (3, 3) array, or raise ArgumentError."""
    matrix = numbers("K", K, None, finite=False)
    is_within = matrix.shape == (4, 4) and not np.any(matrix - np.eye(4), where=_OUTER)
    matrix = numbers("K", matrix[:3, :3] if is_within else K, (3, 3))
    fixed = np.abs([matrix[1, 0], matrix[2, 0], matrix[2, 1], matrix[2, 2] - 1])
    if fixed.max() > 1e-9 or min(matrix[0, 0], matrix[1, 1]) <= 0:
        form = "[[fx, s, cx], [0, fy, cy], [0, 0, 1]] with fx, fy > 0"
        raise ArgumentError("K", form, str(matrix.tolist()))
    matrix[1, 0] = 0
    matrix[2] = 0, 0, 1
    if np.abs(matrix).max() > _LENGTH_MAX or min(matrix[0, 0], matrix[1, 1]) < 1 / _LENGTH_MAX:
        raise ArgumentError(
            "K", f"numbers up to {_LENGTH_MAX:g}, fx, fy from {1 / _LENGTH_MAX:g} on", str(matrix.tolist())
        )
    return matrix


def warn_if_exchanged(K: Float64, size: tuple[int, int], stacklevel: int) -> None:
    """Warn if K seems to have focal lengths and principal point exchanged, which its numbers cannot prove."""
    middle, focal, center = np.array(size) / 2, np.diag(K)[:2], K[:2, 2]
    is_middle = (np.abs(focal - middle) < 0.1 * middle).all()
    if is_middle and np.ptp(center) < 0.1 * center.max() and (np.abs(center - middle) > 0.5 * middle).any():
        told = f"fx, fy = {focal[0]:g}, {focal[1]:g} and cx, cy = {center[0]:g}, {center[1]:g}"
        warnings.warn(f"K: {told} look exchanged, of a picture of {size[0]}x{size[1]}", stacklevel=stacklevel)


_EXACT, _ROUNDED = 1e-9, 1e-2  # errors of rotation matrices that are written with all digits, and with few


def checked_pose(given: object, name: str = "world_from_camera") -> Float64:
    """Return a rigid motion as a new (4, 4) array, the nearest one for rounded numbers, or raise ArgumentError."""
    rigid = "a rigid motion [[R, t], [0, 0, 0, 1]] with R^T R = 1 and det R = 1"
    pose = numbers(name, given, (4, 4))
    if np.abs(pose[3] - (0, 0, 0, 1)).max() > 1e-9:
        raise ArgumentError(name, rigid, f"last row {pose[3].tolist()}")
    rotation = pose[:3, :3]
    error = np.abs(rotation.T @ rotation - np.eye(3)).max()
    if error >= _ROUNDED:
        raise ArgumentError(name, rigid, f"R^T R off by {error:.2g}")
    if np.linalg.det(rotation) < 0:
        raise ArgumentError(name, rigid, "det R = -1, a mirrored frame")
    if error > _EXACT:
        left, _, right = np.linalg.svd(rotation)
        pose[:3, :3] = left @ right
    pose[3] = 0, 0, 0, 1
    if np.abs(pose).max() > _LENGTH_MAX:
        raise ArgumentError(name, f"positions up to {_LENGTH_MAX:g}", str(pose[:3, 3].tolist()))
    return pose


def cut_ratio_from(value: float) -> float:
    """Return the ratio of depths beyond which neighbours are cut, greater than 1, or raise ArgumentError."""
    return number_from("cut_ratio", value, math.nextafter(1.0, 2.0), math.inf, "a ratio greater than 1")


def one_of(argument: str, value: _Kind, choices: Any, also: str = "") -> _Kind:
    """Return `value` if it is one of a Literal's strings, or raise ArgumentError."""
    known = choices.__args__  # same as `typing.get_args`, which takes longer than the rest of this function
    if not isinstance(value, str) or value not in known:
        expected = ", ".join(f'"{choice}"' for choice in known)
        raise ArgumentError(argument, f"one of {expected}{also}", describe(value))
    return value


_COLOR_ROUNDING = 1e-3
"""Tolerance of float colours outside [0, 1]: a quarter of a level of 8 bits."""

_BITS_OF_ONE = int(np.float32(1).view(np.uint32))


def checked_colors(argument: str, colors: object, shape: tuple[int | None, ...]) -> NDArray[Any]:
    """Return colours of `shape` (None fits any length) as uint8 or float32 in [0, 1], or raise ArgumentError.

    Floats of another size become float32.
    """
    expected = f"uint8, or float32 in [0, 1], of shape {shape_text(shape)}"
    array = plain_array(argument, colors, expected)
    if not fits(array, shape) or 0 in array.shape or (array.dtype != np.uint8 and array.dtype.kind != "f"):
        hint = ""
        if fits(array, shape[:-1]):
            hint = ", which is gray (repeat it: np.repeat(gray[..., None], 3, -1))"
        elif fits(array, (*shape[:-1], 4)):
            hint = ", which has alpha (drop it: color[..., :3])"
        raise ArgumentError(argument, expected, describe(array if isinstance(colors, np.ndarray) else colors) + hint)
    if array.dtype == np.uint8:
        return array
    with np.errstate(over="ignore"):
        single = array.astype(np.float32, copy=False)
    # One pass: as unsigned integers, floats in [0, 1] are the smallest; negative values, infinity and NaN are larger.
    if single.view(np.uint32).max() > _BITS_OF_ONE:
        _check_unit(argument, single, expected)
    return single


def _check_unit(argument: str, colors: NDArray[np.float32], expected: str) -> None:
    """Raise ArgumentError unless floats are in [0, 1], within rounding."""
    finite = np.isfinite(colors)
    if not finite.all():
        first = ", ".join(map(str, np.argwhere(~finite)[0].tolist()))
        raise ArgumentError(
            argument, expected, f"{np.count_nonzero(~finite)} values that are not finite, the first at [{first}]"
        )
    least, most = float(colors.min()), float(colors.max())
    if least < -_COLOR_ROUNDING or most > 1 + _COLOR_ROUNDING:
        hint = "divide them by 255" if least >= 0 and 2 < most <= 255 else "clip them: np.clip(color, 0, 1)"
        raise ArgumentError(argument, expected, f"values from {least:g} to {most:g} ({hint})")


_PIXELS_MAX = 1 << 29  # kernels index samples and colour bytes with 32 bits
_SIDE_MAX = 1 << 20  # float32 resolves a sixteenth of a pixel, and bin indices of the rasteriser have 16 bits


def check_pixels(argument: str, size: tuple[int, int], side_max: int = _SIDE_MAX) -> None:
    """Raise ArgumentError if an image, (width, height), has more pixels or a longer side than kernels can index."""
    if size[0] * size[1] > _PIXELS_MAX:
        raise ArgumentError(argument, f"at most {_PIXELS_MAX} pixels", f"{size[0]} x {size[1]}")
    if max(size) > side_max:
        raise ArgumentError(argument, f"at most {side_max} pixels a side", f"{size[0]} x {size[1]}")


_LENGTH_RANGE = (1e-8, 1e9)


def check_lengths(argument: str, minimum: float, maximum: float, what: str) -> None:
    """Raise ArgumentError if all lengths are too small, or too large, for products of a few of them in float32."""
    low, high = _LENGTH_RANGE
    if maximum < 0.999 * low or minimum > high:  # the minimum may be rounded
        expected = f"{what} of {low:g} to {high:g} scene units, which single precision can draw (scale the scene)"
        raise ArgumentError(argument, expected, f"{minimum:g}" if minimum == maximum else f"{minimum:g} to {maximum:g}")


_TEXELS_MAX = 1 << 21  # largest texel position: up to it, float32 resolves half a texel, as the kernels need


def check_tiled(uv: NDArray[Any], tiles: tuple[int, int], *maps: NDArray[Any] | None) -> None:
    """Raise ArgumentError if uv repeats a map so often that kernels cannot index its texels."""
    for image in maps:
        if image is None:
            continue
        check_pixels("uv", (image.shape[1], image.shape[0]), _PIXELS_MAX)
        farthest = np.maximum(np.abs(uv).max(axis=0) * tiles, 1) * (image.shape[1], image.shape[0])
        if (farthest > _TEXELS_MAX).any():
            size = f"{image.shape[1]}x{image.shape[0]}"
            expected = f"uv * tiles * a map's size up to {_TEXELS_MAX} texels"
            raise ArgumentError("uv", expected, f"{farthest.max():.4g} of a map of {size}")


class Immutable:
    """Base of objects that are drawn from buffers on the device; their attributes cannot be reassigned.

    Copies and pickles omit the buffers.
    """

    @cached_property
    def device_cache(self) -> WeakKeyDictionary[Any, Any]:
        """Cached data on each device, by session; see `pyibr.opencl.device_cache`."""
        return self.__dict__.setdefault("device_cache", WeakKeyDictionary())  # another thread may have set it

    def __getstate__(self) -> dict[str, object]:
        return {name: value for name, value in self.__dict__.items() if name != "device_cache"}

    def __setstate__(self, state: dict[str, object]) -> None:
        for name, value in state.items():
            several = cast("dict[str, object]", value) if isinstance(value, dict) else {name: value}
            for array in several.values():
                if isinstance(array, np.ndarray):
                    array.flags.writeable = False
            self.__dict__[name] = value

    _computed: ClassVar[frozenset[str]] = frozenset({"device_cache"})  # names of properties

    def __init_subclass__(cls, **options: object) -> None:
        super().__init_subclass__(**options)
        properties = property, cached_property
        cls._computed = frozenset(name for name in dir(cls) if isinstance(getattr(cls, name, None), properties))

    def __setattr__(self, name: str, value: object) -> None:
        if name in self.__dict__ or name in self._computed:
            raise AttributeError(f"{type(self).__name__}.{name} cannot be changed: make a new one")
        super().__setattr__(name, value)
