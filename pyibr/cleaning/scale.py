"""Scales of nearness on which noise is equal at every depth (kernels/cleaning/scale.h)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pyibr.core.checks import Float64
from pyibr.opencl.headers import constant, struct
from pyibr.opencl.launch import Struct
from pyibr.opencl.memory import DeviceArray, upload

_VALUE_MIN = 1e-30  # least length of a scale: if the noise exceeds nearness by such a factor, one guide is enough


@dataclass(frozen=True)
class Scale:
    """A scale on the device: the kernel arguments `table`, `guide` and `record`."""

    table: DeviceArray
    guide: DeviceArray
    record: Struct


def scale_of(nearest: float, farthest: float, at: Float64, noise: Float64, least: float) -> Scale:
    """Make a scale: nearness (1 / depth), stretched so that 1 is the same multiple of the noise at every depth.

    Parameters
    ----------
    nearest, farthest : float
        Range of depths that the scale covers.
    at, noise : (k,) float64
        Values of nearness, and the differences of nearness that the scale maps to 1 at these values.
    least : float
        Smallest difference that the scale maps to 1, as a fraction of the nearness.
    """
    shift = int(constant("cleaning/scale.h", "KNOT_SHIFT"))
    first, last = (int(np.float32(1 / depth).view(np.int32)) >> shift for depth in (farthest, nearest))
    knots = np.arange(first - 1, last + 3, dtype=np.int32)  # with a margin, as the device may round quotients otherwise
    nearness = (knots << shift).view(np.float32).astype(np.float64)
    found = least * nearness
    if len(at):  # beyond `at`, noise grows with nearness, so that a single near outlier does not stretch the scale
        found = np.maximum(found, np.interp(nearness, at, noise) * np.maximum(nearness / at[-1], 1))
    values = np.append(0, np.cumsum(2 * np.diff(nearness) / (found[1:] + found[:-1]))).astype(np.float32)
    guides = int(constant("cleaning/scale.h", "GUIDES"))
    parts = np.linspace(0, values[-1], guides + 1, dtype=np.float32)
    guide = np.clip(np.searchsorted(values, parts, side="right") - 1, 0, len(knots) - 2).astype(np.int32)
    record = np.zeros((), struct("cleaning/scale.h", "Scale"))
    record["first"], record["count"] = knots[0], len(knots)
    record["cells_per_value"] = guides / max(float(values[-1]), _VALUE_MIN)
    return Scale(upload(values), upload(guide), Struct("Scale", record))
