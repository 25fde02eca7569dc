"""Height maps in float64, for reading."""

from __future__ import annotations

import numpy as np


def bilinear_height(height: np.ndarray, u: np.ndarray, v: np.ndarray, wrap: str = "repeat") -> np.ndarray:
    """Height at (u, v), repeated or clamped beyond 0 to 1; texel centres are at (i + 0.5) / n."""
    rows, columns = height.shape
    x, y = u * columns - 0.5, v * rows - 0.5
    x0, y0 = np.floor(x).astype(int), np.floor(y).astype(int)
    fx, fy = x - x0, y - y0
    if wrap == "repeat":
        left, right, upper, lower = x0 % columns, (x0 + 1) % columns, y0 % rows, (y0 + 1) % rows
    else:
        left, right = (np.clip(x, 0, columns - 1) for x in (x0, x0 + 1))
        upper, lower = (np.clip(y, 0, rows - 1) for y in (y0, y0 + 1))
    top = (1 - fx) * height[upper, left] + fx * height[upper, right]
    bottom = (1 - fx) * height[lower, left] + fx * height[lower, right]
    return (1 - fy) * top + fy * bottom
