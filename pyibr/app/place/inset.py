"""The chosen frustum's own picture in a corner of the page, and the position of the brush on it."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pyibr.images import DepthImage

Kind = Literal["colors", "depth", "disparity"]
Image = NDArray[np.uint8]

_WIDTH_SHARE = 0.36  # fraction of the page's height
_SIDE_MAX = 320  # pixels
_FRAME = 2
_PAINT = (200, 0, 200)
_BACKGROUND = (70, 70, 80)


def inset_box(size: tuple[int, int]) -> tuple[int, int, int]:
    """Left, top and side of the picture in the lower left corner of a page of (width, height) pixels."""
    width, height = size
    side = max(min(round(_WIDTH_SHARE * height), round(0.45 * width), _SIDE_MAX), 1)
    gap = max(min(8, width - side, height - side), 0)
    return min(gap, width - side), max(height - side - gap, 0), side


def inset_position(size: tuple[int, int], at: tuple[float, float]) -> tuple[float, float] | None:
    """Convert a position in widths and heights of the page to the picture's; None outside the picture."""
    left, top, side = inset_box(size)
    x, y = (at[0] * size[0] - left) / side, (at[1] * size[1] - top) / side
    return (x, y) if 0 <= x <= 1 and 0 <= y <= 1 else None


def own_picture(view: DepthImage, kind: Kind, mask: NDArray[np.bool_]) -> Image:
    """(H, W, 3): a frustum's colours, depth or disparity (near is light), with the paint on top."""
    made = np.empty((*view.depth.shape, 3), np.uint8)
    made[:] = _BACKGROUND
    seen = view.valid
    if kind == "colors":
        made[seen] = (
            view.shown_color[seen] if view.shown_color.dtype == np.uint8 else np.rint(255 * view.shown_color[seen])
        )
    elif seen.any():
        values = view.depth[seen].astype(np.float64)
        values = -values if kind == "depth" else 1 / values
        low, high = values.min(), values.max()
        made[seen] = (20 + 235 * (values - low) / max(high - low, 1e-30)).astype(np.uint8)[:, None]
    made[mask] = _PAINT
    return made


def draw_inset(picture: Image, own: Image, full: tuple[int, int]) -> None:
    """Draw a frustum's picture into the page's picture.

    full: size of the page in pixels; its picture is smaller while the camera moves.
    """
    height, width = picture.shape[:2]
    left, top, side = (round(value * width / full[0]) for value in inset_box(full))
    side = min(side, width - left, height - top)
    if side < 1:
        return
    frame = max(round(_FRAME * width / full[0]), 1)
    picture[max(top - frame, 0) : top + side + frame, max(left - frame, 0) : left + side + frame] = 255
    rows = [number * own.shape[0] // side for number in range(side)]
    columns = [number * own.shape[1] // side for number in range(side)]
    picture[top : top + side, left : left + side] = own[np.ix_(rows, columns)]
