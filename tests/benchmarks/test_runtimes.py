"""The comparison of CPU runtimes: in which system each Python runs, and the section of the report."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from benchmarks.results import Record, Result
from benchmarks.runtimes.process import _command
from benchmarks.runtimes.runtimes_section import runtimes_section


def test_a_python_in_another_systems_folder_has_that_as_its_root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "etc").mkdir()
    (tmp_path / "etc/os-release").touch()
    command = _command(tmp_path / "root/v/bin/python", "[0]")
    assert command[0] == "unshare" and str(tmp_path) in command
    assert command[-4:] == ["/root/v/bin/python", "-m", "benchmarks.runtimes.process", "[0]"]
    monkeypatch.chdir(tmp_path)
    assert _command(Path("root/v/bin/python"), "[0]") == command
    assert _command(Path(sys.executable))[0] == sys.executable


def test_the_report_shows_how_far_each_runtime_is_behind(tmp_path: Path):
    times = {"warp": {"one": 2.0, "two": 3.0}, "relief": {"one": 4.4, "two": 4.0}}
    records = [
        Record(name, "end to end", "ms", {"case": case}, [value])
        for case, row in times.items()
        for name, value in row.items()
    ]
    records.append(Record("two", "first picture", "ms", {}, [2500.0]))
    text = "".join(runtimes_section(Result("runtimes", {}, records), tmp_path))
    assert "| 1.50 | at most 1.2 | **not met** |" in text and "| 1.10 | at most 1.2 | met |" in text
    assert "building of kernels |  | 2500 |  |  |  |" in text
    assert "| one | 1 of 2 | 1.05 | 1.10 (relief) |" in text and "| two | 1 of 2 | 1.25 | 1.50 (warp) |" in text
