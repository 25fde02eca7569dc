"""Long launches go in pieces: the same pictures, Ctrl-C between them, and everything in order afterwards."""

from __future__ import annotations

import math
import random
import re
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np
import pytest

import pyibr as ibr
from pyibr.opencl import device, in_flight, launch, program
from pyibr.opencl.device import current
from pyibr.opencl.headers import kernels_folder
from pyibr.opencl.in_flight import KernelCost, piece_of
from pyibr.opencl.memory import empty
from pyibr.opencl.watch import Watch, watching
from tests import scenes
from tests.one_lane import one_lane
from tests.opencl.everything import Call, calls, same
from tests.processes import with_path


@contextmanager
def pieces(items: int | None = None) -> Generator[Counter[str], None, None]:
    """Yields how many are started of each kernel; all launches are cut to so many work-items, if that is given."""
    started: Counter[str] = Counter()
    start = launch._start

    def counted(kernel: Any, *rest: Any) -> None:
        started[kernel.name] += 1
        start(kernel, *rest)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(launch, "_start", counted)
        if items is not None:
            patch.setattr(launch, "UNSPLIT_SECONDS", -1.0)
            patch.setattr(KernelCost, "piece_after", lambda cost, done, seconds: items)
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


@pytest.mark.parametrize("lanes", ["wide", pytest.param("one", marks=pytest.mark.thorough)])
def test_all_kernels_give_the_same_in_pieces(lanes: str):
    known = {name for path in kernels_folder().rglob("*.cl") for name in _kernels_of(path.read_text())}
    seen: Counter[str] = Counter()
    with one_lane() if lanes == "one" else watching(Watch()):
        for name, call in calls().items():
            whole = call()
            with pieces(3) as started:
                assert same(call(), whole), name
            seen |= started
    assert seen.keys() == known
    of_few_items = ("find_coarse", "refine_coarse", "push_", "pull_")
    assert not [name for name in known if seen[name] <= 1 and not name.startswith(of_few_items)]


def _kernels_of(source: str) -> list[str]:
    return re.findall(r"^kernel void (\w+)", source, re.MULTILINE)


def test_short_launches_stay_whole():
    view = scenes.smooth((64, 48))
    camera = view.camera.moved(0.1, 0.1, 0.1)
    ibr.warp(view, camera)
    made = current().kernels.values()
    kept = [(kernel.cost, kernel.cost.seconds_per_item) for kernel in made]
    try:
        for cost, _ in kept:
            cost.seconds_per_item = 0.0  # as on the quickest of devices
        launches: Counter[str] = Counter()
        with pieces() as started, watching(_Counted(launches)):
            ibr.warp(view, camera)
        assert started == launches and set(launches.values()) == {1}
    finally:
        for cost, item in kept:
            cost.seconds_per_item = item


class _Counted(Watch):
    def __init__(self, launches: Counter[str]) -> None:
        self.launches = launches

    def launch(
        self, kernel: Any, grid: tuple[int, ...], arguments: Mapping[str, Any], enqueue: Callable[..., None]
    ) -> None:
        self.launches[kernel.name] += 1
        enqueue(**arguments)


def test_a_launch_of_nothing_tells_no_pace():
    made = empty((4,), np.float32)
    clear = program.kernel("lib/clear.cl", "clear")
    before = clear.cost.seconds_per_item
    launch.launch(clear, (0,), values=made, count=0, share=1, value=0.0)
    assert clear.cost.seconds_per_item == before > 0


def test_what_takes_longer_than_expected_is_slower_from_then_on():
    held, quick, cost = object(), KernelCost(1e-6), KernelCost(2e-6)
    flying = in_flight.InFlight()
    flying.add(held, cost, 0.002)
    flying.add(held, quick, 0.001)
    flying.finish(in_flight.QUEUED_SECONDS_MAX / 2)
    assert (cost.seconds_per_item, quick.seconds_per_item) == (2e-6, 1e-6) and not flying.used  # too short to tell
    for _ in range(2):  # once slower, not twice
        flying.add(held, cost, 0.001)
    flying.finish(2.0)
    assert cost.seconds_per_item == pytest.approx(2e-3) and quick.seconds_per_item == 1e-6


def test_few_seconds_of_launches_wait_in_the_queue():
    view = scenes.smooth((64, 48))
    cameras = [view.camera.moved(0.01 * i, 0.1, 0.1) for i in range(9)]
    ibr.warp(view, cameras)
    session, ahead = current(), list[float]()
    start = launch._start

    def seen(*arguments: Any) -> None:
        start(*arguments)
        ahead.append(session.in_flight.seconds)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(launch, "_start", seen)
        patch.setattr(launch, "QUEUED_SECONDS_MAX", 0.01)
        for kernel in session.kernels.values():
            quick = min(kernel.cost.seconds_per_item, in_flight.UNSPLIT_SECONDS / 1000)
            patch.setattr(kernel.cost, "seconds_per_item", quick)
        ibr.warp(view, cameras)
    assert 0 < max(ahead) <= 0.01


class _Interrupted(Watch):
    """Raises KeyboardInterrupt at one launch, before or after it."""

    def __init__(self, at: int, after: bool) -> None:
        self.left, self.after = at, after

    def launch(
        self, kernel: Any, grid: tuple[int, ...], arguments: Mapping[str, Any], enqueue: Callable[..., None]
    ) -> None:
        self.left -= 1
        if self.left == 0 and not self.after:
            raise KeyboardInterrupt
        enqueue(**arguments)
        if self.left == 0:
            raise KeyboardInterrupt


def _in_order(call: Call, expected: list[Any]) -> None:
    """The next call is right to the bit and leaves nothing, and other threads have their turn."""
    session = current()
    assert same(call(), expected)
    assert not session.in_flight.used
    turns: list[bool] = []

    def take_one() -> None:
        turns.append(session.lock.acquire(timeout=60))
        session.lock.release()

    other = threading.Thread(target=take_one)
    other.start()
    other.join()
    assert turns == [True]


@pytest.mark.parametrize("cut", [None, 40])
def test_calls_after_one_that_ended_at_some_launch(cut: int | None):
    chance = random.Random(7)
    for call in calls().values():
        expected = call()
        for _ in range(2):
            watch = _Interrupted(chance.randint(1, 8), chance.random() < 0.5)
            with pieces(cut), watching(watch), suppress(KeyboardInterrupt):
                call()
            _in_order(call, expected)


ALARMS = """
import gc, random, signal, threading, time
from pyibr.opencl import device
from pyibr.opencl.memory import DeviceArray
from tests.opencl.everything import calls, same

def ring(number, frame):
    if frame.f_code.co_name != "<module>":  # in a call, not just before or after it
        raise KeyboardInterrupt

def held():
    gc.collect()
    return sum(isinstance(one, DeviceArray) for one in gc.get_objects())

def take_a_turn():
    turns.append(session.lock.acquire(timeout=60))
    session.lock.release()

signal.signal(signal.SIGALRM, ring)
chance, found, expected, seconds = random.Random(5), calls(), {}, {}
for name, call in found.items():
    call()
    start = time.perf_counter()
    expected[name] = call()
    seconds[name] = time.perf_counter() - start
session, turns, before, rung = device.current(), [], held(), 0
while rung < 30:
    name = chance.choice(list(found))
    try:
        signal.setitimer(signal.ITIMER_REAL, chance.uniform(1e-5, seconds[name]))
        found[name]()
    except KeyboardInterrupt:
        rung += 1
    except TypeError as error:  # NumPy takes an interrupt amid this comparison for a failed one
        assert "Cannot compare structured arrays" in str(error)
        rung += 1
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
    other = threading.Thread(target=take_a_turn)
    other.start()
    other.join()
    assert turns[-1] and device._chosen.get() is None, name
    assert same(found[name](), expected[name]), name
    assert not session.in_flight.used, name
assert held() == before, (before, held())
assert session.memory_pool.size >= sum(block.size for block in session.memory_pool)
print("in order")
"""


SEARCH = """
import os, signal, socket, sys, threading
import pyibr as ibr
from pyibr.opencl import in_flight, launch
from tests import scenes

started, at_signal = [0], None
start = launch._start

def counted(*arguments):
    started[0] += 1
    start(*arguments)
    if at_signal is not None and started[0] == 5:
        print("searching", flush=True)

view = scenes.stepped((320, 240))
camera = view.camera.moved(0.2, 0.1, 0.3)
expected = ibr.warp(view, camera, method="search")
launch._start, launch.UNSPLIT_SECONDS, in_flight.KernelCost.piece_after = counted, -1.0, lambda *rest: 100
ibr.warp(view, camera, method="search")
assert started[0] > 40, started
started, at_signal = [0], []
(mine, theirs), here = socket.socketpair(), lambda: at_signal.append((theirs.recv(1), started[0]))
mine.setblocking(False)
signal.set_wakeup_fd(mine.fileno())  # written to when the signal is there, whatever Python does
thread = threading.Thread(target=here)
thread.start()
try:
    while True:
        ibr.warp(view, camera, method="search")
except KeyboardInterrupt:
    pass
stopped = started[0]
thread.join()
assert stopped - at_signal[0][1] <= 2, (stopped, at_signal)
frame = ibr.warp(view, camera, method="search")
assert all(getattr(frame, a).tobytes() == getattr(expected, a).tobytes() for a in ("color", "depth", "valid"))
print("in order")
"""


def _child(script: str) -> subprocess.Popen[str]:
    pipe = subprocess.PIPE
    return subprocess.Popen([sys.executable, "-c", script], env=with_path(), stdout=pipe, stderr=pipe, text=True)


posix = pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="Windows has no timers that raise signals")


@pytest.mark.thorough
@posix
def test_calls_after_one_that_ended_at_any_moment():
    with _child(ALARMS) as child:
        out, errors = child.communicate(timeout=600)
    assert out == "in order\n", errors


@posix
def test_ctrl_c_ends_a_search_within_a_piece():
    with _child(SEARCH) as child:
        assert child.stdout is not None
        child.stdout.readline()
        child.send_signal(signal.SIGINT)
        out, errors = child.communicate(timeout=300)
    assert out.endswith("in order\n"), errors


@pytest.mark.thorough
@pytest.mark.parametrize("lanes", ["wide", "one"])
def test_other_threads_run_while_a_call_waits(lanes: str):
    view = scenes.stepped((320, 240))
    camera = view.camera.moved(0.2, 0.1, 0.3)
    with one_lane() if lanes == "one" else watching(Watch()):
        ibr.warp(view, camera, method="search")
        done, during = threading.Event(), [0, 0]

        def count() -> None:
            while not done.is_set():
                during[waiting[0]] += 1
                time.sleep(1e-4)

        waiting = [0]
        session = current()
        wait = type(session).wait

        def noted(self: Any) -> None:
            waiting[0] = 1
            wait(self)
            waiting[0] = 0

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(type(session), "wait", noted)
            patch.setattr(launch, "UNSPLIT_SECONDS", math.inf)
            patch.setattr(launch, "QUEUED_SECONDS_MAX", math.inf)
            thread = threading.Thread(target=count)
            thread.start()
            ibr.warp(view, camera, method="search")
            done.set()
            thread.join()
    assert during[1] > 10, during


def test_launches_go_in_pieces_outside_of_a_call_too():
    """Other threads have their turn afterwards: nothing is held that was not before."""

    def cleared() -> list[Any]:
        values = empty((100,), np.float32)
        clear = program.kernel("lib/clear.cl", "clear")
        launch.launch(clear, (10,), values=values, count=100, share=10, value=2.5)
        return [values.to_host()]

    with pieces(3) as started:
        assert (cleared()[0] == 2.5).all() and started["clear"] == 4
    _in_order(cleared, [np.full(100, 2.5, np.float32)])


def test_threads_take_turns():
    """Nobody waits for more than a few calls of the others."""
    view = scenes.smooth((64, 48))
    ended: list[int] = []
    full = threading.Event()

    def draw(number: int) -> None:
        camera = view.camera.moved(0.01 * number, 0.1, 0.1)
        while not full.is_set():
            ibr.warp(view, camera)
            ended.append(number)
            if len(ended) >= 300:
                full.set()

    threads = [threading.Thread(target=draw, args=(number,)) for number in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert min(Counter(ended[:300]).values()) >= 30 and len(Counter(ended)) == 3


def test_short_calls_go_between_the_pieces_of_a_long_one():
    view, small = scenes.stepped((160, 120)), scenes.smooth((31, 23))
    far, near = view.camera.moved(0.2, 0.1, 0.3), small.camera.moved(0.1, 0, 0)
    expected, expected_short = ibr.warp(view, far, method="search"), ibr.warp(small, near, method="search")
    with pieces(10) as launches:
        ibr.warp(view, far, method="search")
        ibr.warp(small, near, method="search")
    alone = launches["search"]
    assert alone > 80
    shorts: list[ibr.Frame] = []
    with pieces(10) as launches:
        long = threading.Thread(target=lambda: shorts.append(ibr.warp(view, far, method="search")))
        long.start()
        while launches["search"] < 5:
            time.sleep(1e-4)
        frame, then = ibr.warp(small, near, method="search"), launches["search"]
        long.join()
    assert then < alone / 2 and launches["search"] == alone
    for made, wanted in ((frame, expected_short), (shorts[0], expected)):
        assert all(np.array_equal(getattr(made, a), getattr(wanted, a), True) for a in ("color", "depth", "valid"))


def test_who_is_alone_makes_no_gaps_between_pieces(monkeypatch: pytest.MonkeyPatch):
    view, gaps = scenes.smooth((31, 23)), list[object]()
    monkeypatch.setattr(device, "yield_lock", gaps.append)
    with pieces(3) as started:
        ibr.warp(view, view.camera.moved(0.1, 0, 0), method="search")
    assert started["search"] > 3 and not gaps
    assert not current().waiting


HELD = """
import signal, threading, time
from pyibr.opencl import locks

lock, inside, out = threading.RLock(), threading.Event(), threading.Event()

def hold():
    with lock:
        inside.set()
        out.wait()

with lock:
    other = threading.Thread(target=hold)
    other.start()
    here = threading.get_ident()
    ring = threading.Timer(0.3, lambda: (signal.pthread_kill(here, signal.SIGINT), time.sleep(0.3), out.set()))
    ring.start()
    try:
        while True:
            locks.yield_lock(lock)
    except KeyboardInterrupt:
        assert lock._is_owned() and out.is_set()
assert not lock._is_owned()
print("in order")
"""


@posix
def test_ctrl_c_while_another_has_his_turn_counts_once_it_is_over():
    with _child(HELD) as child:
        out, errors = child.communicate(timeout=60)
    assert out == "in order\n", errors
