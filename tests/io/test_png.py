"""pyibr's PNG files, read by OpenCV."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from pyibr.io import png


@pytest.mark.parametrize("deflate", ["isal.isal_zlib", "zlib"])
@pytest.mark.parametrize("shape", [(1, 1), (37, 61), (37, 61, 3), (37, 61, 4)])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_png_is_what_others_read(monkeypatch: pytest.MonkeyPatch, deflate, shape, dtype):
    monkeypatch.setattr(png, "_deflate", pytest.importorskip(deflate))
    image = np.random.default_rng(5).integers(0, np.iinfo(dtype).max, shape, dtype, endpoint=True)
    theirs = cv2.imdecode(np.frombuffer(png.encoded(image), np.uint8), cv2.IMREAD_UNCHANGED)
    channels = [0] if len(shape) == 2 else [2, 1, 0, 3][: shape[2]]
    np.testing.assert_array_equal(theirs.reshape(*shape[:2], -1)[..., channels], image.reshape(*shape[:2], -1))
