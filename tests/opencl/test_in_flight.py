"""Long launches are split into pieces, by measured costs of kernels; the pictures stay the same."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Generator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import pyibr as ibr
from pyibr.opencl import in_flight, launch, program
from pyibr.opencl.device import current
from pyibr.opencl.in_flight import KernelCost, piece_of
from pyibr.opencl.memory import empty
from pyibr.opencl.watch import Traffic, Watch, watching
from tests import scenes
from tests.one_lane import one_lane
from tests.opencl.setting import signatures
from tools.everything import calls, same

WIDE = {"prepare"}
"""Kernels that only run on CPUs."""


@contextmanager
def pieces(items: int | None = None) -> Generator[Counter[str], None, None]:
    """Yield the number of pieces started for each kernel; `items` limits the work-items of each piece."""
    started: Counter[str] = Counter()
    start = launch._start

    def counted(kernel: Any, *rest: Any, **how: Any) -> Any:
        started[kernel.name] += 1
        return start(kernel, *rest, **how)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(launch, "_start", counted)
        if items is not None:
            patch.setattr(launch, "UNSPLIT_SECONDS", -1.0)
            patch.setattr(KernelCost, "piece_after", lambda *rest: items)
        yield started


@pytest.mark.parametrize("grid", [(7,), (5, 3), (1, 9), (4, 1), (3, 2, 5), (1, 1, 1)])
@pytest.mark.parametrize("most", [1, 2, 3, 5, 7, 1000])
def test_pieces_hold_each_work_item_once(grid: tuple[int, ...], most: int):
    held = np.zeros(grid, int)
    done = 0
    while done < math.prod(grid):
        offset, size = piece_of(grid, done, most)
        assert math.prod(size) <= most
        held[tuple(slice(low, low + extent) for low, extent in zip(offset, size, strict=True))] += 1
        done += math.prod(size)
    assert (held == 1).all()


@contextmanager
def padded() -> Generator[None, None, None]:
    """Pad launches with work-items beyond the grid, as a GPU pads them to whole groups."""
    start = launch._start

    def more(kernel: Any, offset: tuple[int, ...], size: tuple[int, ...], *rest: Any, whole: bool = False) -> Any:
        beyond = (31, 3, 0) if whole and kernel.name != "find_noise" else (0, 0, 0)  # find_noise has a single group
        return start(kernel, offset, tuple(map(sum, zip(size, beyond, strict=False))), *rest)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(launch, "_start", more)
        yield


@pytest.mark.parametrize("lanes", ["wide", pytest.param("one", marks=pytest.mark.thorough)])
def test_all_kernels_give_the_same_in_pieces_and_in_padded_launches(lanes: str):
    known = {*signatures(suffix=".cl" if lanes == "wide" else ".*")}  # kernels in headers are for GPUs only
    seen: Counter[str] = Counter()
    if lanes == "one":
        known -= WIDE
    with one_lane() if lanes == "one" else watching(Watch()):
        for name, call in calls().items():
            whole = call()
            with pieces(3 if lanes == "wide" else 16) as started:
                assert same(call(), whole), name
            seen |= started
            if lanes == "one":
                with padded():
                    assert same(call(), whole), name
    assert seen.keys() == known
    of_few_items = ("find_coarse", "refine_coarse", "push_", "pull_", "find_noise")
    assert not [name for name in known if seen[name] <= 1 and not name.startswith(of_few_items)]


def test_short_launches_stay_whole():
    view = scenes.smooth((64, 48))
    camera = view.camera.moved(0.1, 0.1, 0.1)
    ibr.warp(view, camera)
    made = current().kernels.values()
    kept = [(kernel.cost, kernel.cost.seconds_per_item) for kernel in made]
    try:
        for cost, _ in kept:
            cost.seconds_per_item = 0.0  # as if the device were infinitely fast
        with pieces() as started, watching(Traffic()) as seen:
            ibr.warp(view, camera)
        launches = Counter(name for what, name, _ in seen.of if what == "launch")
        assert started == launches and set(launches.values()) == {1}
    finally:
        for cost, item in kept:
            cost.seconds_per_item = item


def test_a_launch_of_nothing_tells_no_pace():
    made = empty((4,), np.float32)
    clear = program.kernel("lib/clear.cl", "clear")
    before = clear.cost.seconds_per_item
    launch.launch(clear, (0,), values=made, count=0, share=1, value=0.0)
    assert clear.cost.seconds_per_item == before > 0


class _Done:
    """Stands in for an OpenCL event that has ended, with its start and end times."""

    def __init__(self, seconds: float) -> None:
        self.profile = SimpleNamespace(start=7, end=7 + round(1e9 * seconds))


def test_what_takes_longer_than_expected_is_slower_from_then_on():
    """A kernel's cost is measured without the time of other threads' launches in the queue."""
    quick, cost = KernelCost(1e-6), KernelCost(2e-6)
    flying = in_flight.InFlight()

    def finished(waited: float, took: float) -> tuple[float, float]:
        launches: list[tuple[KernelCost, Any]] = [(cost, _Done(took)), (quick, _Done(0.001))]
        for one, event in launches:
            flying.used.append(object())
            flying.add(one, 1000, event)
        flying.finish(waited)
        assert not flying.used and flying.seconds == 0
        return cost.seconds_per_item, quick.seconds_per_item

    assert finished(in_flight.QUEUED_SECONDS_MAX / 2, 0.02) == (2e-6, 1e-6), "too short to ask"
    assert finished(2.0, 0.007) == (2e-6, 1e-6)
    assert finished(2.0, 0.02) == (pytest.approx(2e-5), 1e-6)


def test_few_seconds_of_launches_wait_in_the_queue():
    view = scenes.smooth((64, 48))
    cameras = [view.camera.moved(0.01 * i, 0.1, 0.1) for i in range(9)]
    ibr.warp(view, cameras)
    session, ahead = current(), list[float]()
    start = launch._start

    def seen(kernel: Any, offset: Any, size: Any, arguments: Any, **how: Any) -> Any:
        ahead.append(session.in_flight.seconds + math.prod(size) * kernel.cost.seconds_per_item)
        return start(kernel, offset, size, arguments, **how)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(launch, "_start", seen)
        patch.setattr(launch, "QUEUED_SECONDS_MAX", 0.01)
        for kernel in session.kernels.values():
            quick = min(kernel.cost.seconds_per_item, in_flight.UNSPLIT_SECONDS / 1000)
            patch.setattr(kernel.cost, "seconds_per_item", quick)
        ibr.warp(view, cameras)
    assert 0 < max(ahead) <= 0.01
