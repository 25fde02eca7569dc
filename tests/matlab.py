"""A reader of MATLAB files, version 5: arrays of numbers, and structures of such arrays, as in calibration files."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
MATRIX, PACKED, STRUCTURE = 14, 15, 2


def load(path: Path) -> dict[str, Any]:
    """Variables of a file: arrays, and a dictionary of fields for each structure."""
    found: dict[str, Any] = {}
    for kind, data in elements(path.read_bytes()[128:]):
        inside = next(elements(zlib.decompress(data)))[1] if kind == PACKED else data
        name, value = variable(inside)
        found[name] = value
    return found


def elements(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Kind and content of each element; an element of at most four bytes stores its size in the word of its kind."""
    at = 0
    while at + 8 <= len(data):
        kind, size = struct.unpack_from("<II", data, at)
        start, step = at + 8, 8 + (size if kind == PACKED else -(-size // 8) * 8)
        if kind >> 16:
            kind, size, start, step = kind & 0xFFFF, kind >> 16, at + 4, 8
        yield kind, data[start : start + size]
        at += step


def variable(data: bytes) -> tuple[str, Any]:
    (_, flags), (_, shape), (_, name), *rest = elements(data)
    if flags[0] == STRUCTURE:
        size, names = struct.unpack("<i", rest[0][1])[0], rest[1][1]
        fields = [names[at : at + size].split(b"\0")[0].decode() for at in range(0, len(names), size)]
        values = [variable(inside)[1] for _, inside in rest[2:]]
        return name.decode(), dict(zip(fields, values, strict=True))
    kind, numbers = rest[0]
    array = np.frombuffer(numbers, f"<{NUMBERS[kind]}").reshape(np.frombuffer(shape, "<i4"), order="F")
    return name.decode(), array.astype(np.float64)
