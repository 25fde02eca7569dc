"""The measurement on which the choice among several CPU runtimes is based."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator
from pathlib import Path

import pytest

from pyibr.opencl import fastest
from pyibr.opencl.apart import Ended
from pyibr.opencl.choice import choose
from pyibr.opencl.device import current, devices
from pyibr.opencl.fastest import forget_picture_time, picture_time
from pyibr.opencl.outcome import Outcome
from pyibr.opencl.runtimes import Found, found_devices


@pytest.fixture
def nothing_timed() -> Iterator[None]:
    picture_time.cache_clear()
    yield
    picture_time.cache_clear()


class Ends:
    """Stub of `run_apart` that counts its runs."""

    def __init__(self, ended: Ended | None) -> None:
        self.ended = ended
        self.runs = 0

    def __call__(self, module: str, *arguments: str, task: str) -> Ended | None:
        self.runs += 1
        return self.ended


def here() -> Found:
    return found_devices()[current().device.index]


def test_a_time_is_measured_once_and_told_beforehand(
    own_cache: Path, nothing_timed: None, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
):
    ends = Ends(Ended(["a remark", "0.25"], 0, ""))
    monkeypatch.setattr(fastest, "run_apart", ends)
    with caplog.at_level(logging.INFO, "pyibr"):
        for _ in range(3):
            assert picture_time(here()) == 0.25
            picture_time.cache_clear()  # as in another process
    (said,) = caplog.messages
    assert "is measured, once" in said and ends.runs == 1
    forget_picture_time(here())
    assert picture_time(here()) == 0.25 and ends.runs == 2


def test_a_runtime_that_fails_is_last_and_told(
    own_cache: Path, nothing_timed: None, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
):
    ends = Ends(Ended([], -11, "the runtime crashed on small pictures (signal 11)"))
    monkeypatch.setattr(fastest, "run_apart", ends)
    for _ in range(2):
        assert picture_time(here()) == math.inf
        picture_time.cache_clear()
    (said,) = (record.getMessage() for record in caplog.records if record.levelno == logging.WARNING)
    assert "is not used: the runtime crashed" in said and ends.runs == 1


def test_what_says_nothing_of_the_runtime_is_not_kept(
    own_cache: Path, nothing_timed: None, monkeypatch: pytest.MonkeyPatch
):
    """No Python can be started, or no cache can be written, so that each process would measure again."""
    ends = Ends(None)
    monkeypatch.setattr(fastest, "run_apart", ends)
    assert picture_time(here()) == math.inf
    picture_time.cache_clear()
    ends.ended = Ended(["0.5"], 0, "")
    assert picture_time(here()) == 0.5
    forget_picture_time(here())
    monkeypatch.setattr(fastest, "cache_fault", lambda: ("it cannot be written", "mend it"))
    assert picture_time(here()) == math.inf and ends.runs == 2


@pytest.mark.thorough
def test_each_runtime_of_this_machine_is_measured():
    works = {device.index for device in devices() if device.works and device.kind == "cpu"}
    rivals = [found for found in found_devices() if found.index in works]
    if not rivals:
        pytest.skip("no OpenCL device is a CPU")
    for found in rivals:
        forget_picture_time(found)
    times = {found.index: picture_time(found) for found in rivals}
    assert all(0 < seconds < math.inf for seconds in times.values())
    assert times[choose(rivals, lambda found: Outcome(True), picture_time).index] == min(times.values())
