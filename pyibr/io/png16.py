"""Depth as 16-bit gray PNG: integers of an unknown unit, 0 where there is none."""

from __future__ import annotations

from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.core.checks import describe
from pyibr.core.errors import FileFormatError
from pyibr.io import image


def read_depth(path: str | PathLike[str]) -> NDArray[Any]:
    """Return the stored (H, W) uint16."""
    stored = image.read_color(path)
    if stored.ndim != 2 or stored.dtype != np.uint16:
        hint = " (inverse depth of networks: depth_from_mpeg)" if stored.dtype == np.uint8 else ""
        raise FileFormatError(f"{path}: expected a 16-bit gray PNG for depth, got {describe(stored)}{hint}")
    return stored


def write_depth(path: str | PathLike[str], depth: NDArray[np.uint16]) -> None:
    """Write (H, W) uint16."""
    image.write_color(path, depth)
