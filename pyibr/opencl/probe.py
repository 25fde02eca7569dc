"""Find out whether a device works, and how fast it is, and remember it on disk.

A broken runtime may not only fail but crash or hang, so its test (`selftest`) runs in a process of its own.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from pyibr.opencl import selftest
from pyibr.opencl.cache import cache_folder, read_cached, write_cached
from pyibr.opencl.outcome import Outcome
from pyibr.opencl.runtimes import Found

_VERSION = 1  # of the test and of the files that keep its outcome
_PATIENCE = 90.0  # seconds


def probe(found: Found, measure: bool = False, fresh: bool = False) -> Outcome:
    """Does this device work? Answered from disk where it was asked before.

    Parameters
    ----------
    found : Found
        The device.
    measure : bool
        Also measure its speed.
    fresh : bool
        Ask the device itself, whatever the disk says.
    """
    if not fresh:
        data = read_cached(_file(found))
        kept = None if data is None else Outcome.from_json(data.decode(errors="replace"))
        if kept is not None and (kept.speed is not None or not measure or not kept.works):
            return kept
    outcome = _test_apart(found, measure) if _may_start_python() else _test_here(found, measure)
    write_cached(_file(found), outcome.to_json().encode())
    return outcome


def forget(found: Found) -> None:
    """Forget what is known of this device, so that it is probed again."""
    try:
        _file(found).unlink(missing_ok=True)
    except OSError:  # a cache that cannot be written was not written by us
        return


def _file(found: Found) -> Path:
    return cache_folder() / "devices" / f"{found.key}-{_VERSION}.json"


def _may_start_python() -> bool:
    """In an application frozen into one file, ``sys.executable`` is the application."""
    return bool(sys.executable) and not getattr(sys, "frozen", False)


def _test_apart(found: Found, measure: bool) -> Outcome:
    command = [sys.executable, "-m", "pyibr.opencl.selftest", found.key, "speed" if measure else "works"]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    try:
        done = subprocess.run(
            command, env=environment, capture_output=True, text=True, errors="replace", timeout=_PATIENCE
        )
    except subprocess.TimeoutExpired:
        return Outcome(False, f"a tiny kernel did not end within {_PATIENCE:.0f} s")
    except OSError:
        return _test_here(found, measure)
    lines = done.stdout.splitlines()
    if lines and (outcome := Outcome.from_json(lines[-1])):
        return outcome
    if done.returncode < 0:
        return Outcome(False, f"the runtime crashed on a tiny kernel (signal {-done.returncode})")
    last = (done.stderr.strip().splitlines() or ["no message"])[-1]
    return Outcome(False, f"the runtime ended the process (status {done.returncode}) on a tiny kernel: {last}")


def _test_here(found: Found, measure: bool) -> Outcome:
    return selftest.test(found.handle, measure)
