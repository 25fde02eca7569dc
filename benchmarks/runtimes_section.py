"""The report's section on the CPU runtimes of one machine."""

from __future__ import annotations

from pathlib import Path

from benchmarks import runtimes
from benchmarks.results import Result
from benchmarks.statistics import Quartiles, median
from benchmarks.tables import table, verdict

RUNTIMES = """## CPU runtimes

The same calls on each runtime that the machine has, in turns, in milliseconds. The ratio is that of the slowest to the
fastest.
"""


def runtimes_section(result: Result, folder: Path) -> list[str]:
    """Times by row and runtime, and how far the slowest is behind."""
    names = list(dict.fromkeys(record.subject for record in result.select(quantity="end to end")))
    rows: list[list[str]] = []
    for case in dict.fromkeys(str(record.parameters["case"]) for record in result.select(quantity="end to end")):
        times = {r.subject: r.values for r in result.select(case=case, quantity="end to end")}
        middles = [median(values) for values in times.values()]
        ratio = max(middles) / min(middles)
        judged = [f"{ratio:.2f}", f"at most {runtimes.BAR:g}", verdict(ratio <= runtimes.BAR)]
        cells = [str(Quartiles.of(times[name])) if name in times else "" for name in names]
        rows.append([case, *cells, *(judged if len(middles) > 1 else ["", "", ""])])
    return [RUNTIMES, table(["", *names, "ratio", "bar", ""], rows)]
