"""Several targets in one call, and frames given as `out`: each frame equals the result of a separate call."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import pyibr as ibr
from pyibr.opencl.memory import DeviceArray
from pyibr.picture.target import Target
from tests import scenes
from tests.exact import same_bits

SIZE = (97, 61)


def targets(view: ibr.DepthImage) -> list[ibr.Camera]:
    """Six targets of two sizes, at stereo steps and other poses; one camera occurs twice."""
    camera = view.camera
    small = camera.resized((50, 33))
    return [camera.moved(0.1, 0, 0), camera.moved(-0.2, 0, 0), small, camera.moved(0.1, 0.2, 0.3), camera, small]


@pytest.mark.parametrize("method", ["epipolar", "search", "forward"])
@pytest.mark.parametrize("fill", [None, "background", "smooth"])
def test_each_frame_is_that_of_its_own_call(method, fill):
    views = [scenes.stepped(SIZE), scenes.holed(SIZE)]
    frames = ibr.warp(views, targets(views[0]), method=method, fill=fill)
    assert len(frames) == 6
    for frame, camera in zip(frames, targets(views[0]), strict=True):
        same_bits(frame, ibr.warp(views, camera, method=method, fill=fill))
        assert frame.camera == camera


def blank(camera: ibr.Camera) -> ibr.Frame:
    shape = camera.height, camera.width
    return ibr.Frame(np.full((*shape, 3), 7, np.uint8), np.full(shape, 7, np.float32), np.ones(shape, bool), camera)


@pytest.mark.usefixtures("lanes")
def test_given_frames_are_written():
    view = scenes.stepped(SIZE)
    cameras = targets(view)
    given = [blank(camera) for camera in cameras]
    frames = ibr.warp(view, cameras, out=given)
    for frame, own, camera in zip(frames, given, cameras, strict=True):
        assert frame.color is own.color
        assert frame.depth is own.depth
        assert frame.valid is own.valid
        same_bits(frame, ibr.warp(view, camera))
    # A second call overwrites the previous content.
    same_bits(ibr.warp(view, cameras[1], out=given[0]), ibr.warp(view, cameras[1]))


@pytest.mark.parametrize(
    ("change", "argument"),
    [
        ({"depth": np.zeros((61, 97))}, "out.depth"),
        ({"color": np.zeros((61, 96, 3), np.uint8)}, "out.color"),
        ({"color": np.zeros((61, 97, 3), np.float32)}, "out.color"),
        ({"valid": np.zeros((61, 97), np.uint8)}, "out.valid"),
        ({"depth": np.zeros((97, 61), np.float32).T}, "out.depth"),
        ({"depth": np.broadcast_to(np.float32(0), (61, 97))}, "out.depth"),
        ({"valid": [[True]]}, "out.valid"),
    ],
)
def test_what_cannot_be_written_is_told(change, argument):
    view = scenes.stepped(SIZE)
    with pytest.raises(ibr.ArgumentError, match=argument):
        ibr.warp(view, view.camera, out=replace(blank(view.camera), **change))


def test_out_fits_the_cameras():
    view = scenes.stepped(SIZE)
    camera, frame = view.camera, blank(view.camera)
    for cameras, out in ((camera, [frame]), ([camera], frame), ([camera, camera], [frame]), (camera, view)):
        with pytest.raises(ibr.ArgumentError, match="out"):
            ibr.warp(view, cameras, out=out)
    with pytest.raises(ibr.ArgumentError, match="memory of its own"):
        ibr.warp(view, [camera, camera], out=[frame, frame])
    other = ibr.DepthImage(view.color, view.depth, camera)
    for given in (view, other):  # `out` may share memory with none of the views
        shared = replace(frame, depth=np.array(given.depth))
        views = [
            ibr.DepthImage(one.color, shared.depth if one is given else one.depth, camera) for one in (view, other)
        ]
        with pytest.raises(ibr.ArgumentError, match=r"^out\.depth: .*memory of its own"):
            ibr.warp(views, camera, out=shared)
    with pytest.raises(ibr.ArgumentError, match="camera"):
        ibr.warp(view, [])
    with pytest.raises(ibr.ArgumentError, match="camera"):
        ibr.warp(view, [camera, None])


@pytest.mark.usefixtures("lanes")
@pytest.mark.parametrize("step", [(0.2, 0.0), (-0.2, 0.0), (0.0, 0.2), (0.0, -0.2), (0.2, 0.1)])
def test_what_earlier_calls_left_in_memory_shows_nowhere(monkeypatch, step):
    view = scenes.stepped(SIZE)
    camera = view.camera.moved(*step, 0)
    K = np.add(camera.K, [[0, 0, 17], [0, 0, 29], [0, 0, 0]])  # no source in its first rows and columns
    larger = ibr.Camera(K, (131, 117), camera.world_from_camera)
    expected = ibr.warp(view, larger)
    assert expected.valid.any() and not expected.valid[0].any() and not expected.valid[:, 0].any()
    scratch = Target.scratch

    def written(target: Target, count: int, number: int = 0) -> DeviceArray:
        array = scratch(target, count, number)
        array.fill(1 / 3)
        return array

    monkeypatch.setattr(Target, "scratch", written)
    same_bits(ibr.warp(view, larger), expected)


def test_targets_that_see_nothing_are_told_by_their_numbers():
    view = scenes.stepped(SIZE)
    away = view.camera.moved(1e4, 0, 0)
    with pytest.warns(UserWarning, match="target cameras 0, 2 see nothing"):
        ibr.warp(view, [away, view.camera, away])
