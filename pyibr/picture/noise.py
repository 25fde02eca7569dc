"""Estimates of depth noise and quantization steps on the device (kernels/picture/noise.cl)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pyibr.images.noise import DepthNoise, Found, estimated_by
from pyibr.opencl.device import current, one_call
from pyibr.opencl.device_cache import cached_on_device
from pyibr.opencl.headers import struct
from pyibr.opencl.launch import launch
from pyibr.opencl.memory import DeviceArray, empty, upload
from pyibr.opencl.program import kernel

_FILE = "picture/noise.cl"


class NoiseOnDevice:
    """The noise of a depth image: float32 (a, b, c) of the deviation a z^2 + b z + c at depth z.

    If it is estimated, (a, b, c) of the quantization steps follow.
    """

    def __init__(self, array: DeviceArray) -> None:
        self.array = array
        self.values: NDArray[np.float32] | None = None  # the same on the host, after a wait for the launch


def noise_on_device(noise: DepthNoise, depth: DeviceArray | None = None) -> NoiseOnDevice:
    """Return the given noise, or begin to estimate it, once; `depth`: the image's depth, if it is on the device."""
    if noise.given is not None:
        return NoiseOnDevice(upload(np.array(noise.given, np.float32)))
    return _found(noise, depth)


def _found(noise: DepthNoise, depth: DeviceArray | None = None) -> NoiseOnDevice:
    def made() -> NoiseOnDevice:
        height, width = noise.depth.shape
        # A strip of n samples takes n + 2 values; there are at most cells / (2 n) + 1 strips, and a packet more.
        strips = 3 * (3 * noise.cells + width + height + 64)
        found = NoiseOnDevice(empty((2, 3), np.float32))
        launch(
            kernel("picture/begin.cl", "find_noise"),
            current().profile.group[:2],
            depth=upload(noise.depth) if depth is None else depth,
            tables=empty((struct(_FILE, "NoiseTables").itemsize // 4 + strips,), np.int32),
            noise=found.array,
            width=width,
            height=height,
            far=noise.far,
            cells=noise.cells,
        )
        return found

    return cached_on_device(noise, "noise", made)


@estimated_by
def _on_host(noise: DepthNoise) -> Found:
    with one_call():
        found = _found(noise)
        if found.values is None:
            found.values = found.array.to_host()
        deviation, steps = found.values.tolist()
        return tuple(deviation), tuple(steps)
