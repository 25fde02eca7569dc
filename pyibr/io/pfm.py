"""Portable float maps: a text header, then float32 rows from the bottom up.

The sign of the header's third number gives the byte order (negative: little-endian). Its magnitude has no agreed
meaning and is ignored, as in most readers.
"""

from __future__ import annotations

import math
import re
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.core.errors import FileFormatError
from pyibr.core.files import reading, write_atomically

_HEADER = re.compile(
    rb"P([Ff])\s{1,9}(\d{1,9})\s{1,9}(\d{1,9})\s{1,9}"
    rb"([-+]?(?:\d{1,20}\.?\d{0,20}|\.\d{1,20})(?:[eE][-+]?\d{1,3})?)(?:\r\n|\s)"
)


def read_color(path: str | PathLike[str]) -> NDArray[np.float32]:
    """Return (H, W, 3) from a `PF` file, (H, W) from a `Pf` file."""
    with reading(path, "PFM") as source:
        data = source.read_bytes()
    header = _HEADER.match(data)
    if header is None:
        raise FileFormatError(f"{path}: not a PFM file: no header like 'Pf 640 480 -1.0'")
    kind, width, height, scale = header.groups()
    shape = (int(height), int(width), 3) if kind == b"F" else (int(height), int(width))
    got, expected = len(data) - header.end(), 4 * math.prod(shape)
    if got != expected:
        raise FileFormatError(f"{path}: expected {expected} bytes of pixels after the PFM header, got {got}")
    order = "<" if float(scale) < 0 else ">"
    rows = np.frombuffer(data, f"{order}f4", offset=header.end()).reshape(shape)
    return rows[::-1].astype(np.float32, order="C")


def read_depth(path: str | PathLike[str]) -> NDArray[np.float32]:
    """Return (H, W) from a `Pf` file."""
    return read_color(path)


def write_color(path: str | PathLike[str], color: NDArray[Any]) -> None:
    """Write (H, W, 3) or (H, W), uint8 divided by 255, in little-endian order."""
    values = color / np.float32(255) if color.dtype == np.uint8 else color
    header = f"P{'F' if values.ndim == 3 else 'f'}\n{values.shape[1]} {values.shape[0]}\n-1.0\n"
    write_atomically(path, header.encode("ascii") + values[::-1].astype("<f4").tobytes())


def write_depth(path: str | PathLike[str], depth: NDArray[Any]) -> None:
    """Write (H, W)."""
    write_color(path, depth)
