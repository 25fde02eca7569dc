"""The noise of depth, and the steps of its scale, found on the device (kernels/picture/noise.cl)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pyibr.opencl.device import current
from pyibr.opencl.headers import struct
from pyibr.opencl.launch import launch
from pyibr.opencl.memory import DeviceArray, empty, upload
from pyibr.opencl.program import kernel

_FILE = "picture/noise.cl"

Terms = tuple[float, float, float]


def noise_room(size: tuple[int, int], cells: int) -> int:
    """Number of ints that estimate_noise() needs as `tables`, for depth of such a (width, height)."""
    # A strip of n samples is n + 2 long, and there are cells / (2 n) + 1 of them at most; then a packet's room.
    strips = 3 * cells + sum(size) + 64
    return struct(_FILE, "NoiseTables").itemsize // 4 + 3 * strips


def noise_on_device(depth: DeviceArray, far: float, cells: int = 6_000) -> DeviceArray:
    """Find the noise of depth (H, W) float32 that is on the device, without waiting for it.

    Parameters
    ----------
    depth : DeviceArray (H, W) float32
        Not finite, <= 0 or >= `far` is no sample.
    far : float
    cells : int
        Number of cells that are sampled: from 6,000, noise is found to some percent.

    Returns
    -------
    DeviceArray (2, 3) float32
        (a, b, c) of the deviation a z^2 + b z + c at depth z, then of the steps of the scale.
    """
    height, width = depth.shape
    noise, tables = empty((2, 3), np.float32), empty((noise_room((width, height), cells),), np.int32)
    launch(
        kernel(_FILE, "find_noise"),
        current().profile.group[:2],
        depth=depth,
        tables=tables,
        noise=noise,
        width=width,
        height=height,
        far=far,
        cells=cells,
    )
    return noise


def found_noise(depth: NDArray[np.float32], far: float = np.inf, cells: int = 6_000) -> tuple[Terms, Terms]:
    """(a, b, c) of the deviation and of the steps, on the host: see `noise_on_device`."""
    (a, b, c), (d, e, f) = noise_on_device(upload(depth), far, cells).to_host().tolist()
    return (a, b, c), (d, e, f)
