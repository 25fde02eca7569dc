"""Changes that let Pillow read TIFF: no rotation, and unsupported number types as integers of the same size."""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

_ORDERS = {b"II*\0": "<", b"MM\0*": ">"}
_WIDTH, _BITS, _ORIENTATION, _SAMPLES, _TILE_WIDTH, _KIND = 256, 258, 274, 277, 322, 339
_CODES = {3: "H", 4: "I"}  # types of fields with one number
_UNSIGNED, _SIGNED, _FLOAT = 1, 2, 3
_UNKNOWN = {(_UNSIGNED, 32): "u4", (_FLOAT, 16): "f2", (_FLOAT, 64): "f8"}


def as_known(data: bytes) -> tuple[bytes, str]:
    """Return a file that Pillow reads, and its numbers' type for `as_they_are`; other formats stay unchanged."""
    order = _ORDERS.get(data[:4])
    if order is None:
        return data, ""
    changed, fields = bytearray(data), dict[int, tuple[int, str]]()
    (first,) = struct.unpack_from(f"{order}I", data, 4)
    (count,) = struct.unpack_from(f"{order}H", data, first)
    for place in range(first + 2, first + 2 + 12 * count, 12):
        tag, kind, numbers = struct.unpack_from(f"{order}HHI", data, place)
        if numbers == 1 and kind in _CODES:
            fields[tag] = place + 8, order + _CODES[kind]

    def value(tag: int, otherwise: int) -> int:
        return struct.unpack_from(fields[tag][1], data, fields[tag][0])[0] if tag in fields else otherwise

    def put(tag: int, number: int) -> None:
        if tag in fields:
            struct.pack_into(fields[tag][1], changed, fields[tag][0], number)

    put(_ORIENTATION, 1)
    numbers = _UNKNOWN.get((value(_KIND, _UNSIGNED), value(_BITS, 1)), "") if value(_SAMPLES, 1) == 1 else ""
    if numbers:
        words = 2 if numbers == "f8" else 1
        put(_KIND, _UNSIGNED if numbers == "f2" else _SIGNED)
        put(_BITS, 16 if numbers == "f2" else 32)
        for tag in (_WIDTH, _TILE_WIDTH):
            put(tag, words * value(tag, 0))
    return bytes(changed), numbers and order + numbers


def as_they_are(stored: NDArray[np.generic], numbers: str) -> NDArray[np.generic]:
    """Return the integers from Pillow as numbers of the file's type, in native byte order."""
    native = np.ascontiguousarray(stored, stored.dtype.newbyteorder("="))
    if not numbers:
        return native
    if numbers == ">f8":  # its halves are in reverse order
        native = np.ascontiguousarray(native.reshape(len(native), -1, 2)[..., ::-1]).reshape(native.shape)
    return native.view(numbers[1:])
