"""Normals from a depth image, as kernels/picture/normals.cl computes them, sample by sample in float64."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pyibr.images import DepthImage


def fitted_normals(view: DepthImage, radius: int, cut_ratio: float = 1.05) -> NDArray[np.float64]:
    """Normals (H, W, 3), camera's frame, of planes fitted to the nearness around each sample; NaN without a sample."""
    camera, K = view.camera, view.camera.K
    perspective = camera.projection == "perspective"
    longer = max(camera.width / K[0, 0], camera.height / K[1, 1])
    z, found = view.depth.astype(np.float64), np.full((*view.depth.shape, 3), np.nan)
    for y, x in np.argwhere(view.valid):
        rows, columns = (slice(max(at - radius, 0), at + radius + 1) for at in (y, x))
        around = z[rows, columns]
        low, high = np.minimum(around, z[y, x]), np.maximum(around, z[y, x])
        near = high <= cut_ratio * low if perspective else high - low <= (cut_ratio - 1) * longer
        near &= view.valid[rows, columns]
        v, u = np.add(np.argwhere(near), (rows.start, columns.start)).T
        nearness = 1 / around[near] if perspective else -around[near]
        terms = np.column_stack([u - x, v - y, np.ones(len(u))])
        gx, gy, _ = np.linalg.lstsq(terms, nearness, rcond=None)[0]  # if all samples lie on one line, the least slope
        if perspective:
            plane = np.array([gx, gy, 1 / z[y, x] - gx * x - gy * y]) @ K
        else:
            plane = np.array([gx * K[0, 0], gx * K[0, 1] + gy * K[1, 1], 1.0])
        found[y, x] = -plane / np.linalg.norm(plane)
    return found
