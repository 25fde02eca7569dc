"""Height maps in float64: a readable reference."""

from __future__ import annotations

import numpy as np


def bilinear_height(
    height: np.ndarray, u: np.ndarray, v: np.ndarray, wrap: tuple[str, str] = ("repeat", "repeat")
) -> np.ndarray:
    """Height at (u, v), interpolated between texel centres at (i + 0.5) / n; `wrap`: repeat or clamp, for u and v."""
    rows, columns = height.shape
    return bilinear(height, u * columns - 0.5, v * rows - 0.5, wrap)


def bilinear(image: np.ndarray, x: np.ndarray, y: np.ndarray, wrap: tuple[str, str] = ("clamp", "clamp")) -> np.ndarray:
    """Interpolate an image at (x, y); pixel centres are at whole numbers."""
    rows, columns = image.shape
    x0, y0 = np.floor(x).astype(int), np.floor(y).astype(int)
    fx, fy = x - x0, y - y0
    (left, right), (upper, lower) = (
        [k % n if how == "repeat" else np.clip(k, 0, n - 1) for k in (first, first + 1)]
        for first, n, how in ((x0, columns, wrap[0]), (y0, rows, wrap[1]))
    )
    top = (1 - fx) * image[upper, left] + fx * image[upper, right]
    bottom = (1 - fx) * image[lower, left] + fx * image[lower, right]
    return (1 - fy) * top + fy * bottom
