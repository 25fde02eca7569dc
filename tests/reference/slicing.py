"""Objects from depth images in float64, for reading (Kautz & Seidel 2001, section 4)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pyibr.camera import Camera


def bilinear(image: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Between the pixels around (x, y), whose centres are at whole numbers; the border is repeated."""
    height, width = image.shape
    x, y = np.clip(x, 0, width - 1), np.clip(y, 0, height - 1)
    x0, y0 = np.minimum(np.floor(x).astype(int), width - 2), np.minimum(np.floor(y).astype(int), height - 2)
    fx, fy = x - x0, y - y0
    top = (1 - fx) * image[y0, x0] + fx * image[y0, x0 + 1]
    bottom = (1 - fx) * image[y0 + 1, x0] + fx * image[y0 + 1, x0 + 1]
    return (1 - fy) * top + fy * bottom


def inside(points: np.ndarray, cameras: Sequence[Camera], maps: Sequence[np.ndarray]) -> np.ndarray:
    """Whether world points (N, 3) lie on every image and behind its surface: nearness at most the map's."""
    passed = np.ones(len(points), bool)
    for camera, nearness in zip(cameras, maps, strict=True):
        left = np.flatnonzero(passed)
        u, v, w, q = (
            camera.pixel_matrix @ camera.camera_from_world @ np.column_stack([points[left], np.ones(len(left))]).T
        )
        x, y = u / w, v / w
        on_image = (w > 0) & (x >= -0.5) & (x <= camera.width - 0.5) & (y >= -0.5) & (y <= camera.height - 0.5)
        passed[left] = on_image & (q / w <= bilinear(nearness.astype(np.float64), x, y))
    return passed


def first_depth(
    camera: Camera, cameras: Sequence[Camera], maps: Sequence[np.ndarray], near: float, far: float, steps: int
) -> np.ndarray:
    """(H, W) depth at which each pixel's ray enters the object first: marched in steps, then halved; inf if never."""
    y, x = np.mgrid[: camera.height, : camera.width]
    pixels = np.stack([x.ravel(), y.ravel()], axis=-1)
    depth, found = np.full(len(pixels), np.inf), np.zeros(len(pixels), bool)
    step = (far - near) / steps
    for z in near + step * np.arange(steps + 1):
        left = np.flatnonzero(~found)
        hit = left[inside(camera.unproject(pixels[left], np.full(len(left), z)), cameras, maps)]
        depth[hit], found[hit] = z, True
    some = np.flatnonzero(found)
    before, behind = depth[some] - step, depth[some].copy()
    for _ in range(20):
        middle = 0.5 * (before + behind)
        is_in = inside(camera.unproject(pixels[some], middle), cameras, maps)
        behind, before = np.where(is_in, middle, behind), np.where(is_in, before, middle)
    depth[some] = behind
    return depth.reshape(camera.height, camera.width)
