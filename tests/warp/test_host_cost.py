"""The host's work for small pictures: numbers of function calls and OpenCL commands, equal on all machines."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from types import FrameType

import pytest

import pyibr as ibr
from pyibr.opencl import launch, memory
from pyibr.opencl.watch import Traffic, watching
from tests import scenes
from tests.one_lane import skip_where_unused

_SIZE = (67, 61)


@pytest.fixture(autouse=True)
def whole_launches(monkeypatch: pytest.MonkeyPatch) -> None:
    """Switch off the rules that split slow launches and wait for them, since a busy machine makes all launches slow."""
    monkeypatch.setattr(launch, "UNSPLIT_SECONDS", math.inf)
    monkeypatch.setattr(launch, "QUEUED_SECONDS_MAX", math.inf)


def calls_of(task: Callable[[], object]) -> int:
    """Count the calls of functions, in Python or built in, during a task that has run once and filled its caches."""
    task()
    seen = 0

    def count(frame: FrameType, event: str, _: object) -> None:
        nonlocal seen
        seen += event in ("call", "c_call")

    def counted() -> int:
        nonlocal seen
        seen, before = 0, sys.getprofile()
        sys.setprofile(count)
        try:
            task()
        finally:
            sys.setprofile(before)
        return seen

    return min(counted() for _ in range(3))  # least: freeing other tests' objects adds calls


@pytest.mark.parametrize(("edges", "fresh", "kept"), [("cut", 1500, 900), ("connect", 1400, 880)])
def test_a_small_warp_is_few_calls(edges, fresh, kept):
    view = scenes.stepped(_SIZE)
    camera = view.camera.moved(0.2, 0.1, 0.1)
    anew = calls_of(lambda: ibr.warp(ibr.DepthImage(view.color, view.depth, view.camera), camera, edges=edges))
    again = calls_of(lambda: ibr.warp(view, camera, edges=edges))
    assert (again < anew) and (anew <= fresh) and (again <= kept), (anew, again)


def test_a_small_mesh_is_few_calls():
    square = ibr.Mesh([[-1, -1, 3], [1, -1, 3], [-1, 1, 3], [1, 1, 3]], [[0, 1, 2], [3, 2, 1]])
    camera = ibr.Camera([[60, 0, 33], [0, 60, 30], [0, 0, 1]], _SIZE)
    assert calls_of(lambda: ibr.render(square, camera)) <= 950


@pytest.mark.parametrize(
    ("moved", "launches"),
    [
        ((0.2, 0.1, 0.1), ["clear", "epipolar_sweep", "draw_patches", "resolve"]),
        ((0.2, 0.0, 0.0), ["epipolar_sweep", "draw_patches", "resolve"]),
    ],
)
def test_a_fresh_warp_is_few_commands(moved, launches, lanes, monkeypatch: pytest.MonkeyPatch):
    skip_where_unused(lanes)
    view = scenes.smooth(_SIZE)
    depth = view.depth.copy()
    depth[20:40, 20:40] = 1.0
    camera = view.camera.moved(*moved)
    prepares = ["find_noise", "prepare"]
    if lanes == 1:  # for GPUs, `prepare` is four launches, and the picture is cleared first
        prepares = ["find_noise", "to_nearness", "find_edges", "continue_border", "look_around"]
        launches = ["clear", *(name for name in launches if name != "clear")]
        launches.insert(1, "bound_surface")
    taken = list[int]()
    take = memory._take
    monkeypatch.setattr(memory, "_take", lambda session, size: taken.append(size) or take(session, size))
    ibr.warp(ibr.DepthImage(view.color, depth, view.camera), camera)  # fills the caches
    taken.clear()
    with watching(Traffic()) as seen:
        ibr.warp(ibr.DepthImage(view.color, depth, view.camera), camera)
    assert [name for what, name, _ in seen.of if what == "launch"] == [*prepares, *launches]
    assert sum(what == "wait" for what, _, _ in seen.of) == 2
    assert sum(what == "upload" for what, _, _ in seen.of) == 3  # depth, colours and groups of lines
    assert len(taken) <= (13 if lanes == 16 else 18)
