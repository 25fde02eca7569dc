"""Depth as gray PNG of 16 or 8 bit: integers of an unknown unit, 0 where there is none."""

from __future__ import annotations

from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.core.checks import describe
from pyibr.core.errors import FileFormatError
from pyibr.io import image


def read_depth(path: str | PathLike[str]) -> NDArray[Any]:
    """Return the stored (H, W) uint16 or uint8."""
    stored = image.read_color(path)
    if stored.ndim != 2 or stored.dtype.name not in ("uint16", "uint8"):
        raise FileFormatError(f"{path}: expected a gray PNG of 16 or 8 bit for depth, got {describe(stored)}")
    return stored


def write_depth(path: str | PathLike[str], depth: NDArray[np.uint16]) -> None:
    """Write (H, W) uint16."""
    image.write_color(path, depth)
