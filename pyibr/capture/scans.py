"""Depth images of scans: point grids from a scanner that sweeps over an object."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pyibr.capture.raycast import MeshScene
from pyibr.core.camera import Camera
from pyibr.core.checks import describe, numbers, plain_array, positive
from pyibr.core.errors import ArgumentError
from pyibr.core.optional import opencv
from pyibr.images import DepthImage


def scan_view(
    points: NDArray[np.float32],
    world_from_scan: ArrayLike | None = None,
    *,
    pixel: float | None = None,
    step: float = 8.0,
) -> DepthImage:
    """Make a depth image of a scan, with an orthographic camera that looks along the scanner's -z.

    Parameters
    ----------
    points : (rows, columns, 3) float32
        Points in the scanner's frame; NaN where it saw nothing (`pyibr.io.read_range_grid`).
    world_from_scan : array_like (4, 4), optional
        The scanner's pose.
    pixel : float, optional
        Size of a pixel, in scene units. Default: the median step between neighbours of a row.
    step : float
        Neighbours farther apart than this many pixels are not joined by the surface.

    Returns
    -------
    DepthImage
        Shaded grey. Depth is infinite outside the scan's outline, and NaN in its holes, where the surface is unknown.

    Raises
    ------
    ArgumentError
        If `points` is not a grid, has no two joined neighbours, or is seen edge-on.
    MissingPackageError
        If OpenCV is not installed.
    """
    cv2 = opencv("scan_view", "connectedComponentsWithStats")
    points = plain_array("points", points, "floats of shape (rows, columns, 3)", np.nan)
    if points.ndim != 3 or points.shape[2] != 3 or points.dtype.kind != "f":
        raise ArgumentError("points", "floats of shape (rows, columns, 3)", describe(points))
    between = np.linalg.norm(np.diff(points[..., :2], axis=1), axis=2)
    if pixel is None:
        if np.isnan(between).all():
            raise ArgumentError("points", "neighbours that are joined", "none")
        pixel = float(np.nanmedian(between))
    if not float(numbers("pixel", pixel, (), finite=False)) > 0:
        raise ArgumentError("pixel", "a size > 0 (the default needs neighbours in a row that lie apart)", f"{pixel:g}")
    farthest = positive("step", step) * pixel
    rows, columns = points.shape[:2]
    y, x = np.mgrid[: rows - 1, : columns - 1]
    first: NDArray[np.int64] = (y * columns + x).ravel()
    right, down, across = first + 1, first + columns, first + columns + 1
    faces = np.concatenate([np.stack([first, down, right], 1), np.stack([right, down, across], 1)])
    corner = points.reshape(-1, 3).astype(np.float64)[faces]
    longest = np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2).max(axis=1)
    faces = faces[longest <= farthest]  # a NaN corner compares false
    if not len(faces):
        raise ArgumentError("points", "neighbours that are joined", "none")
    used, numbered = np.unique(faces, return_inverse=True)
    own = points.reshape(-1, 3)[used].astype(np.float64)
    pose = np.eye(4) if world_from_scan is None else numbers("world_from_scan", world_from_scan, (4, 4))
    scene = MeshScene(own @ pose[:3, :3].T + pose[:3, 3], numbered.reshape(-1, 3), base_color=(215, 215, 215))

    low, high = own.min(axis=0), own.max(axis=0)
    width, height = (int(np.ceil(extent / pixel)) + 3 for extent in (high - low)[:2])
    K = [[1 / pixel, 0, (width - 1) / 2], [0, 1 / pixel, (height - 1) / 2], [0, 0, 1]]
    scan_from_camera = np.diag([1.0, -1.0, -1.0, 1.0])
    scan_from_camera[:3, 3] = *(0.5 * (low + high))[:2], high[2] + pixel
    try:
        view = scene.capture(Camera(K, (width, height), pose @ scan_from_camera, projection="orthographic"))
    except ArgumentError as error:
        if error.argument != "camera":
            raise
        raise ArgumentError(
            "points", "a surface that is seen along the scanner's -z", "one seen from its edge"
        ) from None
    found = cv2.connectedComponentsWithStats((~view.valid).astype(np.uint8), connectivity=4)
    region, statistics = np.asarray(found[1], np.int64), np.asarray(found[2], np.int64)
    left, top = statistics[:, cv2.CC_STAT_LEFT], statistics[:, cv2.CC_STAT_TOP]
    right, bottom = left + statistics[:, cv2.CC_STAT_WIDTH], top + statistics[:, cv2.CC_STAT_HEIGHT]
    is_hole = (left > 0) & (top > 0) & (right < width) & (bottom < height)
    depth = np.where(view.valid, view.depth, np.where(is_hole[region], np.nan, np.inf)).astype(np.float32)
    return DepthImage(view.color, depth, view.camera)
