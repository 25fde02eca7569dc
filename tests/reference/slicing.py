"""Objects from images in float64, for reading (Kautz & Seidel 2001, sections 4 and 5).

No slices: rays are marched in steps far finer than a slice, and where they enter is found by halving.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from pyibr.core.camera import Camera
from pyibr.images import DepthImage
from pyibr.images.silhouette import Silhouette
from pyibr.slicing.boxes import Box

Inside = Callable[[np.ndarray], np.ndarray]  # world points (N, 3) -> (N,) bool


def bilinear(image: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Between the pixels around (x, y), whose centres are at whole numbers; the border is repeated."""
    height, width = image.shape
    x, y = np.clip(x, 0, width - 1), np.clip(y, 0, height - 1)
    left, upper = np.floor(x).astype(int), np.floor(y).astype(int)
    right, lower = np.minimum(left + 1, width - 1), np.minimum(upper + 1, height - 1)
    fx, fy = x - left, y - upper
    top = (1 - fx) * image[upper, left] + fx * image[upper, right]
    bottom = (1 - fx) * image[lower, left] + fx * image[lower, right]
    return (1 - fy) * top + fy * bottom


def seen_at(camera: Camera, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Pixels x, y and depth of world points, and which of them are on the image."""
    local = (points - camera.world_from_camera[:3, 3]) @ camera.world_from_camera[:3, :3]
    z = local[:, 2]
    scale = np.where(z > 0, z, 1.0) if camera.projection == "perspective" else 1.0
    x = (camera.K[0, 0] * local[:, 0] + camera.K[0, 1] * local[:, 1]) / scale + camera.K[0, 2]
    y = camera.K[1, 1] * local[:, 1] / scale + camera.K[1, 2]
    on_image = (x >= -0.5) & (x <= camera.width - 0.5) & (y >= -0.5) & (y <= camera.height - 0.5)
    return x, y, z, on_image & ((z > 0) | (camera.projection == "orthographic"))


def nearness(z: np.ndarray, camera: Camera) -> np.ndarray:
    """Nearness, linear across the picture of a plane: 1/z of a perspective camera, -z of an orthographic one."""
    return 1 / np.maximum(z, 1e-12) if camera.projection == "perspective" else -z


def depth_object(views: Sequence[DepthImage]) -> Inside:
    """Points behind the surface of every view, within its outline, which is as a mask's.

    A surface is bilinear between the samples that have one.
    """

    def inside(points: np.ndarray) -> np.ndarray:
        left = np.arange(len(points))  # what fails a view's test is spared the others'
        for view in views:
            x, y, z, on_image = seen_at(view.camera, points[left])
            near = nearness(np.where(view.valid, view.depth, 1.0).astype(float), view.camera)
            part = bilinear(view.valid.astype(float), x, y)
            surface = bilinear(np.where(view.valid, near, 0.0), x, y) / np.maximum(part, 0.5)
            left = left[on_image & (part >= 0.5) & (nearness(z, view.camera) <= surface)]
        return np.isin(np.arange(len(points)), left)

    return inside


def visual_hull(views: Sequence[Silhouette | DepthImage]) -> Inside:
    """Points within every silhouette, whose outline is where the mask, bilinear, is a half."""

    def inside(points: np.ndarray) -> np.ndarray:
        left = np.arange(len(points))
        for view in views:
            x, y, _, on_image = seen_at(view.camera, points[left])
            left = left[on_image & (bilinear(view.valid.astype(float), x, y) >= 0.5)]
        return np.isin(np.arange(len(points)), left)

    return inside


def first_depth(inside: Inside, camera: Camera, box: Box, step: float) -> np.ndarray:
    """(H, W) depth at which each pixel's ray first enters a solid within the box, inf if never; `step` in depth."""
    y, x = np.mgrid[: camera.height, : camera.width]
    pixels = np.stack([x.ravel(), y.ravel()], axis=-1)
    at_1, at_2 = (camera.unproject(pixels, np.full(len(pixels), z)) for z in (1.0, 2.0))
    origin, direction = 2 * at_1 - at_2, at_2 - at_1  # the point of depth z is origin + z * direction

    # A ray is in the box from the last of its three entries to the first of its three exits.
    start, along = origin @ box.axes.T, direction @ box.axes.T
    along = np.where(np.abs(along) < 1e-15, 1e-15, along)
    crossings = np.stack([(box.low - start) / along, (box.high - start) / along])
    front, back = np.maximum(crossings.min(axis=0).max(axis=1), 0), crossings.max(axis=0).min(axis=1)

    depth, z = np.full(len(pixels), np.inf), front.copy()
    left = np.flatnonzero(front <= back)
    while len(left):
        hit = inside(origin[left] + z[left, None] * direction[left])
        depth[left[hit]] = z[left[hit]]
        left = left[~hit]
        z[left] += step
        left = left[z[left] <= back[left]]

    some = np.flatnonzero(np.isfinite(depth))
    behind, before = depth[some], np.maximum(depth[some] - step, front[some])
    for _ in range(12):
        middle = 0.5 * (before + behind)
        hit = inside(origin[some] + middle[:, None] * direction[some])
        behind, before = np.where(hit, middle, behind), np.where(hit, before, middle)
    depth[some] = behind
    return depth.reshape(camera.height, camera.width)
