"""Find out whether a device works, and how fast it is, and remember it on disk.

A broken runtime may not only fail but crash or hang, so its test (`selftest`) runs in a process of its own.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import cast

from pyibr.opencl.cache import cache_folder, read_cached, write_cached
from pyibr.opencl.runtimes import Found

_VERSION = 1  # of the test and of the files that keep its outcome
_PATIENCE = 90.0  # seconds


@dataclass(frozen=True)
class Speed:
    """A few figures measured in a fraction of a second: a hint, not a benchmark."""

    copy: float
    """GB/s, bytes read and bytes written together."""
    mad: float
    """Gflop/s of 16-wide float32 multiply-adds."""
    search: float
    """10^9 samples/s of searches along rays that end early: what the choice between two runtimes rests on."""


@dataclass(frozen=True)
class Outcome:
    """What the test of one device found."""

    works: bool
    reason: str = ""
    speed: Speed | None = None

    def to_json(self) -> str:
        """As one line of text."""
        return json.dumps(asdict(self))

    @staticmethod
    def from_json(text: str) -> Outcome | None:
        """The inverse of `to_json`; None if the text is damaged or of another version."""
        try:
            raw = cast("dict[str, object]", json.loads(text))
            speed = cast("dict[str, float] | None", raw["speed"])
            return Outcome(
                works=raw["works"] is True,
                reason=str(raw["reason"]),
                speed=None if speed is None else Speed(**speed),
            )
        except (ValueError, TypeError, KeyError):
            return None


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
    from pyibr.opencl import selftest

    return selftest.test(found.handle, measure)
