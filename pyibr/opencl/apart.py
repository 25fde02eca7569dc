"""Separate processes for modules of pyibr that may crash or hang.

They run in Python's isolated mode, which loads no code from the current folder or from paths in the environment.
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO, cast

from pyibr.core.checks import positive
from pyibr.core.errors import ArgumentError
from pyibr.opencl.unlisted import LOADER_VARIABLES

VARIABLE = "PYIBR_TIMEOUT"
_TIMEOUT = 90.0  # seconds, by default: emulated machines start slowly
_ENDING = 5.0  # seconds to wait for the end of a killed process

_CODE = """
import importlib, site, sys
installed = site.getsitepackages()
after_python = next((i for i, folder in enumerate(sys.path) if folder in installed), len(sys.path))
count = 3 + int(sys.argv[2])
sys.path[after_python:after_python] = sys.argv[count:]
importlib.import_module(sys.argv[1]).main(*sys.argv[3:count])
"""


class Apart:
    """A process that runs a module's `main`. A thread reads its output and waits for its end."""

    def __init__(self, command: list[str], environment: dict[str, str]) -> None:
        import subprocess  # imported late: most processes need no subprocess

        self.lines: list[str] = []  # printed so far
        self._messages: list[str] = []
        self._changed = threading.Condition()
        self.status: int | None = None  # its exit status; None until it has ended
        self._timeout = timeout()
        folder, pipe = Path(sys.executable).anchor, subprocess.PIPE
        # Unbuffered: a buffer has a lock, which a thread must not hold when Python exits.
        self._process = subprocess.Popen(
            command, cwd=folder, env=environment, stdin=pipe, stdout=pipe, stderr=pipe, bufsize=0
        )
        self._thread = threading.Thread(target=self._read, name="pyibr apart", daemon=True)
        self._thread.start()

    def wait(self, until: Callable[[], bool] = lambda: False) -> bool:
        """Wait until `until()` is True or the process has ended. After a timeout, kill it and return False."""
        with self._changed:
            if self._changed.wait_for(lambda: self.status is not None or until(), self._timeout):
                return True
        self.kill()
        return False

    def send(self, line: str) -> None:
        """Send a line to the process; ignored if it has ended."""
        with suppress(OSError, ValueError):  # ValueError: a closed pipe
            cast("BinaryIO", self._process.stdin).write(f"{line}\n".encode())

    def kill(self) -> None:
        """End the process immediately."""
        self._process.kill()
        self._thread.join(_ENDING)

    def fault(self, task: str) -> str:
        """Return why the process ended without a result; `task` names its task."""
        if self.status is not None and self.status < 0:
            return f"the runtime crashed on {task} (signal {-self.status})"
        last = next((line for line in reversed(self._messages) if line.strip()), "no message")
        return f"the runtime ended the process (status {self.status}) on {task}: {last}"

    def _read(self) -> None:
        process = self._process
        given, printed, said = (cast("BinaryIO", pipe) for pipe in (process.stdin, process.stdout, process.stderr))
        with given, printed, said:
            beside = threading.Thread(target=self._note, args=(said, self._messages), daemon=True)
            beside.start()
            self._note(printed, self.lines)
            beside.join()
            status = process.wait()
        with self._changed:
            self.status = status
            self._changed.notify_all()

    def _note(self, pipe: BinaryIO, lines: list[str]) -> None:
        for line in pipe:
            with self._changed:
                lines.append(line.decode(errors="replace").rstrip("\r\n"))
                self._changed.notify_all()


def start_apart(module: str, *arguments: str) -> Apart | None:
    """Start the `main` of a module, given by its full name, in a process; None if Python cannot be started."""
    if not sys.executable or getattr(sys, "frozen", False):  # in a frozen application, it is the application
        return None
    command = [sys.executable, "-I", "-c", _CODE, module, str(len(arguments)), *arguments, *_folders()]
    # The process starts in the root folder, so relative paths are made absolute.
    paths = {name: os.environ.get(name, "") for name in LOADER_VARIABLES}
    absolute = {name: str(Path(path).absolute()) for name, path in paths.items() if os.access(path, os.F_OK)}
    try:
        return Apart(command, os.environ | absolute)
    except OSError:
        return None


def timeout() -> float:
    """Return the timeout of a separate process in seconds."""
    given = os.environ.get(VARIABLE)
    if not given:
        return _TIMEOUT
    try:
        return positive("", float(given))
    except ValueError:
        raise ArgumentError(f"${VARIABLE}", "seconds > 0", repr(given)) from None


def _folders() -> list[str]:
    """Folders from which this process loads the packages that it needs, in the order of its path."""
    roots = [Path(__file__).parents[2]]
    for name in ("numpy", "pyopencl", "pytools"):
        if file := getattr(sys.modules.get(name), "__file__", None):
            roots.append(Path(file).parents[1])
    try:
        here = Path.cwd()
    except OSError:  # the current folder was removed, so no package comes from it
        here = Path(Path(sys.executable).anchor)
    folders = dict.fromkeys(str(here / root) for root in roots)
    order = {str(here / folder): place for place, folder in reversed([*enumerate(sys.path)])}
    return sorted(folders, key=lambda folder: order.get(folder, len(order)))
