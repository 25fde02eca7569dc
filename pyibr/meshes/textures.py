"""Textures as kernels read them: a texel is a word of four bytes, red first."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def texture_pyramid(texture: NDArray[Any]) -> NDArray[np.uint32]:
    """All levels of a texture, largest first, as RGBA words: each half as large as the one before, rounded down."""
    import cv2

    level = as_bytes(texture)
    words: list[NDArray[np.uint32]] = []
    while True:
        height, width = level.shape[:2]
        words.append(rgba_words(level))
        if width == height == 1:
            return np.concatenate(words)
        level = cv2.resize(level, (max(width // 2, 1), max(height // 2, 1)), interpolation=cv2.INTER_AREA)


def rgba_words(color: NDArray[Any], valid: NDArray[np.bool_] | None = None) -> NDArray[np.uint32]:
    """An image's pixels as RGBA words in a row: a texel is one read. A is 255, or 0 where not valid."""
    import cv2

    rgba = np.asarray(cv2.cvtColor(as_bytes(color), cv2.COLOR_RGB2RGBA), np.uint8)
    if valid is not None:
        rgba[..., 3] = valid * np.uint8(255)
    return rgba.view(np.uint32).ravel()


def as_bytes(color: NDArray[Any]) -> NDArray[np.uint8]:
    """Colours in 8 bits a channel."""
    return color if color.dtype == np.uint8 else np.rint(np.clip(color, 0, 1) * np.float32(255)).astype(np.uint8)
