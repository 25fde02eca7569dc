"""Overlays: depth, classes and origins of a picture as colours."""

from __future__ import annotations

import colorsys
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.app.view.style import Show
from pyibr.images.frame import Frame, PixelClass

Image = NDArray[np.uint8]

CLASS_COLORS = {
    PixelClass.HIDDEN: (255, 140, 0),
    PixelClass.UNOBSERVED: (200, 0, 200),
    PixelClass.OUTSIDE: (60, 110, 190),
}
"""Of what was hidden from the source, what it has no depth for, and what lies outside of its image."""

_STOPS: NDArray[np.float64] = np.array(
    [(10, 10, 60), (40, 40, 160), (20, 130, 170), (70, 180, 90), (230, 210, 60), (255, 255, 230)], np.float64
)
_RAMP = np.column_stack(
    [
        np.interp(np.linspace(0, len(_STOPS) - 1, 256), np.arange(len(_STOPS)), _STOPS[:, channel])
        for channel in range(3)
    ]
).astype(np.uint8)
"""(256, 3) colours from far to near."""

_NAMED = 16  # views in a legend
_MORE = (128, 128, 128)
_GOLDEN = 0.618033988749895  # turns of the hue that never come near one another early
_ENDS = (1.0, 99.0)  # per cent of the pixels between which the ramp lies: what is far out does not count


def in_bytes(color: NDArray[Any]) -> Image:
    """(H, W, 3) colours as uint8; white for (H, W, 0), depth alone."""
    if color.shape[2] == 0:
        return np.full((*color.shape[:2], 3), 255, np.uint8)
    if color.dtype == np.uint8:
        return color
    return np.rint(np.clip(np.nan_to_num(color), 0, 1) * np.float32(255)).astype(np.uint8)


def depth_colors(frame: Frame, background: tuple[int, int, int]) -> Image:
    """Depth as colours, light is near; even in 1 / depth for a perspective camera, as disparities are."""
    depth = frame.depth
    seen = np.isfinite(depth)
    with np.errstate(divide="ignore", invalid="ignore"):
        near = 1 / depth if frame.camera.projection == "perspective" else -depth
    made = np.empty((*depth.shape, 3), np.uint8)
    made[:] = background
    if seen.any():
        low, high = np.percentile(near[seen][:: max(seen.sum() // 4096, 1)], _ENDS)
        level = (near[seen] - low) * (255 / max(high - low, 1e-30))
        made[seen] = _RAMP[np.clip(level, 0, 255).astype(np.uint8)]
    return made


def class_colors(frame: Frame) -> Image:
    """The colours where something was seen; where not, why not (`CLASS_COLORS`), over what was filled in there."""
    made = in_bytes(frame.color).copy()
    if frame.classes is None:
        return made
    for kind, color in CLASS_COLORS.items():
        holes = frame.classes == kind
        made[holes] = (made[holes].astype(np.uint16) + 2 * np.array(color, np.uint16)) // 3
    return made


def view_colors(frame: Frame, background: tuple[int, int, int]) -> Image:
    """A colour for each view that pixels come from, as dark and light as the picture; its own ones if none is told."""
    if frame.view is None:
        return in_bytes(frame.color)
    made = np.empty((*frame.depth.shape, 3), np.uint8)
    made[:] = background
    seen = frame.view >= 0
    number = frame.view[seen]
    colors = np.array([view_color(one) for one in range(int(number.max(initial=0)) + 1)])
    grey = in_bytes(frame.color)[seen].mean(axis=1, keepdims=True) / 255
    made[seen] = (colors[number] * (0.45 + 0.55 * grey)).astype(np.uint8)
    return made


def view_color(number: int) -> tuple[int, int, int]:
    """The colour that stands for the view of a number."""
    red, green, blue = colorsys.hsv_to_rgb(number * _GOLDEN % 1, 0.65, 1.0)
    return round(255 * red), round(255 * green), round(255 * blue)


def legend(show: Show, views: int) -> list[tuple[tuple[int, int, int], str]]:
    """Name the colours of an overlay: classes by their names, views by their numbers from 0, the first of many."""
    if show == "classes":
        return [(color, kind.name.lower()) for kind, color in CLASS_COLORS.items()]
    if show != "view":
        return []
    named = [(view_color(number), str(number)) for number in range(min(views, _NAMED))]
    return named + ([(_MORE, f"to {views - 1}")] if views > _NAMED else [])


def difference(one: Image, other: Image, gain: float) -> Image:
    """The absolute difference of two pictures, times a gain."""
    apart = np.abs(one.astype(np.int16) - other.astype(np.int16))
    return np.minimum(apart * np.float32(gain), 255).astype(np.uint8)
