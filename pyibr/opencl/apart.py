"""Runs modules of pyibr's in processes of their own, for whatever may crash or hang.

They run in Python's isolated mode, where neither the folder that it starts in nor the environment can bring code.
"""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from pathlib import Path

from pyibr.core.checks import positive
from pyibr.core.errors import ArgumentError
from pyibr.opencl.unlisted import LOADER_VARIABLES

VARIABLE = "PYIBR_TIMEOUT"
_TIMEOUT = 90.0  # seconds, unless the environment says otherwise: emulated machines start slowly

_CODE = """
import importlib, site, sys
installed = site.getsitepackages()
after_python = next((i for i, folder in enumerate(sys.path) if folder in installed), len(sys.path))
count = 3 + int(sys.argv[2])
sys.path[after_python:after_python] = sys.argv[count:]
importlib.import_module(sys.argv[1]).main(*sys.argv[3:count])
"""


@dataclass(frozen=True)
class Ended:
    """Lines that a process printed, its status, and what went wrong if its last line is no result."""

    lines: list[str]
    status: int
    fault: str

    @property
    def result(self) -> str:
        """The last line."""
        return self.lines[-1] if self.lines else ""


def run_apart(module: str, *arguments: str, task: str) -> Ended | None:
    """Run a module's `main` in a process of its own; None where no Python can be started.

    Parameters
    ----------
    module : str
        Its full name.
    *arguments : str
        Those of `main`, which prints its result as the last line.
    task : str
        What it does with a runtime, for the fault: "a tiny kernel".
    """
    import subprocess  # most processes need none

    if not _may_start_python():
        return None
    command = [sys.executable, "-I", "-c", _CODE, module, str(len(arguments)), *arguments, *_folders()]
    timeout = _timeout()
    # It starts in the root folder, from which relative paths lead elsewhere.
    paths = {name: os.environ.get(name, "") for name in LOADER_VARIABLES}
    absolute = {name: str(Path(path).absolute()) for name, path in paths.items() if os.access(path, os.F_OK)}
    try:
        done = subprocess.run(
            command,
            cwd=Path(sys.executable).anchor,
            env=os.environ | absolute,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=timeout,
        )
    except subprocess.TimeoutExpired:
        return Ended([], 0, f"{task} did not end within {timeout:g} s")
    except OSError:
        return None
    if done.returncode < 0:
        fault = f"the runtime crashed on {task} (signal {-done.returncode})"
    else:
        last = (done.stderr.strip().splitlines() or ["no message"])[-1]
        fault = f"the runtime ended the process (status {done.returncode}) on {task}: {last}"
    return Ended(done.stdout.splitlines(), done.returncode, fault)


def _timeout() -> float:
    given = os.environ.get(VARIABLE)
    if not given:
        return _TIMEOUT
    try:
        return positive("", float(given))
    except ValueError:
        raise ArgumentError(f"${VARIABLE}", "seconds > 0", repr(given)) from None


def _may_start_python() -> bool:
    """In an application frozen into one file, ``sys.executable`` is the application."""
    return bool(sys.executable) and not getattr(sys, "frozen", False)


def _folders() -> list[str]:
    """Folders where this process has the packages that it needs, in its own order."""
    roots = [Path(__file__).parents[2]]
    for name in ("numpy", "pyopencl", "pytools"):
        if file := getattr(sys.modules.get(name), "__file__", None):
            roots.append(Path(file).parents[1])
    try:
        here = Path.cwd()
    except OSError:  # it has been removed, so that nothing comes from there
        here = Path(Path(sys.executable).anchor)
    folders = dict.fromkeys(str(here / root) for root in roots)
    order = {str(here / folder): place for place, folder in reversed([*enumerate(sys.path)])}
    return sorted(folders, key=lambda folder: order.get(folder, len(order)))
