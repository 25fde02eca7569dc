"""Counts of what a GPU would be given: read from what Oclgrind prints, and judged as a bound."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.gpu.gpu import CARDS, Card, Cost, parsed
from benchmarks.gpu.gpu_section import gpu_section
from benchmarks.results import Parameter, Record, Result

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
    head, calls, kernels = gpu_section(Result("gpu", {}, records), tmp_path)
    assert "33 ms" in head
    assert "| four views, 2048 x 2048 | 3 | 3 | 3 | 3 | 2.0 | 2.0 | 2.0 | 2,000,000 | 8.50 | 8.50 | 8.50 |" in calls
    assert "| `sweep` | 2,000,000 | 2.0 | 2.0 | 2.0 | 2,000,000 |" in kernels
