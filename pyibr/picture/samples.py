"""A depth image on the device, as every system reads it: nearness instead of depth (kernels/lib/pixelspace.h)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pyibr.core.errors import ArgumentError
from pyibr.core.pixelspace import pitch
from pyibr.images import DepthImage
from pyibr.opencl.headers import constant
from pyibr.opencl.kept import kept
from pyibr.opencl.launch import launch
from pyibr.opencl.memory import DeviceArray, empty, upload
from pyibr.opencl.program import kernel


@dataclass(frozen=True)
class Samples:
    """A depth image on the device.

    Attributes
    ----------
    nearness : DeviceArray (H, pitch) float32
        1/z (perspective) or -z (orthographic); NO_SURFACE where there is none.
    color : DeviceArray (H, W, 3)
    low, high : float
        Least and greatest nearness.
    """

    nearness: DeviceArray
    color: DeviceArray
    low: float
    high: float


def samples_of(view: DepthImage) -> Samples:
    """The view's nearness and colour on the current device, made once."""
    return kept(view, "samples", lambda: _made_of(view))


def _made_of(view: DepthImage) -> Samples:
    width, height = view.camera.size
    nearness = empty((height, pitch(width)), np.float32)
    ranges = empty((height, 2), np.float32)
    launch(
        kernel("lib/nearness.cl", "to_nearness"),
        (height,),
        depth=upload(view.depth),
        nearness=nearness,
        ranges=ranges,
        src_width=width,
        src_height=height,
        src_pitch=pitch(width),
        src_perspective=view.camera.projection == "perspective",
        far=min(view.far, 1 / constant("lib/nearness.cl", "NEAREST")),  # beyond, nearness would be invalid
    )
    spread = ranges.to_host()
    low, high = float(spread[:, 0].min()), float(spread[:, 1].max())
    if low > high:
        raise ArgumentError(
            "depth", "a view with at least one sample that is finite, > 0 and nearer than `far`", "none"
        )
    return Samples(nearness, upload(_at_least_a_word(view.color)), low, high)


def _at_least_a_word(color: Any) -> Any:
    """Kernels read a pixel's colour as four bytes: an image of one pixel has three."""
    return np.resize(color, (1, 2, 3)) if color.size == 3 else color
