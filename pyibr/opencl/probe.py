"""Tests of devices: whether they work, and how fast they are. Outcomes are kept on disk.

A broken runtime may crash or hang, so its test (`selftest`) runs in a separate process. If the device works, and the
runtime keeps compiled kernels on disk, that process then builds programs for the first picture (`builder`).
"""

from __future__ import annotations

from typing import Literal

from pyibr.opencl import selftest
from pyibr.opencl.apart import start_apart, timeout
from pyibr.opencl.builder import keep_builder
from pyibr.opencl.cache import Entry
from pyibr.opencl.runtimes import Found, runtime_of
from pyibr.opencl.selftest import Outcome

Doubted = Literal["nothing", "broken", "all"]
"""Outcomes of earlier processes that are not trusted."""

_TASK = "a tiny kernel"
_tested: dict[str, Outcome] = {}  # outcomes of this process, by device key


def probe(found: Found, measure: bool = False, doubted: Doubted = "nothing") -> Outcome:
    """Return whether a device works, from the cache if it was tested before.

    measure: also measure its speed. doubted: "all" also ignores earlier outcomes of this process.
    """
    known = None if doubted == "all" else _tested.get(found.key) or _kept(found, doubted)
    if known is not None and (known.speed is not None or not measure or not known.works):
        return known
    outcome = _tested[found.key] = _test_apart(found, measure)
    _entry(found).write(outcome.to_json().encode())
    return outcome


def remember(found: Found, outcome: Outcome) -> None:
    """Set the device's outcome, in this process only."""
    _tested[found.key] = outcome


def forget(found: Found) -> None:
    """Forget the device's outcome, so that it is tested again."""
    _tested.pop(found.key, None)
    _entry(found).forget()


def _entry(found: Found) -> Entry:
    return Entry("devices", found.kind, found.key)


def _kept(found: Found, doubted: Doubted) -> Outcome | None:
    data = _entry(found).read()
    outcome = None if data is None else Outcome.from_json(data.decode())
    return None if outcome is None or (doubted == "broken" and not outcome.works) else outcome


def _test_apart(found: Found, measure: bool) -> Outcome:
    """Test the device in a separate process, or in this one if no Python with the packages can be started."""
    builds = not measure and runtime_of(found).keeps_kernels()
    module, what = ("build_server", "builds") if builds else ("selftest", "speed" if measure else "works")
    process = start_apart(f"pyibr.opencl.{module}", found.key, what)
    if process is None:
        return selftest.test(found.handle, measure)
    in_time = process.wait(lambda: _outcome_in(process.lines) is not None)
    outcome = _outcome_in(process.lines)
    if outcome is not None and outcome.works and builds:
        keep_builder(process, found.key)
    elif in_time:
        process.wait()
    if outcome is not None:
        return outcome
    if not in_time:
        return Outcome(False, f"{_TASK} did not end within {timeout():g} s")
    if selftest.READY not in process.lines and (process.status or 0) > 0:
        return selftest.test(found.handle, measure)
    return Outcome(False, process.fault(_TASK))


def _outcome_in(lines: list[str]) -> Outcome | None:
    """Outcome in the last line that a test has printed."""
    return Outcome.from_json(lines[-1]) if lines else None
