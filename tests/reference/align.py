"""Depth drawn for the colour camera like librealsense's `align` does, in NumPy.

Two corners of each depth pixel, the upper left and the lower right, are projected to the colour image, without lens
distortion. They span a rectangle from the first corner's pixel to the pixel before the second corner's. All its pixels
get the stored value of the depth pixel; where rectangles overlap, the least value wins. As a result, depth moves by
half a pixel to the left and up on average, and farther surfaces show through gaps in oblique surfaces.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera


def aligned(depth: NDArray[np.uint16], scale: float, depth_camera: Camera, color_camera: Camera) -> NDArray[np.uint16]:
    """Return stored depth (h, w) for the colour camera, 0 where it is unknown. scale: stored units per scene unit."""
    here, there = (Camera(c.K, c.size, c.world_from_camera) for c in (depth_camera, color_camera))
    rows, columns = np.nonzero(depth)
    stored = depth[rows, columns]
    corners = [
        there.project(here.unproject(np.column_stack([columns + aside, rows + aside]), stored / scale))[0]
        for aside in (-0.5, 0.5)
    ]
    (left, top), (right, bottom) = (np.floor(corner + 0.5).astype(int).T for corner in corners)
    width, height = there.size
    found = np.full((height, width), 2**16, np.int64)
    for down in range(int((bottom - top).max(initial=0))):
        for across in range(int((right - left).max(initial=0))):
            x, y = left + across, top + down
            inside = (x < right) & (y < bottom) & (x >= 0) & (y >= 0) & (x < width) & (y < height)
            np.minimum.at(found, (y[inside], x[inside]), stored[inside])
    return np.where(found < 2**16, found, 0).astype(np.uint16)
