"""Clearing of arrays on the device."""

from __future__ import annotations

import math

import numpy as np

from pyibr.opencl.device import current
from pyibr.opencl.launch import launch
from pyibr.opencl.memory import DeviceArray
from pyibr.opencl.program import kernel


def clear(array: DeviceArray, value: float) -> None:
    """Set all elements of a float32 or uint32 array to one value, on all processors."""
    count, profile = math.prod(array.shape), current().profile
    launch(
        kernel("picture/begin.cl", "clear_uints" if array.dtype == np.uint32 else "clear"),
        profile.shares(count),
        values=array,
        count=count,
        share=profile.share,
        value=value,
    )
