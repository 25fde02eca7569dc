"""Calls that are interrupted, that wait, or that several threads make: results are right, and no memory is lost."""

from __future__ import annotations

import math
import random
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from typing import Any

import numpy as np
import pytest

import pyibr as ibr
from pyibr.opencl import calls as device_calls
from pyibr.opencl import device, in_flight, launch, program
from pyibr.opencl.device import current
from pyibr.opencl.device_cache import cached_on_device
from pyibr.opencl.memory import empty
from pyibr.opencl.watch import Watch, watching
from tests import scenes
from tests.one_lane import one_lane
from tests.opencl.test_in_flight import pieces
from tests.opencl.test_memory import refusing
from tools.everything import Call, arrays_of, calls, same
from tools.processes import run_within, with_path


class _Interrupted(Watch):
    """Raises KeyboardInterrupt before or after a certain launch."""

    def __init__(self, at: int, after: bool) -> None:
        self.left, self.after = at, after

    def launch(self, kernel, grid, arguments, enqueue) -> None:
        self.left -= 1
        if self.left == 0 and not self.after:
            raise KeyboardInterrupt
        enqueue(**arguments)
        if self.left == 0:
            raise KeyboardInterrupt


def _in_order(call: Call, expected: list[Any]) -> None:
    """Check that a further call gives the same bits and keeps no memory, and that no call is in progress afterwards."""
    session = current()
    assert same(call(), expected)
    assert not session.in_flight.used
    assert _seen_from_elsewhere(session) == []


def _seen_from_elsewhere(session: device.Session) -> list[object]:
    """List the calls in progress, as another thread sees them."""
    with ThreadPoolExecutor(1) as other:
        return other.submit(lambda: list(session.calls.others)).result()


@pytest.mark.thorough
def test_calls_after_one_that_ended_at_some_launch():
    chance = random.Random(7)
    for call in calls().values():
        expected = call()
        for cut in (None, 40):
            watch = _Interrupted(chance.randint(1, 8), chance.random() < 0.5)
            with pieces(cut), watching(watch), suppress(KeyboardInterrupt):
                call()
            _in_order(call, expected)


ALARMS = """
import gc, random, signal, time
from pyibr.opencl import device
from pyibr.opencl.memory import DeviceArray
from tools.everything import calls, same
from tests.opencl.test_calls import _seen_from_elsewhere

def ring(number, frame):
    if frame.f_code.co_name != "<module>":  # in a call, not just before or after it
        raise KeyboardInterrupt

def held():
    gc.collect()
    return sum(isinstance(one, DeviceArray) for one in gc.get_objects())

signal.signal(signal.SIGALRM, ring)
chance, found, expected, seconds = random.Random(5), calls(), {}, {}
for name, call in found.items():
    call()
    start = time.perf_counter()
    expected[name] = call()
    seconds[name] = time.perf_counter() - start
session, before, rung = device.current(), held(), 0
while rung < 30:
    name = chance.choice(list(found))
    try:
        signal.setitimer(signal.ITIMER_REAL, chance.uniform(1e-5, seconds[name]))
        found[name]()
    except KeyboardInterrupt:
        rung += 1
    except TypeError as error:  # NumPy reports an interrupt of this comparison as a failed comparison
        assert "Cannot compare structured arrays" in str(error)
        rung += 1
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
    assert not _seen_from_elsewhere(session) and device._chosen.get() is None, name
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

def counted(*arguments, **how):
    started[0] += 1
    event = start(*arguments, **how)
    if at_signal is not None and started[0] == 5:
        print("searching", flush=True)
    return event

view = scenes.stepped((320, 240))
camera = view.camera.moved(0.2, 0.1, 0.3)
expected = ibr.warp(view, camera, method="search")
launch._start, launch.UNSPLIT_SECONDS, in_flight.KernelCost.piece_after = counted, -1.0, lambda *rest: 100
ibr.warp(view, camera, method="search")
assert started[0] > 40, started
started, at_signal = [0], []
(mine, theirs), here = socket.socketpair(), lambda: at_signal.append((theirs.recv(1), started[0]))
mine.setblocking(False)
signal.set_wakeup_fd(mine.fileno())  # written as soon as the signal arrives, even if Python is busy
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


posix = pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="Windows has no timers that raise signals")


@pytest.mark.thorough
@posix
def test_calls_after_one_that_ended_at_any_moment():
    done = run_within(600, [sys.executable, "-c", ALARMS])
    assert done.stdout == "in order\n", done.stderr


@posix
def test_ctrl_c_ends_a_search_within_a_piece():
    command, pipe = [sys.executable, "-c", SEARCH], subprocess.PIPE
    with subprocess.Popen(command, env=with_path(), stdout=pipe, stderr=pipe, text=True) as child:
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
    def cleared() -> list[Any]:
        values = empty((100,), np.float32)
        clear = program.kernel("lib/clear.cl", "clear")
        launch.launch(clear, (10,), values=values, count=100, share=10, value=2.5)
        return [values.to_host()]

    with pieces(3) as started:
        assert (cleared()[0] == 2.5).all() and started["clear"] == 4
    _in_order(cleared, [np.full(100, 2.5, np.float32)])


def _warped(view: ibr.DepthImage, camera: ibr.Camera, **how: Any) -> list[Any]:
    return arrays_of(ibr.warp(view, camera, **how))


def test_threads_share_the_device():
    """No thread starves, and each gets the same pictures as alone."""
    view = scenes.smooth((64, 48))
    cameras = [view.camera.moved(0.01 * number, 0.1, 0.1) for number in range(3)]
    alone = [_warped(view, camera) for camera in cameras]
    rights: list[list[bool]] = [[], [], []]

    def draw(number: int) -> None:
        while min(map(len, rights)) < 50 and sum(map(len, rights)) < 3000:
            rights[number].append(same(_warped(view, cameras[number]), alone[number]))

    with ThreadPoolExecutor(3) as threads:
        list(threads.map(draw, range(3)))
    assert min(map(len, rights)) >= 50
    assert all(map(all, rights))


def test_short_calls_go_between_the_pieces_of_a_long_one():
    """A long call is held inside a launch until a short call ends, which must not wait for the long one."""
    view, small = scenes.stepped((160, 120)), scenes.smooth((31, 23))
    far, near = view.camera.moved(0.2, 0.1, 0.3), small.camera.moved(0.1, 0, 0)
    expected, expected_short = _warped(view, far, method="search"), _warped(small, near, method="search")
    begun, ended, longs = threading.Event(), threading.Event(), list[list[Any]]()
    long = threading.Thread(target=lambda: longs.append(_warped(view, far, method="search")))
    with pieces(10) as launches, pytest.MonkeyPatch.context() as patch:
        start = launch._start

        def stopping(kernel: Any, *rest: Any, **how: Any) -> Any:
            if threading.current_thread() is long and launches["search"] >= 5 and not begun.is_set():
                begun.set()
                assert ended.wait(60)
            return start(kernel, *rest, **how)

        patch.setattr(launch, "_start", stopping)
        long.start()
        begun.wait()
        short = _warped(small, near, method="search")
        ended.set()
        long.join()
    assert launches["search"] > 80
    assert same(short, expected_short) and same(longs[0], expected)


def test_a_call_that_began_later_goes_first_once():
    """A call waits once, for a limited time, for each call that began later and has work on the device."""
    ongoing, flying = device_calls.Calls(), in_flight.InFlight()
    begun, end, waited = threading.Event(), threading.Event(), list[object]()
    not_awaited = refusing(AssertionError())

    def later() -> None:
        with ongoing.one(flying, not_awaited):
            begun.set()
            ongoing.let_others()
            end.wait()

    thread = threading.Thread(target=later)
    with pytest.MonkeyPatch.context() as patch, ongoing.one(in_flight.InFlight(), not_awaited):
        thread.start()
        begun.wait()
        (call,) = ongoing.others
        patch.setattr(call, "wait", waited.append)
        ongoing.let_others()
        assert not waited, "it has nothing in flight"
        flying.used.append("an array")
        for _ in range(3):
            with ongoing.one(in_flight.InFlight(), not_awaited):  # a call inside the same call
                ongoing.let_others()
        assert waited == [device_calls._AHEAD_SECONDS]
        end.set()
        thread.join()
        assert not ongoing.others and not call.going_on.locked()
    ongoing.let_others()  # outside of any call


def test_host_work_keeps_nobody_waiting():
    """While one thread is in a call and builds a program, other threads can draw."""
    view, session = scenes.smooth((31, 23)), current()
    camera = view.camera.moved(0.1, 0, 0)
    ibr.warp(view, camera)
    begun, end = threading.Event(), threading.Event()

    def work() -> None:
        with session.call(), session.building.setdefault(None, threading.RLock()):
            begun.set()
            end.wait(60)

    thread = threading.Thread(target=work)
    thread.start()
    begun.wait()
    ibr.warp(view, camera)
    assert thread.is_alive() and not end.is_set()
    end.set()
    thread.join()


def test_threads_that_need_the_same_of_a_thing_make_it_once():
    view, made, barrier = scenes.smooth((31, 23)), list[object](), threading.Barrier(4)

    def make() -> object:
        time.sleep(0.02)  # so that other threads ask meanwhile
        made.append(object())
        return made[-1]

    def ask(_: int) -> object:
        barrier.wait()
        return cached_on_device(view, "of the test", make)

    with ThreadPoolExecutor(4) as threads:
        found = list(threads.map(ask, range(4)))
    assert len(made) == 1 and found == 4 * made
