"""TIFF files, written without a library: numbers of every kind, in either byte order."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

import pyibr as ibr
from tests.io.specimens import tiff


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("kind", ["u1", "u2", "i2", "u4", "i4", "f2", "f4", "f8"])
def test_tiff_of_every_kind_and_byte_order_as_it_is_stored(tmp_path: Path, kind, order):
    values = np.arange(1, 92).reshape(13, 7) * {"u1": 1, "u4": 40_000_000}.get(kind, 5)  # u4: beyond the range of i4
    (tmp_path / "d.tif").write_bytes(tiff(values.astype(order + kind), orientation=6))
    np.testing.assert_array_equal(ibr.read_depth(tmp_path / "d.tif", depth_scale=1), values.astype(np.float32))
    if kind in ("u1", "u2", "f2", "f4", "f8"):
        assert ibr.read_color(tmp_path / "d.tif").shape == (13, 7, 3)


@pytest.mark.parametrize("compression", [cv2.IMWRITE_TIFF_COMPRESSION_NONE, cv2.IMWRITE_TIFF_COMPRESSION_LZW])
def test_tiff_of_doubles_however_it_is_packed(tmp_path: Path, compression):
    depth = np.random.default_rng(1).uniform(0.5, 60, (37, 61))
    cv2.imwrite(str(tmp_path / "d.tif"), depth, [cv2.IMWRITE_TIFF_COMPRESSION, compression])
    np.testing.assert_array_equal(ibr.read_depth(tmp_path / "d.tif"), depth.astype(np.float32))
