"""The G-buffer (Saito & Takahashi 1990): what light is to know of a picture's pixels."""

from __future__ import annotations

import numpy as np

from pyibr.core.camera import Camera
from pyibr.opencl.memory import DeviceArray, empty


class GBuffer:
    """Thing, depth and normal of the pixels that are lit once all things are drawn.

    Kernels that draw such things write it (kernels/lib/gbuffer.h).

    Parameters
    ----------
    camera : Camera
        Of the picture.

    Attributes
    ----------
    depth, thing : (H, W) DeviceArray
        float32 and int32. Where the depth is not the picture's, there is no such thing.
    normal : (H, W, 3) float32 DeviceArray, or None
        Once a thing with normals has been drawn.
    things : list of tuples
        Of each thing what `light_things` is to know.
    """

    def __init__(self, camera: Camera) -> None:
        shape = camera.height, camera.width
        self.depth, self.thing = empty(shape, np.float32), empty(shape, np.int32)
        self.depth.fill(np.nan)
        self.normal: DeviceArray | None = None
        self.things: list[tuple[float, int, float, bool]] = []
