"""Depth as TIFF: floats, or integers of an unknown unit, 0 where there is none."""

from __future__ import annotations

from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.core.checks import describe
from pyibr.core.errors import FileFormatError
from pyibr.core.files import write_atomically
from pyibr.io import image


def read_depth(path: str | PathLike[str]) -> NDArray[Any]:
    """Return the stored (H, W), of more than 8 bits."""
    stored = image.read_color(path)
    if stored.ndim != 2 or stored.dtype.itemsize < 2:
        raise FileFormatError(f"{path}: expected a TIFF of floats or 16-bit gray for depth, got {describe(stored)}")
    return stored


def write_depth(path: str | PathLike[str], depth: NDArray[np.float32]) -> None:
    """Write (H, W) float32."""
    write_atomically(path, image.encoded(depth, ".tif"))
