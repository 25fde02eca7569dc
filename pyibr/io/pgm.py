"""Depth as portable gray maps of 8 or 16 bits, high byte first."""

from __future__ import annotations

from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.core.errors import FileFormatError
from pyibr.io import image


def read_depth(path: str | PathLike[str]) -> NDArray[Any]:
    """Return the stored (H, W) uint16 or uint8."""
    stored = image.read_color(path)
    if stored.ndim != 2 or stored.dtype.kind not in "ui":
        raise FileFormatError(f"{path}: expected a gray map of 8 or 16 bits")
    return stored if stored.dtype == np.uint8 else stored.astype(np.uint16)
