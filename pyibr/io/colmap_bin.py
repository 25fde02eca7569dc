"""COLMAP's dense depth maps: text `width&height&channels&`, then float32 rows from the top; 0 is no depth."""

from __future__ import annotations

import re
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.core.errors import FileFormatError
from pyibr.core.files import reading, write_atomically

_HEADER = re.compile(rb"(\d{1,9})&(\d{1,9})&(\d{1,9})&")


def read_depth(path: str | PathLike[str]) -> NDArray[np.float32]:
    """Return (H, W) float32."""
    with reading(path, "COLMAP depth") as source:
        data = source.read_bytes()
    header = _HEADER.match(data)
    if header is None:
        raise FileFormatError(f"{path}: not a COLMAP depth map: no header like '640&480&1&'")
    width, height, channels = (int(n) for n in header.groups())
    got, expected = len(data) - header.end(), 4 * width * height
    if channels != 1 or got != expected:
        raise FileFormatError(
            f"{path}: expected 1 channel and {expected} bytes after the header, got {channels} and {got}"
        )
    return np.frombuffer(data, "<f4", offset=header.end()).reshape(height, width).astype(np.float32)


def write_depth(path: str | PathLike[str], depth: NDArray[Any]) -> None:
    """Write (H, W) float32."""
    header = f"{depth.shape[1]}&{depth.shape[0]}&1&".encode("ascii")
    write_atomically(path, header + depth.astype("<f4").tobytes())
