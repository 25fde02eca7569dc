"""Levels of a view's colours for targets that see it small (kernels/depthmesh/blend.cl)."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from pyibr.images import DepthImage
from pyibr.raster import as_bytes


def color_levels(view: DepthImage) -> Iterator[tuple[NDArray[np.uint8], NDArray[np.uint8]]]:
    """Colours (h, w, 3) of a view's samples and 255 times the part of each texel that has some, down to 1x1."""
    color = as_bytes(view.color)
    yield color, np.where(view.valid, 255, 0).astype(np.uint8)
    part = view.valid.astype(np.float32)
    sums = color * part[..., None]
    while max(part.shape) > 1:
        part, sums = _halved(part), _halved(sums)
        mean = sums / np.maximum(part, 1e-6)[..., None]
        yield np.rint(mean).astype(np.uint8), np.ceil(255 * part).astype(np.uint8)


def _halved(image: NDArray[np.float32]) -> NDArray[np.float32]:
    """Means of 2x2, the last column and row of odd ones twice."""
    height, width = image.shape[:2]
    even = np.pad(image, ((0, height % 2), (0, width % 2), *(((0, 0),) * (image.ndim - 2))), mode="edge")
    return 0.25 * (even[::2, ::2] + even[1::2, ::2] + even[::2, 1::2] + even[1::2, 1::2])
