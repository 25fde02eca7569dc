"""Depth images of Gaussians."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pyibr.core.camera import Camera
from pyibr.core.checks import byte_color
from pyibr.core.errors import ArgumentError
from pyibr.gaussians import Gaussians
from pyibr.images import DepthImage, Frame
from pyibr.images.depth_image import Color
from pyibr.picture.render import render


class CloudScene:
    """Gaussians ready to be captured from many cameras; see `MeshScene`."""

    def __init__(self, cloud: Gaussians) -> None:
        self.cloud = cloud
        self.up: ArrayLike | None = None

    @property
    def bounds(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(low, high), each (3,), in the world."""
        return self.cloud.bounds

    def capture(
        self,
        camera: Camera,
        *,
        layer: str = "first",
        background: tuple[int, int, int] = (0, 0, 0),
        normals: bool = False,
    ) -> DepthImage:
        """Take a depth image: surface is where the Gaussians stop half of the light.

        Parameters
        ----------
        camera, background
            As for `MeshScene.capture`.
        layer, normals
            "first" and False: Gaussians have no other layer, and no normals.

        Raises
        ------
        ArgumentError
            If no ray loses half of its light, or an argument has another value.
        DeviceError
            No OpenCL device works.
        """
        for argument, value, only in (("layer", layer, "first"), ("normals", normals, False)):
            if value != only:
                raise ArgumentError(argument, f"{only!r} with Gaussians", repr(value))
        around = byte_color("background", background)
        frame = render(self.cloud, camera)
        if not frame.valid.any():
            raise ArgumentError(
                "camera", "a camera that sees the Gaussians", "one whose rays all keep half their light"
            )
        color = surface_colors(frame)
        color[~frame.valid] = around
        return DepthImage(color, np.where(frame.valid, frame.depth, np.float32(np.inf)), camera)


def surface_colors(frame: Frame) -> Color:
    """Return a frame's colours, without the black that shows through partly transparent pixels."""
    if frame.alpha is None:
        return frame.color
    alpha = np.where(frame.valid, frame.alpha, np.float32(1))[..., None]
    shown = frame.color / alpha
    return np.rint(shown).clip(0, 255).astype(np.uint8) if frame.color.dtype == np.uint8 else shown.clip(0, 1)
