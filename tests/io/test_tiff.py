"""TIFF by hand: numbers of every kind, in either byte order."""

from __future__ import annotations

import struct
from pathlib import Path

import cv2
import numpy as np
import pytest

import pyibr as ibr


def tiff(values: np.ndarray, orientation: int = 1) -> bytes:
    """A file by hand, its numbers in the byte order that they have."""
    order, kind = ">" if values.dtype.byteorder == ">" else "<", {"u": 1, "i": 2, "f": 3}[values.dtype.kind]
    height, width = values.shape
    fields = [(256, width), (257, height), (258, 8 * values.itemsize), (259, 1), (262, 1), (273, 146)]
    fields += [(274, orientation), (277, 1), (278, height), (279, values.nbytes), (339, kind)]
    entries = b"".join(struct.pack(f"{order}HHII", tag, 4, 1, value) for tag, value in fields)
    head = b"II*\0" if order == "<" else b"MM\0*"
    return head + struct.pack(f"{order}IH", 8, len(fields)) + entries + bytes(4) + values.tobytes()


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("kind", ["u1", "u2", "i2", "u4", "i4", "f2", "f4", "f8"])
def test_tiff_of_every_kind_and_byte_order_as_it_is_stored(tmp_path: Path, kind, order):
    values = np.arange(1, 92).reshape(13, 7) * {"u1": 1, "u4": 40_000_000}.get(kind, 5)  # beyond what i4 holds
    (tmp_path / "d.tif").write_bytes(tiff(values.astype(order + kind), orientation=6))
    np.testing.assert_array_equal(ibr.read_depth(tmp_path / "d.tif", depth_scale=1), values.astype(np.float32))
    if kind in ("u1", "u2", "f2", "f4", "f8"):
        assert ibr.read_color(tmp_path / "d.tif").shape == (13, 7, 3)


@pytest.mark.parametrize("compression", [cv2.IMWRITE_TIFF_COMPRESSION_NONE, cv2.IMWRITE_TIFF_COMPRESSION_LZW])
def test_tiff_of_doubles_however_it_is_packed(tmp_path: Path, compression):
    depth = np.random.default_rng(1).uniform(0.5, 60, (37, 61))
    cv2.imwrite(str(tmp_path / "d.tif"), depth, [cv2.IMWRITE_TIFF_COMPRESSION, compression])
    np.testing.assert_array_equal(ibr.read_depth(tmp_path / "d.tif"), depth.astype(np.float32))
