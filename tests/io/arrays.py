"""Arrays of depth and colours, for tests of files."""

from __future__ import annotations

import numpy as np

SIZES = [(7, 13), (1, 1), (61, 37)]


def depth_of(size) -> np.ndarray:
    depth = np.random.default_rng(1).uniform(0.5, 60, size[::-1]).astype(np.float32)
    if depth.size > 1:
        depth[0, -1] = np.nan
    return depth


def color_of(size) -> np.ndarray:
    return np.random.default_rng(2).integers(0, 256, (*size[::-1], 3), dtype=np.uint8)
