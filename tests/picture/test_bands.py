"""Pictures that need more memory than the device has are drawn in bands."""

from __future__ import annotations

import gc
import sys
from collections.abc import Callable, Iterator

import numpy as np
import pytest

import pyibr as ibr
from pyibr.opencl.device import current
from pyibr.picture import bands
from tests import scenes
from tools.processes import run_within

SIZE = (301, 207)


@pytest.fixture
def little() -> Iterator[Callable[[int], None]]:
    """Yield a function that limits the device's free bytes until the test's end."""
    gc.collect()
    room = current().room
    whole = room.total

    def leave(size: int) -> None:
        current().memory_pool.clear()
        room.total = room.taken + size

    yield leave
    room.total = whole


@pytest.mark.thorough
@pytest.mark.parametrize(("cameras", "classes"), [(1, True), (2, False)])
def test_pictures_without_the_memory_for_them_are_drawn_in_bands(little, monkeypatch, cameras: int, classes: bool):
    view = scenes.stepped(SIZE)
    targets = [view.camera.moved(0.3 + step, 0.2, 0.4) for step in range(cameras)]
    expected = ibr.warp(view, targets, classes=classes)
    outs = [ibr.Frame(*map(np.zeros_like, (one.color, one.depth, one.valid)), one.camera) for one in expected]
    little(10 * SIZE[0] * SIZE[1])  # the picture and the sweep need 12 bytes per pixel
    with pytest.raises(ibr.OutOfMemoryError, match=r"for \d+ MiB more: \d+ MiB of \d+ MiB are in use"):
        ibr.warp(view, targets, classes=classes)
    monkeypatch.setattr(bands, "_PIXELS_MIN", 1 << 12)
    with pytest.raises(ibr.OutOfMemoryError):  # filled pictures have no bands: a hole's colours may lie in another band
        ibr.warp(view, targets, classes=classes, fill="smooth")
    found = ibr.warp(view, targets, classes=classes, out=outs)
    for one, two, out in zip(found, expected, outs, strict=True):
        assert one.color is out.color and one.camera is two.camera
        np.testing.assert_array_equal(one.valid, two.valid)
        np.testing.assert_array_equal(one.color, two.color)
        np.testing.assert_array_equal(one.classes, two.classes)
        # The bands' rays differ by some tens of roundings at most.
        np.testing.assert_allclose(one.depth, two.depth, rtol=32 * 2**-24)


PLANE = """
import numpy as np, pyibr as ibr
camera = ibr.Camera([[8192, 0, 4095.5], [0, 8192, 4095.5], [0, 0, 1]], (8192, 8192))
color = np.random.default_rng(1).integers(256, size=(8192, 8192, 3), dtype=np.uint8)
view = ibr.DepthImage(color, np.full((8192, 8192), 2.0, np.float32), camera)
frame = ibr.warp(view, camera.moved(64 * 2 / 8192, 0, 0), classes=True)
assert (frame.color[:, :-64] == color[:, 64:]).all() and (frame.classes[:, :-64] == 0).all()
assert (frame.classes[:, -64:] == ibr.PixelClass.OUTSIDE).all()
try:
    ibr.warp(view, camera, fill="background")
except ibr.OutOfMemoryError as error:
    print(error)
"""


@pytest.mark.thorough
@pytest.mark.skipif("pocl" not in current().device.version.lower(), reason="only PoCL's memory can be limited")
def test_pictures_of_8192_pixels_a_side_need_2_gib():
    """PoCL reports the variable as its device's memory, and allows buffers of a quarter of it."""
    done = run_within(300, [sys.executable, "-c", PLANE], POCL_MEMORY_LIMIT="2")
    assert done.returncode == 0, done.stderr
    assert "of 2048 MiB are in use, one buffer has 512 MiB at most" in done.stdout
