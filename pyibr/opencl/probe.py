"""Find out whether a device works, and how fast it is, and remember it on disk.

A broken runtime may not only fail but crash or hang, so its test (`selftest`) runs in a process of its own.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Literal

from pyibr.opencl import selftest
from pyibr.opencl.cache import Entry
from pyibr.opencl.outcome import Outcome
from pyibr.opencl.runtimes import LOADER_VARIABLES, Found

_TIMEOUT = 90.0  # seconds

Doubted = Literal["nothing", "broken", "all"]
"""Which outcomes of earlier processes are not believed."""

_tested: dict[str, Outcome] = {}  # by this process, by the devices' keys

_ISOLATED_TEST = """
import site, sys
installed = site.getsitepackages()
after_python = next((i for i, folder in enumerate(sys.path) if folder in installed), len(sys.path))
sys.path[after_python:after_python] = sys.argv[3:]
from pyibr.opencl.selftest import main
main(*sys.argv[1:3])
"""
"""What Python runs in isolated mode, where neither the folder that it starts in nor the environment can bring code."""


def probe(found: Found, measure: bool = False, doubted: Doubted = "nothing") -> Outcome:
    """Does this device work? Answered from what is known where it was asked before.

    Parameters
    ----------
    found : Found
        The device.
    measure : bool
        Also measure its speed.
    doubted : {"nothing", "broken", "all"}
        What of the disk is not believed; with "all", not even what this process found before.
    """
    known = None if doubted == "all" else _tested.get(found.key) or _kept(found, doubted)
    if known is not None and (known.speed is not None or not measure or not known.works):
        return known
    outcome = _tested[found.key] = _test_apart(found, measure)
    _entry(found).write(outcome.to_json().encode())
    return outcome


def forget(found: Found) -> None:
    """Forget what is known of this device, so that it is probed again."""
    _tested.pop(found.key, None)
    _entry(found).forget()


def _entry(found: Found) -> Entry:
    return Entry("devices", found.kind, found.key)


def _kept(found: Found, doubted: Doubted) -> Outcome | None:
    data = _entry(found).read()
    outcome = None if data is None else Outcome.from_json(data.decode())
    return None if outcome is None or (doubted == "broken" and not outcome.works) else outcome


def _may_start_python() -> bool:
    """In an application frozen into one file, ``sys.executable`` is the application."""
    return bool(sys.executable) and not getattr(sys, "frozen", False)


def _test_apart(found: Found, measure: bool) -> Outcome:
    """Tested by a process of its own; by this one where no Python can be started that has the packages."""
    import subprocess  # most processes test nothing

    if not _may_start_python():
        return selftest.test(found.handle, measure)
    what = "speed" if measure else "works"
    command = [sys.executable, "-I", "-c", _ISOLATED_TEST, found.key, what, *_folders()]
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
            timeout=_TIMEOUT,
        )
    except subprocess.TimeoutExpired:
        return Outcome(False, f"a tiny kernel did not end within {_TIMEOUT:.0f} s")
    except OSError:
        return selftest.test(found.handle, measure)
    lines = done.stdout.splitlines()
    if selftest.READY not in lines and done.returncode > 0:
        return selftest.test(found.handle, measure)
    if outcome := Outcome.from_json(lines[-1] if lines else ""):
        return outcome
    if done.returncode < 0:
        return Outcome(False, f"the runtime crashed on a tiny kernel (signal {-done.returncode})")
    last = (done.stderr.strip().splitlines() or ["no message"])[-1]
    return Outcome(False, f"the runtime ended the process (status {done.returncode}) on a tiny kernel: {last}")


def _folders() -> list[str]:
    """Folders where this process has the packages that a test needs, in its own order."""
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
