"""Times the same calls on every CPU runtime of this machine, and of Debians in folders, in turns."""

from __future__ import annotations

import functools
from collections.abc import Iterator

from benchmarks.cases import Plan, Size
from benchmarks.results import Parameter, Record, Skip
from benchmarks.runner import Case, Work
from benchmarks.runtimes.process import Drawing, Runtime, first_time, runtimes_of
from benchmarks.runtimes.rows import ROWS, SIZED

BAR = 1.2
"""Largest ratio of the slowest runtime's time to the fastest runtime's time, in each row."""


def cases(plan: Plan) -> Iterator[Case]:
    """One case per row."""
    named = {runtime.name: runtime for python in plan.pythons for runtime in runtimes_of(python)}
    found = list(named.values())
    for row in ROWS:
        for size, repeats in plan.runtimes.items() if row in SIZED else [((0, 0), max(plan.runtimes.values()))]:
            parameters: dict[str, Parameter] = {"case": f"{row}, {size[0]} x {size[1]}" if row in SIZED else row}
            yield Case(parameters, functools.partial(_prepare, found, row, size, repeats, parameters))
    yield Case({"case": "first picture"}, lambda: Work(read=lambda: _first_times(found)))


def _first_times(found: list[Runtime]) -> Iterator[Record]:
    for runtime in found:
        yield Record(runtime.name, "first picture", "ms", {}, [first_time(runtime)])


def _prepare(found: list[Runtime], row: str, size: Size, repeats: int, parameters: dict[str, Parameter]) -> Work | Skip:
    if not found:
        return Skip(row, "no OpenCL device is a CPU")

    def read() -> Iterator[Record]:
        turns = [[drawing.draw() for drawing in drawings] for _ in range(repeats)]
        end()
        for runtime, times in zip(found, zip(*turns, strict=True), strict=True):
            yield Record(runtime.name, "end to end", "ms", parameters, list(times))

    def end() -> None:
        for drawing in drawings:
            drawing.end()

    drawings = [Drawing(runtime, row, size) for runtime in found]
    if faults := [drawing.fault for drawing in drawings if drawing.fault]:
        end()
        return Skip(row, faults[0])
    return Work(read=read)
