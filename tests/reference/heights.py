"""Height maps in float64: a readable reference."""

from __future__ import annotations

import numpy as np


def bilinear_height(
    height: np.ndarray, u: np.ndarray, v: np.ndarray, wrap: tuple[str, str] = ("repeat", "repeat")
) -> np.ndarray:
    """Height at (u, v), interpolated between texel centres at (i + 0.5) / n; `wrap`: repeat or clamp, for u and v."""
    rows, columns = height.shape
    x, y = u * columns - 0.5, v * rows - 0.5
    x0, y0 = np.floor(x).astype(int), np.floor(y).astype(int)
    fx, fy = x - x0, y - y0
    (left, right), (upper, lower) = (
        [k % n if how == "repeat" else np.clip(k, 0, n - 1) for k in (first, first + 1)]
        for first, n, how in ((x0, columns, wrap[0]), (y0, rows, wrap[1]))
    )
    top = (1 - fx) * height[upper, left] + fx * height[upper, right]
    bottom = (1 - fx) * height[lower, left] + fx * height[lower, right]
    return (1 - fy) * top + fy * bottom
