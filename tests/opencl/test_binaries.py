"""Binaries of programs: read in idle time by a thread, or in advance by `pyibr doctor --build`."""

from __future__ import annotations

import logging
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pyopencl as cl
import pytest
from typer.testing import CliRunner

import pyibr as ibr
from pyibr.app.cli import app
from pyibr.app.commands import doctor, pictures
from pyibr.app.telling import telling
from pyibr.core.errors import ArgumentError
from pyibr.opencl import binaries, program
from pyibr.opencl.device import current
from pyibr.opencl.launch import launch
from pyibr.opencl.memory import empty
from tests.processes import with_path

CAMERA = "camera = ibr.Camera([[30, 0, 20], [0, 30, 15], [0, 0, 1]], (41, 31))\n"
PICTURE = f"""
import threading, time
import numpy as np, pyibr as ibr
from pyibr.opencl import binaries
{CAMERA}
view = ibr.DepthImage(np.full((31, 41, 3), 9, np.uint8), np.full((31, 41), 2, np.float32), camera)
"""
FRAME = "frame = ibr.warp(view, camera.moved(0.1, 0.05, 0.2))\nprint(int(frame.valid.sum()), flush=True)\n"
REFUSING = """
import pyopencl as cl
make = cl.Program.__init__
def refuse(self, context, *rest):
    assert len(rest) == 2, 'built from source'
    make(self, context, *rest)
cl.Program.__init__ = refuse
"""

posix = pytest.mark.skipif(os.name != "posix", reason="signals")


def environment(folder: Path, binaries: str = "later") -> dict[str, str]:
    return with_path(PYIBR_CACHE=str(folder), PYIBR_BINARIES=binaries)


def run(code: str, folder: Path, binaries: str = "later") -> subprocess.CompletedProcess[str]:
    """Run code after PICTURE in a separate process."""
    command = [sys.executable, "-c", PICTURE + code]
    return subprocess.run(command, env=environment(folder, binaries), capture_output=True, text=True, timeout=300)


def cached_on_device(folder: Path) -> list[Path]:
    return sorted((folder / "programs").glob("*")) if (folder / "programs").exists() else []


@pytest.fixture
def reads_late() -> None:
    """Skip the test if the runtime reads binaries immediately."""
    if "portable computing language" not in current().device.platform.lower():
        pytest.skip("this runtime returns binaries without compiling")


def test_the_thread_keeps_binaries_once_nobody_waits(tmp_path: Path, reads_late: None):
    wait = "while binaries._waiting or not binaries.reading.acquire(blocking=False): time.sleep(0.05)\n"
    first = run(f"{FRAME}assert len(binaries._waiting) >= 3\n{wait}", tmp_path)
    assert first.returncode == 0, first.stderr
    assert len(cached_on_device(tmp_path)) >= 3
    second = run(REFUSING + FRAME, tmp_path)
    assert (second.returncode, second.stdout) == (0, first.stdout), second.stderr


@pytest.mark.thorough
@pytest.mark.parametrize("moment", ["before it reads", "while it reads"])
def test_a_process_that_ends_leaves_whole_entries_or_none(tmp_path: Path, reads_late: None, moment: str):
    begin = "binaries._QUIET = 0.0\n"
    wait = "while binaries.reading.acquire(blocking=False): binaries.reading.release()\n"
    first = run(FRAME if moment == "before it reads" else begin + FRAME + wait, tmp_path)
    assert first.returncode == 0 and not first.stderr, first.stderr
    assert not [path for path in cached_on_device(tmp_path) if path.name.startswith(".part-")]
    second = run(FRAME, tmp_path)
    assert (second.returncode, second.stdout) == (0, first.stdout), second.stderr


@pytest.mark.thorough
@posix
def test_a_process_that_is_killed_while_it_reads_breaks_nothing(tmp_path: Path, reads_late: None):
    wait = "while binaries.reading.acquire(blocking=False): binaries.reading.release()\nprint('reads', flush=True)\n"
    command = [sys.executable, "-c", f"{PICTURE}binaries._QUIET = 0.0\n{FRAME}{wait}time.sleep(60)"]
    with subprocess.Popen(command, env=environment(tmp_path), stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        told = process.stdout.readline()
        assert process.stdout.readline() == "reads\n"
        process.send_signal(signal.SIGKILL)
    second = run(FRAME, tmp_path)
    assert (second.returncode, second.stdout) == (0, told), second.stderr


@posix
def test_a_fork_waits_for_what_is_read(tmp_path: Path, reads_late: None):
    wait = "while binaries.reading.acquire(blocking=False): binaries.reading.release()\n"
    fork = "import os\npid = os.fork()\nif not pid: os._exit(0)\nprint(os.waitpid(pid, 0)[1], binaries.reading)\n"
    done = run(f"binaries._QUIET = 0.0\n{FRAME}{wait}{fork}", tmp_path)
    assert done.returncode == 0 and "\n0 " in done.stdout, done.stdout + done.stderr


def test_binaries_are_kept_at_once_or_never_if_asked(own_cache: Path, monkeypatch: pytest.MonkeyPatch):
    def build(choice: str) -> None:
        monkeypatch.setenv("PYIBR_BINARIES", choice)
        current().kernels.clear()
        program.kernel("lib/clear.cl", "clear")

    build("never")
    assert not cached_on_device(own_cache)
    build("now")
    assert len(cached_on_device(own_cache)) == 1
    for path in cached_on_device(own_cache):
        path.unlink()
    with pytest.raises(ArgumentError, match=r"^\$PYIBR_BINARIES: expected one of later, now, never, got 'soon'$"):
        build("soon")


def test_a_binary_is_what_pyopencl_reads():
    made = program._quietly_built(
        cl.Program(current().context, "kernel void one(global int *a) { a[0] = 1; }"), program._OPTIONS
    )
    (expected,) = cast("list[bytes]", made.get_info(cl.program_info.BINARIES))
    assert binaries._binary_of(made) == expected


def test_other_threads_run_while_a_binary_is_read(reads_late: None):
    number = int.from_bytes(os.urandom(3), "big")  # a source that PoCL has not compiled before
    source = "".join(
        f"kernel void k{i}(global float *a) {{ a[0] = sin(a[{i}]) * exp(a[1]) + {number}; }}\n" for i in range(6)
    )
    made = program._quietly_built(cl.Program(current().context, source), program._OPTIONS)
    reader = threading.Thread(target=binaries._binary_of, args=(made,))
    reader.start()
    turns = 0
    while reader.is_alive():
        time.sleep(0.001)
        turns += 1
    assert turns > 5


def test_a_file_is_built_once_for_all_its_kernels(own_cache: Path, monkeypatch: pytest.MonkeyPatch):
    current().kernels.clear()
    built: list[object] = []
    compiled = program._compiled
    monkeypatch.setattr(program, "_compiled", lambda *given: built.append(given) or compiled(*given))
    for name in ("clear", "clear_uints", "to_nearness", "to_bridged_nearness"):
        assert program.kernel("picture/begin.cl", name).name == name
    assert len(built) == 1
    made = empty((4,), np.uint32)
    launch(program.kernel("picture/begin.cl", "clear_uints"), (1,), values=made, count=4, share=4, value=7)
    assert made.to_host().tolist() == [7] * 4


def test_users_are_told_once_that_kernels_are_built(caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch):
    def build(seconds: float) -> None:
        times = iter((0.0, seconds))
        monkeypatch.setattr(program, "time", SimpleNamespace(perf_counter=lambda: next(times)))
        with program._told("warp/resolve.cl"):
            pass

    monkeypatch.setattr(program, "_spent", 0.0)
    said: list[str] = []
    with caplog.at_level(logging.INFO, logger="pyibr"), telling(said.append):
        build(program._LONG / 2)
        assert not said
        build(program._LONG)
        build(program._LONG)
    assert said == [record.getMessage() for record in caplog.records] and len(said) == 1
    assert "doctor --build" in said[0]
    program._spent = 0.0
    build(9.0)
    assert len(said) == 1, "no messages after the end of the block"


def test_doctor_builds_beforehand(own_cache: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("PYIBR_BINARIES", "later")
    monkeypatch.setattr(doctor, "PICTURES", pictures.PICTURES[:1])
    monkeypatch.setattr(doctor, "print_report", lambda: True)
    current().kernels.clear()
    pictures._view.cache_clear()
    result = CliRunner().invoke(app, ["doctor", "--build"])
    assert result.exit_code == 0 and "kernels of 1 kinds of pictures are built" in result.output, result.output
    assert len(cached_on_device(own_cache)) >= 3
    done = run(REFUSING + FRAME, own_cache)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("draw", pictures.PICTURES)
def test_what_doctor_draws_can_be_drawn(draw):
    assert isinstance(draw(), ibr.Frame | ibr.CleanedDepth)
