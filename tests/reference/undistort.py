"""Undistorted depth images in float64: the twin of kernels/picture/undistort.cl; OpenCV computes the lens."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

import pyibr as ibr
from tests import truth


def undistorted(
    view: ibr.DepthImage, camera: ibr.Camera, cut_ratio: float | None, linear: bool
) -> tuple[NDArray[Any], NDArray[np.float64], NDArray[np.bool_]]:
    """Colour and depth of a view with a lens as a pinhole camera of the same pose sees them, and the certain pixels.

    A pixel is not certain if the rounding of its float32 position decides which sample or triangle it shows.
    """
    height, width = view.depth.shape
    pixels = np.stack(np.meshgrid(*map(np.arange, camera.size)), -1).reshape(-1, 2)
    ideal = (pixels - camera.K[:2, 2]) / np.diag(camera.K)[:2]
    x, y = (truth.bent(view.camera, ideal) @ view.camera.K[:2, :2].T + view.camera.K[:2, 2]).T
    inside = (x >= -0.75) & (y >= -0.75) & (x <= width - 0.25) & (y <= height - 0.25)
    x, y = np.clip(np.where(inside, x, 0), 0, width - 1), np.clip(np.where(inside, y, 0), 0, height - 1)
    left, top = np.minimum(x.astype(int), max(width - 2, 0)), np.minimum(y.astype(int), max(height - 2, 0))
    right, below = np.minimum(left + 1, width - 1), np.minimum(top + 1, height - 1)
    fx, fy = x - left, y - top
    lower = fx + fy > 1
    corners = (np.where(lower, below, top), np.where(lower, right, left)), (top, right), (below, left)
    beside, under = np.where(lower, 1 - fy, fx), np.where(lower, 1 - fx, fy)
    weights = 1 - beside - under, beside, under

    with np.errstate(divide="ignore", invalid="ignore"):
        nearness = np.where(view.valid, 1 / view.depth.astype(np.float64), 0)
        q = np.array([nearness[corner] for corner in corners])
        whole = (q.min(axis=0) > 0) & (True if cut_ratio is None else q.max(axis=0) <= cut_ratio * q.min(axis=0))
        planar = 1 / (np.array(weights) * q).sum(axis=0)
    nearest = np.where(fy >= 0.5, below, top), np.where(fx >= 0.5, right, left)
    depth = np.where(whole, planar, view.depth[nearest])
    color = view.color[nearest].astype(np.float64)
    if linear:
        mixed = sum(weight[:, None] * view.color[corner] for weight, corner in zip(weights, corners, strict=True))
        color[whole] = mixed[whole]
    depth[~inside], color[~inside] = np.nan, 0
    close = np.minimum(np.minimum(np.abs(fx - 0.5), np.abs(fy - 0.5)), np.abs(fx + fy - 1)) < 1e-3
    if cut_ratio is not None:
        close |= np.abs(q.max(axis=0) - cut_ratio * q.min(axis=0)) < 1e-5 * q.max(axis=0)
    shape = camera.height, camera.width
    return color.reshape(*shape, -1), depth.reshape(shape), ~close.reshape(shape)
