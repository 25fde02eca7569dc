"""Levels of a view's colours for targets that see it small (kernels/depthmesh/blend.cl)."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from pyibr.images import DepthImage
from pyibr.meshes.textures import rgba_words


def color_levels(view: DepthImage) -> Iterator[NDArray[np.uint32]]:
    """RGBA words (h, w) of a view's samples, A = 255 times the part of each texel that has some, down to 1x1."""
    height, width = view.valid.shape
    words = rgba_words(view.color, view.valid).reshape(height, width)
    yield words
    sound = np.where(view.valid, words, np.uint32(0)).view(np.uint8).reshape(height, width, 4)
    level = sound.astype(np.float32)  # colours times the part, and the part
    while max(level.shape[:2]) > 1:
        level = _halved(level)
        rgba = np.ceil(level).astype(np.uint8)
        rgba[..., :3] = np.rint(level[..., :3] * (255 / np.maximum(level[..., 3:], np.float32(1e-3))))
        yield rgba.view(np.uint32)[..., 0]


def _halved(image: NDArray[np.float32]) -> NDArray[np.float32]:
    """Means of 2x2, the last column and row of odd ones twice."""
    import cv2

    height, width = image.shape[:2]
    even = image
    if height % 2 or width % 2:
        even = cv2.copyMakeBorder(image, 0, height % 2, 0, width % 2, cv2.BORDER_REPLICATE)
    halved = cv2.resize(even, (-(-width // 2), -(-height // 2)), interpolation=cv2.INTER_AREA)
    return np.asarray(halved, np.float32)
