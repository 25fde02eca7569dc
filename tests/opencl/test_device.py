"""Opening a device, choosing it for calls, blocks and threads, and ending a process that uses it."""

from __future__ import annotations

import os
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pyopencl as cl
import pytest

from pyibr.core.errors import ArgumentError, DeviceError
from pyibr.opencl import selftest
from pyibr.opencl.device import current, devices, explain, one_call, use_device
from pyibr.opencl.profile import profile_of
from pyibr.opencl.runtimes import found_devices
from tests.opencl.test_memory import refusing
from tools.processes import run_python, run_within


def test_a_device_of_this_machine_works_and_is_opened_once():
    session = current()
    assert session is current()
    assert session.device in devices()
    assert session.device.works and not session.device.reason and not session.device.remedy
    assert session.context.devices == [found_devices()[session.device.index].handle]
    assert session.profile is profile_of(session.device.kind)


def test_a_cpu_whose_kernels_work_in_copies_is_told(monkeypatch: pytest.MonkeyPatch):
    handle = found_devices()[current().device.index].handle
    assert selftest.test(handle, measure=False).works
    buffer = cl.Buffer

    def copied(context: cl.Context, flags: int, size: int = 0, hostbuf: np.ndarray | None = None) -> cl.Buffer:
        if flags & cl.mem_flags.USE_HOST_PTR:
            flags = flags & ~cl.mem_flags.USE_HOST_PTR | cl.mem_flags.COPY_HOST_PTR
        return buffer(context, flags, size, hostbuf)

    monkeypatch.setattr(cl, "Buffer", copied)
    told = selftest.test(handle, measure=False)
    assert not told.works and "the host's own memory" in told.reason


def test_a_cpu_works_in_wide_lanes_and_in_place_and_what_is_no_cpu_does_not():
    for kind, lanes, in_place in (("cpu", 16, True), ("gpu", 1, False), ("accelerator", 1, False)):
        profile = profile_of(kind)
        assert (profile.lanes, profile.in_place) == (lanes, in_place)
        assert profile.block**2 == lanes
        assert profile.grid((4, 3), (101, 77)) == ((4, 3) if kind == "cpu" else (101, 77))
        assert profile.packets(101, 77) == (7 if kind == "cpu" else 101, 77)


def test_the_environment_variable_names_the_device(monkeypatch: pytest.MonkeyPatch):
    index = current().device.index
    monkeypatch.setenv("PYIBR_DEVICE", str(index))
    assert current().device.index == index
    assert explain()[1] == "named by $PYIBR_DEVICE"
    monkeypatch.setenv("PYIBR_DEVICE", "no such device")
    with pytest.raises(ArgumentError, match=r"\$PYIBR_DEVICE"):
        current()


def test_use_device_nests_and_ends(monkeypatch: pytest.MonkeyPatch):
    usual = current()
    monkeypatch.setenv("PYIBR_DEVICE", "no such device")  # so that only the block can choose
    with use_device(usual.device.index) as outer:
        assert current() is usual and outer == usual.device
        with use_device(outer) as inner:
            assert inner == outer and current() is usual
        with pytest.raises(ArgumentError, match="device: expected"), use_device("no such device"):
            pass
        assert current() is usual
        assert explain()[1] == "named by use_device"
    with pytest.raises(ArgumentError):
        current()


def test_a_call_stays_on_its_device(monkeypatch: pytest.MonkeyPatch):
    usual = current()
    with one_call() as session:
        assert session is usual
        monkeypatch.setenv("PYIBR_DEVICE", "no such device")
        assert current() is usual
    with pytest.raises(ArgumentError):
        current()


def test_use_device_holds_for_its_own_thread(monkeypatch: pytest.MonkeyPatch):
    usual = current().device
    monkeypatch.setenv("PYIBR_DEVICE", "no such device")
    with use_device(usual), ThreadPoolExecutor(1) as elsewhere:
        assert isinstance(elsewhere.submit(current).exception(), ArgumentError)
        assert current().device == usual


def test_threads_that_start_together_share_one_session(nothing_open: None):
    barrier = threading.Barrier(8)

    def start(_: int) -> object:
        barrier.wait()
        return current()

    with ThreadPoolExecutor(8) as threads:
        assert len(set(map(id, threads.map(start, range(8))))) == 1


@pytest.mark.parametrize("wrong", [None, 1.5, True, ["cpu"]])
def test_use_device_refuses_what_names_no_device(wrong: Any):
    with pytest.raises(ArgumentError, match="device: expected a Device"), use_device(wrong):
        pass


def test_a_device_that_cannot_be_opened_is_named(nothing_open: None, own_cache: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(cl, "Context", refusing(cl.MemoryError("no room on the device")))
    with pytest.raises(DeviceError, match="it cannot be opened: no room on the device"):
        current()
    assert not list(own_cache.glob("devices/*")), "the next process asks again"


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork here")
def test_a_forked_process_gets_an_error_and_does_not_hang():
    code = """
import dataclasses
import os
from pyibr.core.errors import DeviceError
from pyibr.opencl.device import current
current()
if os.fork() == 0:
    try:
        current()
    except DeviceError as error:
        os._exit(7 if "spawn" in str(error) else 1)
    os._exit(2)
print(os.waitstatus_to_exitcode(os.wait()[1]))
"""
    done = run_python("-c", code)
    assert done.stdout.strip() == "7", done.stderr


TWO_DEVICES = """
import threading, numpy as np, pyibr as ibr
from pyibr.opencl.device import current
from tests.scenes import stepped
view = stepped((61, 37))
targets = [view.camera.moved(0.1 * step, 0.1, 0.2) for step in range(8)]
drawn = {}

def draw(index):
    with ibr.use_device(index):
        frames = ibr.warp(view, targets[:3]) + [ibr.warp(view, one) for one in targets]
        drawn[index] = current().device.index, [frame.color.tobytes() + frame.depth.tobytes() for frame in frames]

threads = [threading.Thread(target=draw, args=(index,)) for index in (0, 1)]
for one in threads: one.start()
for one in threads: one.join()
assert [drawn[index][0] for index in (0, 1)] == [0, 1]
assert drawn[0][1] == drawn[1][1]
print("both")
"""


@pytest.mark.thorough
@pytest.mark.skipif("PoCL" not in current().device.version, reason="only PoCL lists this processor twice")
def test_two_devices_are_in_use_at_the_same_time():
    kind = current().device.name.partition("-")[0]  # PoCL's name for the processor, which depends on PoCL's version
    done = run_within(120, [sys.executable, "-c", TWO_DEVICES], POCL_DEVICES=f"{kind} {kind}")
    assert done.stdout == "both\n", done.stderr


ENDING = """
import threading, time
import numpy as np
import pyibr as ibr
size = 400
camera = ibr.Camera([[300, 0, 200], [0, 300, 200], [0, 0, 1]], (size, size))
views = [ibr.DepthImage(np.full((size, size, 3), 9, np.uint8), np.full((size, size), 2, np.float32), camera)
         for _ in range(4)]
begun = threading.Event()
def work():
    while True:
        ibr.warp(views, camera.moved(0.1, 0.05, 0.2), fill="background")
        begun.set()
for _ in range({threads}):
    threading.Thread(target=work, daemon=True).start()
begun.wait({wait})
time.sleep({more})
"""


@pytest.mark.thorough
@pytest.mark.parametrize("number", [0, 2, 4, 7])
def test_a_process_ends_cleanly_while_daemon_threads_call(number: int):
    """The main thread ends while daemon threads open the device and build kernels, or during later calls."""
    wait, more = (0, 0.1 * number) if number < 3 else (60, 0.003 * number)
    code = ENDING.format(threads=1 + number % 3, wait=wait, more=more)
    done = run_python("-c", code)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.thorough
def test_the_last_call_may_come_after_the_end_has_begun():
    code = ENDING.format(threads=2, wait=60, more=0)
    last = "import atexit\natexit.register(lambda: print(ibr.warp(views[0], camera).valid.all()))\n"
    for whole in (last + code, code + last):
        done = run_python("-c", whole)
        assert (done.returncode, done.stdout, done.stderr) == (0, "True\n", "")


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork here")
def test_a_forked_process_ends_without_waiting():
    code = (
        ENDING.format(threads=2, wait=60, more=0)
        + """
import os, sys
start = time.monotonic()
if os.fork() == 0:
    sys.exit(7)
print(os.waitstatus_to_exitcode(os.wait()[1]), time.monotonic() - start < 5)
"""
    )
    done = run_python("-c", code)
    assert (done.returncode, done.stdout) == (0, "7 True\n"), done.stderr
