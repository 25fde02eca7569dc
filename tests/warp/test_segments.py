"""Epipolar lines cut into segments, as on GPUs: they give the same frames as whole lines, and enough work-items."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import pyibr as ibr
from benchmarks import scenes as reliefs
from benchmarks.launches import counted_samples
from pyibr.core.camera import Projection
from pyibr.opencl.watch import Traffic, watching
from tests import scenes
from tests.exact import same_bits
from tests.one_lane import one_lane

pytestmark = pytest.mark.thorough

_SIDE, _FULL = 192, 1024  # pixels: work-items are counted for a side of 192; _ITEMS is for a side of 1024
_ITEMS, _ITEMS_SIDEWAYS = 64_000, 16_000


def pairs(view: ibr.DepthImage, cameras: list[ibr.Camera], **options: Any) -> list[tuple[ibr.Frame, ibr.Frame]]:
    """For each camera, a frame by segments and a frame by whole lines."""
    with one_lane():
        cut = [ibr.warp(view, camera, **options) for camera in cameras]
    with one_lane(segment=0):
        return [(frame, ibr.warp(view, camera, **options)) for frame, camera in zip(cut, cameras, strict=True)]


@pytest.mark.parametrize("scene", [scenes.stepped, scenes.holed])
@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_segments_make_the_same_frames(scene: Any, projection: Projection):
    view = scene((96, 64), projection)
    cameras = [pose.camera for place in "AEF" for pose in scenes.target_cameras(view, place)]
    cameras += [view.camera.moved(0.2, 0, 0), view.camera.moved(0, -0.3, 0)]
    for cut, whole in pairs(view, cameras):
        same_bits(cut, whole)


@pytest.mark.parametrize("edges", ["cut", "connect"])
def test_where_lines_are_walked_from_edge_to_edge_last_bits_may_differ(edges: str):
    """Distances are measured from the start of a walk, so that their last bits depend on the start."""
    view = scenes.stepped((96, 64))
    cameras = [pose.camera for pose in (*scenes.special_cameras(view), *scenes.target_cameras(view, "E"))]
    for cut, whole in pairs(view, cameras, edges=edges):
        assert (cut.valid == whole.valid).mean() >= 0.999
        both = cut.valid & whole.valid
        assert np.isclose(cut.depth, whole.depth, rtol=1e-5, atol=0)[both].mean() >= 0.999


def swept(view: ibr.DepthImage, camera: ibr.Camera) -> tuple[int, int]:
    """Number of the sweep's work-items, and the number of samples and pixels that all of them visit."""
    with watching(Traffic()) as seen:
        ibr.warp(view, camera)
    with counted_samples() as visited:
        ibr.warp(view, camera)
    (items,) = [items for _, name, items in seen.of if name == "epipolar_sweep"]
    return items, visited["epipolar_sweep"].samples + visited["epipolar_sweep"].pixels


@pytest.mark.parametrize("position", ["A", "E", "F", "sideways"])
def test_lines_keep_a_gpu_busy_and_are_walked_once(position: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("benchmarks.launches.COUNTED", ("epipolar_sweep",))
    view = reliefs.view(_SIDE)
    sideways = position == "sideways"
    camera = view.camera.moved(0.3, 0, 0) if sideways else reliefs.target_camera(_SIDE, position, "forward")
    with one_lane(segment=0):
        _, least = swept(view, camera)
    with one_lane():
        items, visits = swept(view, camera)
    assert items >= (_ITEMS_SIDEWAYS if sideways else _ITEMS) * (_SIDE / _FULL) ** 2
    assert visits <= 1.3 * least
