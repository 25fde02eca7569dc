"""The section on GPUs: instructions counted by Oclgrind, times that they imply at least, and runs on a device."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.cases import QUICK
from benchmarks.gpu import card
from benchmarks.gpu.gpu import CARDS, Card, Cost, parsed
from benchmarks.gpu.gpu_section import card_section, gpu_section
from benchmarks.results import Parameter, Record, Result
from benchmarks.runner import run

TOLD = """
=== launch sweep 4
=== piece 1
Instructions executed for kernel 'sweep':
           1,000 - load private (4,000 bytes)
             100 - fadd
              50 - call _Z4fabsf()
              50 - call column_at()
              30 - load global (120 bytes)

=== piece 61
Instructions executed for kernel 'sweep':
             900 - fadd
              20 - store global (80 bytes)
=== launch end 0
"""


def test_instructions_are_those_that_no_compiler_leaves_out() -> None:
    (launch,) = parsed(TOLD)
    assert (launch.kernel, launch.items) == ("sweep", 4)
    assert launch.cost == Cost(0, 100 + 50 + 30 + 900 + 20, 120, 80, chain=180)


@pytest.mark.parametrize(
    ("cost", "seconds"), [(Cost(read=30, written=20), 5), (Cost(instructions=300), 6), (Cost(chain=14), 7)]
)
def test_what_is_longest_bounds_a_kernel(cost: Cost, seconds: float) -> None:
    assert Card(bytes_per_second=10, operations_per_second=100, clock=8).seconds(cost) == seconds


def test_the_section_shows_each_call_and_its_kernels(tmp_path: Path) -> None:
    here: dict[str, Parameter] = {"call": "four views", "size": "2048 x 2048"}
    records = [Record("four views", what, "count", here, [3]) for what in ("launch", "wait", "upload", "download")]
    records += [Record("sweep", quantity, "count", here, [2e6]) for quantity in vars(Cost())]
    records += [Record(card, "bound", "ms", here, [8.5]) for card in CARDS]
    head, calls, judged, kernels = gpu_section(Result("gpu", {}, records), tmp_path)
    assert "33 ms" in head
    assert "| four views | NVIDIA A100 40 GB | 8.50 | at most 10 | met |" in judged
    assert "| four views, 2048 x 2048 | 3 | 3 | 3 | 3 | 2.0 | 2.0 | 2.0 | 2,000,000 | 8.50 | 8.50 | 8.50 |" in calls
    assert "| `sweep` | 2,000,000 | 2.0 | 2.0 | 2.0 | 2,000,000 |" in kernels


def test_without_a_gpu_the_section_says_that_it_is_empty(tmp_path: Path) -> None:
    result = run("card", card.cases(replace(QUICK, card="no such kind")))
    assert result.records == []
    assert "No GPU has run these kernels yet" in card_section(result, tmp_path)[0]
    assert [skip.reason for skip in result.skipped] == ["there is no working device of the kind no such kind"]


@pytest.mark.thorough
def test_a_device_is_tested_compared_and_timed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A CPU stands in for the GPU."""
    monkeypatch.setattr(card, "calls", lambda: {"one": lambda: [np.arange(3.0)]})
    records = run("card", card.cases(replace(QUICK, card="cpu"))).records
    by_quantity = {(record.subject, record.quantity): record.values for record in records}
    assert by_quantity["passed", "tests"][0] > 0 and by_quantity["failed", "tests"] == [0]
    assert by_quantity["one", "alike"] == [1.0]
    assert len(by_quantity["warp", "end to end"]) == card.TURNS
    tests, pictures, times, _ = card_section(Result("card", {}, records), tmp_path)[1:]
    assert "| failed | 0 |" in tests and "| warp, 24 x 18 |" in times
    assert "| one | 100.000% | met | 100.000% |" in pictures


def test_values_are_alike_up_to_rounding() -> None:
    depth = np.array([1.0, 2.0, np.nan, 4.0], np.float32)
    assert card.alike(depth * np.float32(1 + 1e-6), depth) == 1
    assert card.alike(depth * np.float32(1 + 1e-6), depth, 0) == 0.25
    assert card.alike(np.array([1, 2, 3, 4], np.float32), depth) == 0.75
    assert card.alike(np.array([0, 255, 7], np.uint8), np.array([1, 0, 7], np.uint8)) == pytest.approx(2 / 3)
    assert card.alike(np.array([0, 1]), np.array([1, 1])) == 0.5
    assert card.alike(depth[:2], depth) == 0
