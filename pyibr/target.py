"""The picture in the making: what every system draws into, one depth buffer for all."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pyibr.camera import Camera
from pyibr.images import Frame

if TYPE_CHECKING:
    from pyibr.opencl.memory import DeviceArray

_SCREEN = np.dtype(
    [
        ("from_world", np.float32, 16),
        ("to_world", np.float32, 16),
        ("width", np.int32),
        ("height", np.int32),
        ("perspective", np.int32),
        ("nearest", np.float32),
    ]
)
"""The struct Screen of kernels/lib/screen.h."""

_NEAR = 1e-5  # of the distance to the farthest point of a thing: what lies nearer than that is not drawn

_NEAREST = 1e-30  # scene units: of a point that the camera stands in


class Target:
    """Colour, depth and coverage on the current device.

    Parameters
    ----------
    camera : Camera
    dtype : dtype
        Of the colour: uint8 or float32.
    from_light : bool
        Only its depths count: they are a light's map of what casts shadows.

    Attributes
    ----------
    blank : bool
        Nothing has been written yet: who draws first writes every pixel, who draws later keeps what is nearer.
    """

    def __init__(self, camera: Camera, dtype: np.dtype[Any], from_light: bool = False) -> None:
        from pyibr.opencl.memory import empty

        shape = (camera.height, camera.width)
        self.camera = camera
        self.color = empty((*shape, 3), dtype)
        self.depth = empty(shape, np.float32)
        self.valid = empty(shape, np.uint8)
        self.blank = True
        self.from_light = from_light

    def outputs(self) -> dict[str, DeviceArray]:
        """The three buffers by their kernels' names."""
        return {"depth": self.depth, "color": self.color, "valid": self.valid}

    @property
    def channel_bytes(self) -> int:
        """Of the colour: the kernels' COLOR_BYTES."""
        return self.color.dtype.itemsize

    @cached_property
    def from_world(self) -> NDArray[np.float64]:
        """(4, 4) homogeneous pixel space over the world, see kernels/lib/pixelspace.h."""
        return self.camera.pixel_matrix @ self.camera.camera_from_world

    def near(self, bounds: tuple[NDArray[Any], NDArray[Any]]) -> float:
        """Least homogeneous W that a thing within a box, (low, high) in the world, is drawn at: its near plane."""
        if self.camera.projection == "orthographic":
            return 0.5  # W is 1 everywhere
        low, high = (np.asarray(corner, np.float64) for corner in bounds)
        middle, eye = 0.5 * (low + high), self.camera.world_from_camera[:3, 3]
        return max(_NEAR * float(np.linalg.norm(middle - eye) + 0.5 * np.linalg.norm(high - low)), _NEAREST)

    def screen(self, near: float, origin: NDArray[Any] | None = None) -> NDArray[np.void]:
        """A record of the struct Screen; with an `origin`, (3,) in the world, for points relative to it."""
        from_world = self.from_world
        if origin is not None:
            shift = np.eye(4)
            shift[:3, 3] = origin
            from_world = from_world @ shift
        values = np.zeros((), _SCREEN)
        values["from_world"] = from_world.ravel()
        values["to_world"] = np.linalg.inv(from_world).ravel()
        values["width"], values["height"] = self.camera.size
        perspective = self.camera.projection == "perspective"
        values["perspective"] = perspective
        values["nearest"] = 1.0 / near if perspective else 0.0
        return values

    def frame(self) -> Frame:
        """The picture on the host, once all launches are done."""
        return Frame(self.color.to_host(), self.depth.to_host(), self.valid.to_host().view(np.bool_), self.camera)
