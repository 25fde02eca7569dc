"""Copies between the host and a device with its own memory, counted with the kernels' form for GPUs."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

import pyibr as ibr
from pyibr.opencl.device import current, one_call
from pyibr.opencl.headers import struct
from pyibr.opencl.memory import begin_to_host, empty
from pyibr.opencl.watch import Traffic, watching
from pyibr.picture.samples import view_of
from pyibr.picture.target import Target
from pyibr.warp.view import WarpedView
from tests import scenes
from tests.exact import same_bits
from tests.one_lane import one_lane

_GROUPS = 4 * 5  # largest number of groups of epipolar lines: fans times spacings (`pyibr.warp.lines`)
_CAMERA = _GROUPS * struct("warp/lines.h", "LineGroup").itemsize  # bytes of all groups of a target's lines
_SIZE = (97, 61)


@pytest.fixture(autouse=True)
def copied_memory() -> Iterator[None]:
    with one_lane():
        yield


def traffic_of(views: Any, camera: Any, **options: Any) -> Traffic:
    """Copies, launches and waits of a second warp of views that the device still holds."""
    ibr.warp(views, camera, **options)
    with watching(Traffic()) as seen:
        ibr.warp(views, camera, **options)
    return seen


@pytest.mark.parametrize(("options", "most"), [({}, 4), ({"fill": "background"}, 13)])
def test_a_further_frame_uploads_its_camera_and_waits_once(options: dict[str, Any], most: int):
    view = scenes.stepped(_SIZE)
    seen = traffic_of(view, view.camera.moved(0.15, 0.2, 0.3), **options)
    assert 0 < seen.total("upload") <= _CAMERA
    assert seen.count("wait") == 1
    assert seen.total("download") == (3 + 4 + 1) * view.depth.size
    assert seen.count("launch") <= most


def test_several_targets_are_copied_back_beside_launches():
    view = scenes.stepped(_SIZE)
    seen = traffic_of(view, [view.camera.moved(0.1, 0.2, 0.1 * step) for step in range(3)])
    kinds = [kind for kind, _, _ in seen.of]
    assert kinds.count("wait") == 1 and kinds[-1] == "wait"
    last_launch = len(kinds) - 1 - kinds[::-1].index("launch")
    assert kinds[:last_launch].count("download") == 2 * 3  # all targets except the last
    assert current().copies != current().queue


def test_copies_begin_after_the_launches_before_them():
    array = empty((1 << 20,), np.float32)
    for value in range(8):
        array.fill(value)
        (values,) = begin_to_host([array])
        current().wait()
        assert (values == value).all()


def test_a_picture_on_the_device_is_the_next_calls_view():
    view = scenes.stepped(_SIZE)
    camera, back = view.camera.moved(0.1, 0.2, 0.1), view.camera.moved(0.05, 0.1, 0.0)
    with one_call():
        target = Target(camera, view.color.dtype)
        WarpedView(view).draw(target, None)
        with watching(Traffic()) as seen:
            kept = view_of(target)
    frame = ibr.warp(view, camera)
    assert seen.total("upload") == 0
    same_bits(ibr.warp(kept, back), ibr.warp(ibr.DepthImage(frame.color, frame.depth, camera), back))
