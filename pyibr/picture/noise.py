"""The noise of depth, and the steps of its scale, on the device (kernels/picture/noise.cl)."""

from __future__ import annotations

from typing import Any

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
    """The estimate for a depth image: an array on the device, and its values once somebody has waited for them.

    Attributes
    ----------
    array : DeviceArray (2, 3) float32
        (a, b, c) of the deviation a z^2 + b z + c at depth z, then of the steps of the scale.
    values : (2, 3) float32, or None
        The same on the host.
    """

    def __init__(self, array: DeviceArray) -> None:
        self.array = array
        self.values: NDArray[np.float32] | None = None


def noise_arguments(noise: DepthNoise, depth: DeviceArray) -> dict[str, Any]:
    """What the kernels need that estimate the noise of `depth`."""
    height, width = depth.shape
    # A strip of n samples is n + 2 long, and there are cells / (2 n) + 1 of them at most; then a packet's room.
    strips = 3 * (3 * noise.cells + width + height + 64)
    tables = empty((struct(_FILE, "NoiseTables").itemsize // 4 + strips,), np.int32)
    return {"tables": tables, "noise": empty((2, 3), np.float32), "cells": noise.cells}


def noise_on_device(noise: DepthNoise, depth: DeviceArray | None = None) -> NoiseOnDevice:
    """Find the noise, once, without waiting for it; `depth` if that is on the device."""
    return cached_on_device(noise, "noise", lambda: _found(noise, upload(noise.depth) if depth is None else depth))


def deviation_on_device(noise: DepthNoise, depth: DeviceArray | None = None) -> DeviceArray:
    """(a, b, c) of the deviation, found or given, and whatever else."""
    if noise.given is None:
        return noise_on_device(noise, depth).array
    return upload(np.array(noise.given, np.float32))


def _found(noise: DepthNoise, depth: DeviceArray) -> NoiseOnDevice:
    arguments, (height, width) = noise_arguments(noise, depth), depth.shape
    launch(
        kernel(_FILE, "find_noise"),
        current().profile.group[:2],
        depth=depth,
        width=width,
        height=height,
        far=noise.far,
        **arguments,
    )
    return NoiseOnDevice(arguments["noise"])


@estimated_by
def _on_host(noise: DepthNoise) -> Found:
    with one_call():
        found = noise_on_device(noise)
        if found.values is None:
            found.values = found.array.to_host()
        deviation, steps = found.values.tolist()
        return tuple(deviation), tuple(steps)
