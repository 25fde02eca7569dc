"""Height maps over a mesh's uv, for sliced surfaces and reliefs: their checks and samples."""

from __future__ import annotations

from typing import Any, Literal, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pyibr.core.checks import (
    Immutable,
    check_tiled,
    checked_colors,
    describe,
    instance_of,
    locked,
    numbers,
    one_of,
    plain_array,
    positive,
)
from pyibr.core.errors import ArgumentError
from pyibr.meshes.mesh import Mesh

Float32 = NDArray[np.float32]
Wrap = Literal["repeat", "clamp"]
Wraps = tuple[Wrap, Wrap]  # along u and along v


class Heights(Immutable):
    """Heights of a surface, the part that an animation replaces."""

    def __init__(self, values: Float32) -> None:
        self.values = values


class HeightMapped(Immutable):
    """A mesh with heights, colours and optional normals over its uv, as `SlicedSurface` and `ReliefSurface` have."""

    def __init__(
        self,
        base: Mesh,
        height: NDArray[Any],
        color: NDArray[Any],
        scale: float,
        tiles: tuple[int, int],
        normal_map: NDArray[Any] | None,
        wrap: Wrap | Wraps,
    ) -> None:
        instance_of("base", base, Mesh, "a pyibr.Mesh")
        if base.uv is None:
            raise ArgumentError("base", "a mesh with uv", f"{base!r} without")
        self.base = base
        self.heights = Heights(checked_height(height))
        self.color = locked(checked_colors("color", color, (None, None, 3)))
        self.scale = positive("scale", scale)
        self.wrap: Wraps = checked_wrap(wrap)
        self.tiles = checked_tiles(tiles, self.wrap)
        self.normal_map = None if normal_map is None else checked_normal_map(normal_map)
        check_tiled(base.uv, self.tiles, self.height, self.color, self.normal_map)

    @property
    def height(self) -> Float32:
        """(h, w) heights in [0, 1]."""
        return self.heights.values


def checked_height(height: NDArray[Any]) -> Float32:
    """Heights as float32 in [0, 1]; integers are divided by their type's maximum."""
    expected = "heights in [0, 1] of shape (h, w), float32, or uint8 or uint16"
    given, height = height, plain_array("height", height, expected)
    if height.ndim != 2 or 0 in height.shape:
        raise ArgumentError("height", expected, describe(given))
    if height.dtype.name in ("uint8", "uint16"):
        return np.ascontiguousarray(height / np.float32(np.iinfo(height.dtype).max), np.float32)
    if height.dtype.kind != "f":
        raise ArgumentError("height", expected, describe(given))
    if not (np.isfinite(height).all() and height.min() >= 0 and height.max() <= 1):
        raise ArgumentError("height", "heights in [0, 1]", f"{np.min(height):g} to {np.max(height):g}")
    return np.ascontiguousarray(height, np.float32)


def height_pairs(height: Float32, wrap: Wraps) -> NDArray[np.uint32]:
    """(h, w) words of two 16-bit heights: a texel's in the low bits, its right neighbour's in the high bits."""
    fixed = np.rint(height * np.float32(65535)).astype(np.uint32)
    return fixed | following(fixed, 1, wrap) << np.uint32(16)


def following(values: NDArray[Any], axis: int, wrap: Wraps) -> NDArray[Any]:
    """Each texel's next one along an axis, 0 down (v) or 1 across (u); the last wraps around or, clamped, repeats."""
    count: int = values.shape[axis]
    order = np.arange(1, count + 1)
    order[-1] = 0 if wrap[1 - axis] == "repeat" else count - 1
    return values.take(order, axis=axis)


def height_at(height: Float32, uv: NDArray[np.float64], wrap: Wraps) -> NDArray[np.float64]:
    """The bilinear heights (...) at positions (..., 2), u and v."""
    rows, columns = height.shape
    (x, fx), (y, fy) = (np.divmod(uv[..., axis] * n - 0.5, 1) for axis, n in ((0, columns), (1, rows)))
    across, down = (
        [k % n if how == "repeat" else k.clip(0, n - 1) for k in (first.astype(int), first.astype(int) + 1)]
        for first, n, how in ((x, columns, wrap[0]), (y, rows, wrap[1]))
    )
    (aa, ab), (ba, bb) = ([height[row, column].astype(np.float64) for column in across] for row in down)
    return (1 - fy) * ((1 - fx) * aa + fx * ab) + fy * ((1 - fx) * ba + fx * bb)


def checked_normal_map(normal_map: NDArray[Any]) -> Float32:
    """Unit normals in tangent space; bytes are decoded as x / 127.5 - 1."""
    expected = "normals in tangent space of shape (h, w, 3), floats or uint8 (0 is -1, 255 is 1), z > 0"
    array = plain_array("normal_map", normal_map, expected)
    if (
        array.ndim != 3
        or array.shape[2] != 3
        or 0 in array.shape
        or not (array.dtype.kind == "f" or array.dtype == np.uint8)
    ):
        raise ArgumentError("normal_map", expected, describe(normal_map))
    with np.errstate(over="ignore"):
        single = np.ascontiguousarray(array, np.float32)
    if array.dtype == np.uint8:
        single = single / np.float32(127.5) - np.float32(1)
        single[..., 2][np.abs(single[..., 2]) < 0.004] = 1e-3  # 127 and 128 both mean 0
    if not np.isfinite(single).all():
        raise ArgumentError("normal_map", expected, "values that are not finite")
    below = int(np.count_nonzero(single[..., 2] <= 0))
    if below:
        raise ArgumentError("normal_map", expected, f"{below} of {single.shape[0] * single.shape[1]} with z <= 0")
    return single


def checked_wrap(wrap: Wrap | Wraps) -> Wraps:
    """Wrap modes of a map along u and along v, for uv outside 0 to 1."""
    both = (wrap, wrap) if isinstance(wrap, str) else wrap
    if not isinstance(both, tuple) or len(both) != 2:  # pyright: ignore[reportUnnecessaryIsInstance]
        raise ArgumentError("wrap", '"repeat" or "clamp", or a pair of these', describe(wrap))
    for one in both:
        one_of("wrap", one, Wrap, ", or a pair of these")
    return both


def checked_tiles(tiles: tuple[int, int], wrap: Wraps, name: str = "tiles") -> tuple[int, int]:
    """Repetitions of a map along u and v; a clamped map has none."""
    pair = numbers(name, cast("ArrayLike", tiles), (2,))
    if (pair < 1).any() or (pair != np.rint(pair)).any():
        raise ArgumentError(name, "two whole numbers >= 1", describe(tiles))
    if any(how == "clamp" and count != 1 for how, count in zip(wrap, pair, strict=True)):
        raise ArgumentError(name, '1 along an axis with wrap="clamp", which does not repeat', describe(tiles))
    return int(pair[0]), int(pair[1])
