"""MPI Sintel's depth (.dpt) and cameras (.cam): a tag, then little-endian binary numbers."""

from __future__ import annotations

import struct
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.core.checks import Float64
from pyibr.core.errors import FileFormatError
from pyibr.core.files import reading

_TAG = struct.pack("<f", 202021.25)


def read_depth(path: str | PathLike[str]) -> NDArray[Any]:
    """Return (H, W) float32."""
    with reading(path, "Sintel depth") as source:
        data = source.read_bytes()
        width, height = struct.unpack_from("<ii", data, 4)
    if data[:4] != _TAG or width < 1 or height < 1 or len(data) != 12 + 4 * width * height:
        raise FileFormatError(f"{path}: expected Sintel's tag, a size and as many float32, got {len(data)} bytes")
    return np.frombuffer(data, "<f4", offset=12).reshape(height, width).astype(np.float32)


def read_camera(path: Path) -> tuple[Float64, Float64]:
    """Return K (3, 3) and camera_from_world (3, 4)."""
    with reading(path, "Sintel camera") as source:
        data = source.read_bytes()
    if data[:4] != _TAG or len(data) != 4 + 8 * 21:
        raise FileFormatError(f"{path}: expected Sintel's tag and 21 float64, got {len(data)} bytes")
    numbers = np.frombuffer(data, "<f8", offset=4)
    return numbers[:9].reshape(3, 3), numbers[9:].reshape(3, 4)
