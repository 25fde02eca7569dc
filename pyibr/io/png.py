"""PNG: rows as differences to the left neighbour, deflated in one call by isal if that is installed."""

from __future__ import annotations

import struct
import zlib
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

try:
    _deflate: Any = import_module("isal.isal_zlib")
except ImportError:  # some processors have no wheels of it
    _deflate = zlib

_GRAY, _COLORS = 0, {3: 2, 4: 6}
_TO_THE_LEFT = 1  # the filter type of each row


def encoded(image: NDArray[Any]) -> bytes:
    """Return a file for an (H, W) or (H, W, 3 or 4) image in uint8 or uint16."""
    height, width = image.shape[:2]
    stored = np.ascontiguousarray(image, image.dtype.newbyteorder(">")).view(np.uint8).reshape(height, -1)
    pixel = stored.shape[1] // width
    rows = np.empty((height, 1 + stored.shape[1]), np.uint8)
    rows[:, 0], rows[:, 1 : 1 + pixel] = _TO_THE_LEFT, stored[:, :pixel]
    np.subtract(stored[:, pixel:], stored[:, :-pixel], out=rows[:, 1 + pixel :])
    kind = _GRAY if image.ndim == 2 else _COLORS[image.shape[2]]
    head = struct.pack(">IIBBBBB", width, height, 8 * image.itemsize, kind, 0, 0, 0)
    chunks = _chunk(b"IHDR", head), _chunk(b"IDAT", _deflate.compress(rows.data, 1)), _chunk(b"IEND", b"")
    return b"".join((b"\x89PNG\r\n\x1a\n", *chunks))


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(data, zlib.crc32(kind)))
