"""Processes that tests and benchmarks start."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path


def with_path(**more: str) -> dict[str, str]:
    """This process's environment and path, with further variables."""
    return os.environ | {"PYTHONPATH": os.pathsep.join(p for p in sys.path if p)} | more


def run_python(
    *arguments: str | Path, cwd: Path | str | None = None, **variables: str
) -> subprocess.CompletedProcess[str]:
    """Run Python with this process's path and further environment variables."""
    command = [sys.executable, *arguments]
    return subprocess.run(command, cwd=cwd, env=with_path(**variables), capture_output=True, text=True)


def run_within(seconds: float, command: Sequence[str], **variables: str) -> subprocess.CompletedProcess[str]:
    """Run a command with this process's path. If it takes longer, end it and every process that it started.

    `subprocess.run` would end the command alone, and then wait for the output of the processes that it started.
    """
    pipe, own_session = subprocess.PIPE, os.name == "posix"
    with subprocess.Popen(
        command, env=with_path(**variables), stdout=pipe, stderr=pipe, text=True, start_new_session=own_session
    ) as child:
        try:
            out, errors = child.communicate(timeout=seconds)
        except BaseException:
            with suppress(ProcessLookupError):
                os.killpg(child.pid, signal.SIGKILL) if own_session else child.kill()
            raise
    return subprocess.CompletedProcess(command, child.returncode, out, errors)


def said_under_oclgrind(arguments: Sequence[str], seconds: float) -> str:
    """Output of a Python process on Oclgrind, which detects reads and writes beyond arrays.

    A run that does not end is repeated once: Oclgrind's own threads have been seen to wait for each other.
    """
    # No inlining: it leaves calls of llvm.experimental.noalias.scope.decl, which Oclgrind does not know.
    options = "-cl-opt-disable -DINLINED=static"
    command = ("oclgrind", "--check-api", "--build-options", options, sys.executable, *arguments)
    try:
        done = run_within(seconds, command, PYIBR_DEVICE="oclgrind")
    except subprocess.TimeoutExpired:
        done = run_within(seconds, command, PYIBR_DEVICE="oclgrind")
    said = done.stdout + done.stderr
    for report in ("Invalid read", "Invalid write"):
        assert report not in said, said[max(said.index(report) - 500, 0) :][:3000]
    return said
