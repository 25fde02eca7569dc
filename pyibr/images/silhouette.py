"""Images with the object's outline instead of depth."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera
from pyibr.core.checks import Immutable, checked_colors, describe, instance_of, locked, plain_array
from pyibr.core.errors import ArgumentError
from pyibr.images.depth_image import DepthImage


class Silhouette(Immutable):
    """An image with the object's outline instead of depth, and the camera that took it.

    Parameters
    ----------
    color : (H, W, 3) uint8, or float32 in [0, 1]
    mask : (H, W) bool
        True on the object.
    camera : Camera
        Its size is (W, H).

    Raises
    ------
    ArgumentError
        If shapes, dtypes and camera do not fit together, or the mask is empty.

    Attributes
    ----------
    color, camera
        As given, read-only.
    valid : (H, W) bool
        The mask, under the name that `DepthImage` uses.

    Examples
    --------
    >>> import numpy as np
    >>> import pyibr as ibr
    >>> camera = ibr.Camera([[50, 0, 3], [0, 50, 6], [0, 0, 1]], (7, 13))
    >>> color = np.zeros((13, 7, 3), np.uint8)
    >>> view = ibr.Silhouette(color, np.ones((13, 7), bool), camera)
    >>> view.valid.shape
    (13, 7)
    """

    normals = None  # only a depth image may have normals

    def __init__(self, color: NDArray[Any], mask: NDArray[np.bool_], camera: Camera) -> None:
        instance_of("camera", camera, Camera, "a pyibr.Camera")
        shape = (camera.height, camera.width)
        valid = plain_array("mask", mask, f"bool of shape {shape}")
        if valid.shape != shape or valid.dtype != np.bool_:
            raise ArgumentError("mask", f"bool of shape {shape}", describe(mask))
        if not valid.any():
            raise ArgumentError("mask", "a mask that is True somewhere", "none")
        self.color = locked(checked_colors("color", color, (*shape, 3)))
        self.valid: NDArray[np.bool_] = locked(valid)
        self.camera = camera

    @property
    def shown_color(self) -> NDArray[Any]:
        """(H, W, 3) colours, under the name that `DepthImage` uses."""
        return self.color


def is_opposite(a: Silhouette | DepthImage, b: Silhouette | DepthImage) -> bool:
    """Tell whether two orthographic views look along one line from opposite sides and show mirrored silhouettes."""
    if a.camera.projection != "orthographic" or b.camera.projection != "orthographic":
        return False
    facing = float(a.camera.world_from_camera[:3, 2] @ b.camera.world_from_camera[:3, 2])
    if a.camera.size != b.camera.size or facing > -1 + 1e-9:
        return False
    from_a = a.camera.world_from_camera @ np.linalg.inv(a.camera.pixel_matrix)
    to_b = b.camera.pixel_matrix @ b.camera.camera_from_world @ from_a
    width, height = a.camera.size
    # The views look along one line, so the map of pixels holds for any depth. It must turn one step along a's rows or
    # columns into one step along b's rows or columns.
    exact, whole = to_b[:2, :3], np.rint(to_b[:2, :3]).astype(int)
    corners = np.array([[0, width - 1, 0, width - 1], [0, 0, height - 1, height - 1], [1, 1, 1, 1]])
    if np.abs((exact - whole) @ corners).max() > 1e-3:
        return False
    reached = whole @ corners
    if reached.min() < 0 or (reached.max(axis=1) >= b.camera.size).any():
        return False
    x, y = np.arange(width), np.arange(height)[:, None]
    u, v = (step_x * x + step_y * y + first for step_x, step_y, first in whole)
    return bool((b.valid[v, u] == a.valid).all())
