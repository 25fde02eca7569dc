"""The host's part of small pictures: counted in calls, which are the same on every machine."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from types import FrameType

import pytest

import pyibr as ibr
from pyibr.opencl import launch
from tests import scenes

_SIZE = (67, 61)


@pytest.fixture(autouse=True)
def whole_launches(monkeypatch: pytest.MonkeyPatch) -> None:
    """None is cut or awaited because it took long on a busy machine."""
    monkeypatch.setattr(launch, "UNSPLIT_SECONDS", math.inf)
    monkeypatch.setattr(launch, "QUEUED_SECONDS_MAX", math.inf)


def calls_of(task: Callable[[], object]) -> int:
    """Calls of functions, Python's and built in, that a task makes when all that is made once is there."""
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

    return min(counted() for _ in range(3))  # what others left may go meanwhile


@pytest.mark.parametrize(("edges", "fresh", "kept"), [("cut", 1950, 900), ("connect", 1700, 800)])
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
