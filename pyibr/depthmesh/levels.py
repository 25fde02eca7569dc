"""Levels of a view's colours for targets that see it small (kernels/depthmesh/blend.cl)."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from pyibr.core.checks import Float64
from pyibr.images import DepthImage
from pyibr.meshes.textures import halved, rgba_words


def color_levels(view: DepthImage, gains: Float64 | None = None) -> Iterator[NDArray[np.uint32]]:
    """RGBA words (h, w) of a view's samples, A = 255 times the part of each texel that has some, down to 1x1.

    Colours are multiplied by the `gains` (3,).
    """
    height, width = view.valid.shape
    shown = view.shown_color
    if gains is not None:
        most = 255 if shown.dtype == np.uint8 else 1
        shown = np.clip(shown * (gains / most), 0, 1).astype(np.float32)
    words = rgba_words(shown, view.valid).reshape(height, width)
    yield words
    sound = np.where(view.valid, words, np.uint32(0)).view(np.uint8).reshape(height, width, 4)
    level = sound.astype(np.float32)  # colours times the part, and the part
    while max(level.shape[:2]) > 1:
        height, width = level.shape[:2]
        level = halved(np.pad(level, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge"))
        rgba = np.ceil(level).astype(np.uint8)
        rgba[..., :3] = np.rint(level[..., :3] * (255 / np.maximum(level[..., 3:], np.float32(1e-3))))
        yield rgba.view(np.uint32)[..., 0]
