"""Images of float32 after a short header: PFM, COLMAP's depth maps (.bin), MPI Sintel's depth (.dpt) and cameras."""

from __future__ import annotations

import math
import re
import struct
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.core.checks import Float64
from pyibr.core.files import checked_path, reading, write_atomically

_Header = tuple[int, tuple[int, ...], str]
"""Its length in bytes, the image's shape, and the numbers' type."""

_GAP = rb"(?:\s|#[^\n]{0,999}\n){1,9}"  # comments may stand here, as in PGM
_SCALE = rb"([-+]?(?:\d{1,20}\.?\d{0,20}|\.\d{1,20})(?:[eE][-+]?\d{1,3})?)(?:\r\n|\s)"
_PFM = re.compile(rb"P([Ff])%b(\d{1,9})%b(\d{1,9})%b" % (_GAP, _GAP, _GAP) + _SCALE)
_COLMAP = re.compile(rb"(\d{1,9})&(\d{1,9})&(\d{1,9})&")
_SINTEL = struct.pack("<f", 202021.25)


def _pfm(data: bytes) -> _Header:
    """The third number is negative for little-endian files; its magnitude has no agreed meaning."""
    found = _PFM.match(data)
    if found is None:
        raise ValueError("no header like 'Pf 640 480 -1.0'")
    kind, width, height, scale = found.groups()
    shape = int(height), int(width)
    return found.end(), (*shape, 3) if kind == b"F" else shape, "<f4" if float(scale) < 0 else ">f4"


def _colmap(data: bytes) -> _Header:
    found = _COLMAP.match(data)
    if found is None:
        raise ValueError("no header like '640&480&1&'")
    width, height, channels = map(int, found.groups())
    if channels != 1:
        raise ValueError(f"expected 1 channel, got {channels}")
    return found.end(), (height, width), "<f4"


def _sintel(data: bytes) -> _Header:
    width, height = struct.unpack_from("<ii", data, 4)
    if data[:4] != _SINTEL or min(width, height) < 1:
        raise ValueError("expected Sintel's tag and a size")
    return 12, (height, width), "<f4"


_FORMATS = {".pfm": ("PFM", _pfm), ".bin": ("COLMAP depth", _colmap), ".dpt": ("Sintel depth", _sintel)}


def read_color(path: str | PathLike[str]) -> NDArray[np.float32]:
    """Return (H, W), or (H, W, 3) from a PFM file of colours; 0 is no depth."""
    suffix = checked_path(path).suffix.lower()
    kind, header_of = _FORMATS[suffix]
    with reading(path, kind) as source:
        data = source.read_bytes()
        start, shape, numbers = header_of(data)
        expected, got = 4 * math.prod(shape), len(data) - start
        if got != expected:
            raise ValueError(f"expected {expected} bytes of pixels after the header, got {got}")
    rows = np.frombuffer(data, numbers, offset=start).reshape(shape)
    return (rows[::-1] if suffix == ".pfm" else rows).astype(np.float32, order="C")


def write_color(path: str | PathLike[str], color: NDArray[Any]) -> None:
    """Write (H, W), or as PFM also (H, W, 3); uint8 is divided by 255."""
    values = color / np.float32(255) if color.dtype == np.uint8 else color
    (height, width), suffix = values.shape[:2], checked_path(path).suffix.lower()
    if suffix == ".pfm":
        values, header = values[::-1], f"P{'F' if values.ndim == 3 else 'f'}\n{width} {height}\n-1.0\n".encode("ascii")
    elif suffix == ".bin":
        header = f"{width}&{height}&1&".encode("ascii")
    else:
        header = _SINTEL + struct.pack("<ii", width, height)
    write_atomically(path, header + values.astype("<f4").tobytes())


read_depth, write_depth = read_color, write_color


def read_camera(path: str | PathLike[str]) -> tuple[Float64, Float64]:
    """Return K (3, 3) and camera_from_world (3, 4) of Sintel's cameras (.cam)."""
    with reading(path, "Sintel camera") as source:
        data = source.read_bytes()
        if data[:4] != _SINTEL or len(data) != 4 + 8 * 21:
            raise ValueError(f"expected Sintel's tag and 21 float64, got {len(data)} bytes")
    numbers = np.frombuffer(data, "<f8", offset=4)
    return numbers[:9].reshape(3, 3), numbers[9:].reshape(3, 4)
