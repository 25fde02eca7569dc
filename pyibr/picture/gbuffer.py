"""The G-buffer (Saito & Takahashi 1990): geometry of a picture's pixels, for deferred lighting."""

from __future__ import annotations

import numpy as np

from pyibr.core.camera import Camera
from pyibr.opencl.memory import DeviceArray, empty


class GBuffer:
    """Thing, depth and normal of the pixels that are lit after all things are drawn.

    The kernels that draw these things write the buffers (kernels/lib/gbuffer.h).

    Parameters
    ----------
    camera : Camera
        Camera of the picture.

    Attributes
    ----------
    depth, thing : (H, W) DeviceArray
        float32 and int32. Where the depth differs from the picture's depth, the pixel shows another thing.
    normal : (H, W, 3) float32 DeviceArray, or None
        None until a thing with normals is drawn.
    things : list of tuples
        Parameters of each thing for `light_things`.
    """

    def __init__(self, camera: Camera) -> None:
        shape = camera.height, camera.width
        self.depth, self.thing = empty(shape, np.float32), empty(shape, np.int32)
        self.depth.fill(np.nan)
        self.normal: DeviceArray | None = None
        self.things: list[tuple[float, int, float, bool]] = []
