"""Overlays: pixel classes and source views as colours, and the difference of two pictures."""

from __future__ import annotations

import colorsys

import numpy as np

from pyibr.app.view.methods import Show
from pyibr.images.frame import Frame, PixelClass
from pyibr.images.pictures import Image
from pyibr.images.srgb import in_bytes

CLASS_COLORS = {
    PixelClass.HIDDEN: (255, 140, 0),
    PixelClass.UNOBSERVED: (200, 0, 200),
    PixelClass.OUTSIDE: (60, 110, 190),
}
"""Colours of pixels that were occluded in the source, have no depth there, or lie outside its image."""

_NAMED = 16  # views in a legend
_MORE = (128, 128, 128)
_GOLDEN = 0.618033988749895  # golden ratio, in turns of the hue: keeps the hues of the first views far apart


def class_colors(frame: Frame) -> Image:
    """The picture's colours, with the holes tinted by their class (`CLASS_COLORS`)."""
    made = in_bytes(frame.color).copy()
    if frame.classes is None:
        return made
    for kind, color in CLASS_COLORS.items():
        holes = frame.classes == kind
        made[holes] = (made[holes].astype(np.uint16) + 2 * np.array(color, np.uint16)) // 3
    return made


def view_colors(frame: Frame, background: tuple[int, int, int]) -> Image:
    """The picture with a hue for each source view; unchanged if the frame has no source views."""
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
    """The colour for the view with this number."""
    red, green, blue = colorsys.hsv_to_rgb(number * _GOLDEN % 1, 0.65, 1.0)
    return round(255 * red), round(255 * green), round(255 * blue)


def legend(show: Show, views: int) -> list[tuple[tuple[int, int, int], str]]:
    """Legend of an overlay: names of classes, or numbers of the first views from 0."""
    if show == "classes":
        return [(color, kind.name.lower()) for kind, color in CLASS_COLORS.items()]
    if show != "view":
        return []
    named = [(view_color(number), str(number)) for number in range(min(views, _NAMED))]
    return named + ([(_MORE, f"to {views - 1}")] if views > _NAMED else [])


def difference(one: Image, other: Image, gain: float) -> Image:
    """The absolute difference of two pictures, multiplied by a gain."""
    apart = np.abs(one.astype(np.int16) - other.astype(np.int16))
    return np.minimum(apart * np.float32(gain), 255).astype(np.uint8)
