"""Textures in the kernels' form: a texel is a word of four bytes, red first."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.images.srgb import in_bytes


def texture_pyramid(texture: NDArray[Any]) -> NDArray[np.uint32]:
    """All levels of a texture as RGBA words, largest first; each is half as large as the last, rounded down."""
    level = in_bytes(texture)
    words: list[NDArray[np.uint32]] = []
    while True:
        height, width = level.shape[:2]
        words.append(rgba_words(level))
        if width == height == 1:
            return np.concatenate(words)
        level = np.floor(halved(level) + np.float32(0.5)).astype(np.uint8)


def normal_pyramid(normal_map: NDArray[np.float32]) -> NDArray[np.float32]:
    """All levels of a normal map (h, w, 3), largest first: means, which are shorter where normals differ."""
    levels = [normal_map]
    while max(levels[-1].shape[:2]) > 1:
        levels.append(halved(levels[-1]))
    return np.concatenate([level.ravel() for level in levels])


def halved(image: NDArray[Any]) -> NDArray[np.float32]:
    """(h, w, ...) at half the size, rounded down but at least 1: means over the covered texels."""
    return _halved_rows(_halved_rows(image).swapaxes(0, 1)).swapaxes(0, 1)


def _halved_rows(image: NDArray[Any]) -> NDArray[np.float32]:
    count = len(image) // 2
    if count == 0:
        return image.astype(np.float32)
    first, second = image[0 : 2 * count : 2], image[1 : 2 * count : 2]
    if len(image) == 2 * count:
        return np.float32(0.5) * np.add(first, second, dtype=np.float32)
    # A new row covers 2 + 1 / count old rows: one whole row, and parts of its two neighbours.
    part = (np.arange(1, count + 1) / len(image)).reshape((count,) + (1,) * (image.ndim - 1)).astype(np.float32)
    whole, both = np.float32(count / len(image)), np.float32((count + 1) / len(image))
    return np.asarray((both - part) * first + whole * second + part * image[2::2], np.float32)


def rgba_words(color: NDArray[Any], valid: NDArray[np.bool_] | None = None) -> NDArray[np.uint32]:
    """An image's pixels as a flat array of RGBA words, one read each. A is 255, or 0 where not valid."""
    rgba = np.empty((*color.shape[:2], 4), np.uint8)
    color = in_bytes(color)
    for channel in range(3):  # one by one takes a fifth of the time
        rgba[..., channel] = color[..., channel]
    rgba[..., 3] = 255 if valid is None else valid * np.uint8(255)
    return rgba.view(np.uint32).ravel()
