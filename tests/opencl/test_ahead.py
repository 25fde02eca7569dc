"""A builder process builds the programs that a picture will need; it may die without harm."""

from __future__ import annotations

import os
import signal
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pyopencl as cl
import pytest

import pyibr as ibr
from pyibr.opencl import ahead, builder
from pyibr.opencl.build_server import compile_for_launches, zeros
from pyibr.opencl.device import current
from pyibr.opencl.program import kernel
from pyibr.opencl.runtimes import found_devices, runtime_of
from tests import scenes
from tools.everything import SIZE, Call, drawn, view_of, warped
from tools.processes import run_within

PLATE = ibr.Mesh([[x, y, 0] for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))], [[0, 1, 2], [0, 2, 3]], uv=np.eye(4)[:, :2])
HEIGHT, COLOR = np.linspace(0, 1, 80, dtype=np.float32).reshape(8, 10), np.full((8, 10, 3), 200, np.uint8)


DRAWN: dict[str, Call] = {
    "lines": warped((0.2, 0.1, 0)),
    "rows": warped((0.2, 0, 0)),
    "connected": warped((0.2, 0.1, 0), edges="connect"),
    "search": warped((0.2, 0.1, 0), method="search"),
    "lit": drawn(lambda: view_of(scenes.stepped)),
    "mesh": drawn(lambda: PLATE, lit=False),
    "lit mesh": drawn(lambda: PLATE),
    "slices": drawn(lambda: ibr.SlicedSurface(PLATE, HEIGHT, COLOR, 0.1), lit=False),
    "relief": drawn(lambda: ibr.ReliefSurface(PLATE, HEIGHT, COLOR, 0.1), lit=False),
    "lit relief": drawn(lambda: ibr.ReliefSurface(PLATE, HEIGHT, COLOR, 0.1)),
    "depth meshes": drawn(lambda: ibr.DepthMeshObject([view_of(scenes.stepped)] * 2), lit=False),
    "sheets": drawn(lambda: ibr.DepthMeshObject([view_of(scenes.stepped)] * 2, closed="sheets"), lit=False),
    "open": drawn(lambda: ibr.DepthMeshObject([view_of(scenes.stepped)] * 2, closed=False), lit=False),
}


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, str, bool, dict[str, int]]]:
    """A list of all requests to build from now on; nothing is built."""
    found: list[tuple[str, str, bool, dict[str, int]]] = []

    class Noted:
        def ask(self, file: str, name: str, defines: dict[str, int], *, compiled: bool) -> None:
            found.append((file, name, compiled, {key: value for key, value in defines.items() if key != "LANES"}))

    monkeypatch.setattr(ahead, "builder_of", lambda _: Noted())
    monkeypatch.setattr(ahead._thread, "do", lambda _: None)
    current().ahead.clear()
    return found


QUICK = {"lines", "relief", "depth meshes"}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.thorough] * (name not in QUICK)) for name in DRAWN]
)
def test_what_is_asked_for_ahead_is_what_the_picture_needs_and_changes_nothing(name: str, asked: list[Any]):
    session, memory = current(), zeros()
    kept = dict(session.kernels)
    session.kernels.clear()
    try:
        DRAWN[name]()
        assert asked
        for file, kernel_name, _, defines in asked:
            assert ((file, tuple(sorted(defines.items()))), kernel_name) in session.kernels
    finally:
        session.kernels.update(kept)
    for file, kernel_name, compiled, defines in asked:
        if compiled:
            compile_for_launches(kernel(file, kernel_name, **defines), memory)
    found = np.empty(memory.size, np.uint8)
    cl.enqueue_copy(session.queue, found, memory)
    assert not found.any()


def test_a_program_is_asked_for_once(asked: list[Any]):
    for _ in range(3):
        DRAWN["lines"]()
    assert len(asked) == len({file for file, *_ in asked}) == 4


# --- the builder process --------------------------------------------------------------------------

PICTURE = f"""
import os, sys, zlib
import pyibr as ibr
from pyibr.opencl import builder, device
from tests.scenes import stepped
view = stepped({SIZE})
device.current()
process = builder.builders[0]._process if builder.builders else None
print("builder", process._process.pid if process else None)
HERE
frame = ibr.warp(view, view.camera.moved(0.1, 0.05, 0.2))
print("built", len([line for line in process.lines if line.startswith(builder.BUILT)]) if process else None)
print("sum", zlib.crc32(frame.color.tobytes() + frame.depth.tobytes()))
"""

pocl = pytest.mark.skipif(
    not runtime_of(found_devices()[current().device.index]).keeps_kernels(), reason="needs PoCL with its own cache"
)


def draw(folder: Path, here: str = "", **variables: str) -> dict[str, str]:
    """Draw in a process with its own caches, and return its lines by their first word."""
    caches = {"PYIBR_CACHE": str(folder / "pyibr"), "POCL_CACHE_DIR": str(folder / "pocl")}
    command = [sys.executable, "-W", "error", "-X", "dev", "-c", PICTURE.replace("HERE", here)]
    done = run_within(300, command, **(caches | variables))
    assert done.returncode == 0 and not done.stderr, done.stderr
    return dict(line.split(" ", 1) for line in done.stdout.splitlines())


def is_alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


@pocl
def test_the_first_picture_is_built_beside_and_the_same(tmp_path: Path):
    beside = draw(tmp_path / "beside")
    assert int(beside["built"]) >= 2  # the last program may only report its kernel
    assert not is_alive(int(beside["builder"]))
    alone = draw(tmp_path / "alone", POCL_KERNEL_CACHE="0")
    assert alone["builder"] == "None"
    again = draw(tmp_path / "beside")
    assert again["builder"] == "None", "the device's test is known"
    assert beside["sum"] == alone["sum"] == again["sum"]


@pocl
@pytest.mark.parametrize("when", [pytest.param("before", marks=pytest.mark.thorough), "after it was asked"])
def test_a_builder_that_dies_is_not_missed(when: str, tmp_path: Path):
    kill = f"os.kill(process._process.pid, {int(signal.SIGKILL)})"
    if when != "before":
        kill = f"ask = builder.Builder.ask\ndef dying(*given, **more):\n    {kill}\n    return ask(*given, **more)\n"
        kill += "builder.Builder.ask = dying"
    said = draw(tmp_path, kill)
    assert said["built"] == "0" and int(said["sum"])


@pytest.mark.thorough
@pocl
def test_a_builder_without_work_ends(tmp_path: Path):
    said = draw(
        tmp_path,
        "import time\nend = time.monotonic() + 60\nwhile builder.builders[0].has_ended is False: "
        "time.sleep(0.1); assert time.monotonic() < end\nassert builder.builder_of(builder.builders[0].key) is None",
    )
    assert said["built"] == "0" and int(said["sum"])


def test_what_fails_ahead_is_told_where_it_is_needed():
    ahead._thread.do(lambda: 1 / 0)
    end = time.monotonic() + 60
    while ahead._thread._works:
        assert time.monotonic() < end
        time.sleep(0.01)
    done: list[int] = []
    ahead._thread.do(lambda: done.append(1))
    while ahead._thread._works:
        time.sleep(0.01)
    assert done == [1]
    assert builder.builder_of("of no device") is None
