"""Page space: the similarity between the world and a page, and the cameras of both."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pyibr.capture.standpoint import radius_of
from pyibr.core.camera import Camera
from pyibr.core.checks import Float64
from pyibr.core.rotations import quaternion_from_rotation, rotation_from_quaternion

_RADIUS = 3.0  # scene radius on the page; the page's near plane, keys and depths suit scenes of about this size


@dataclass(frozen=True)
class PageSpace:
    """Similarity from a page to the world. Pages use single precision and suit scenes of one size.

    A point of the world is at (point - middle) / unit on the page; directions are the same.
    """

    middle: Float64
    unit: float

    def camera(self, wxyz: ArrayLike, position: ArrayLike, fov: float, size: tuple[int, int]) -> Camera:
        """The camera of a page: OpenCV's axes, vertical field of view `fov` in radians, square pixels."""
        pose = np.eye(4)
        pose[:3, :3] = rotation_from_quaternion(np.asarray(wxyz, np.float64))
        pose[:3, 3] = np.asarray(position, np.float64) * self.unit + self.middle
        focal = size[1] / (2 * np.tan(fov / 2))
        return Camera([[focal, 0, (size[0] - 1) / 2], [0, focal, (size[1] - 1) / 2], [0, 0, 1]], size, pose)

    def pose(self, camera: Camera) -> tuple[Float64, Float64]:
        """(w, x, y, z) and position of a camera on the page."""
        return quaternion_from_rotation(camera.world_from_camera[:3, :3]), self.point(camera.center)

    def point(self, point: Float64) -> Float64:
        """Map a point of the world, (3,), to the page."""
        return (point - self.middle) / self.unit


def fov_of(camera: Camera) -> float:
    """Vertical field of view of a camera in radians."""
    return 2 * float(np.arctan(camera.height / (2 * camera.K[1, 1])))


def page_space_around(low: Float64, high: Float64) -> PageSpace:
    """The page space for a scene inside a box, (low, high) in the world.

    Raises
    ------
    ArgumentError
        If the box has no extent, or is infinite.
    """
    return PageSpace(0.5 * (low + high), radius_of(low, high) / _RADIUS)
