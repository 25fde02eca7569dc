"""Noise of depth, on the device."""

from __future__ import annotations

import numpy as np

from pyibr.images.noise import DepthNoise
from pyibr.opencl.device_cache import cached_on_device
from pyibr.opencl.memory import DeviceArray, upload


def deviation_on_device(noise: DepthNoise) -> DeviceArray:
    """(a, b, c) of `DepthNoise.deviation`."""
    return upload(np.array(noise.deviation, np.float32))
