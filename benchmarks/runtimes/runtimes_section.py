"""The report's section on the CPU runtimes of one machine."""

from __future__ import annotations

from pathlib import Path

from benchmarks.results import Result
from benchmarks.runtimes import runtimes
from benchmarks.statistics import Quartiles, median, number
from benchmarks.tables import table, verdict

RUNTIMES = """## CPU runtimes

All runtimes make the same calls in turns, each in its own process. Times are milliseconds; the ratio is the slowest
runtime's time divided by the fastest runtime's.
"""
FIRST = "the first warp, filled, 640 x 480, including the building of kernels"
EACH = "Ratios of each runtime's time to the fastest runtime's time in the same row:\n"


def runtimes_section(result: Result, folder: Path) -> list[str]:
    """Tables of times by row and runtime with the largest ratio of each row, and of each runtime's ratios."""
    times: dict[str, dict[str, list[float]]] = {}
    for record in result.select(quantity="end to end"):
        times.setdefault(str(record.parameters["case"]), {})[record.subject] = record.values
    names = list(dict.fromkeys(name for row in times.values() for name in row))
    rows: list[list[str]] = []
    ratios: dict[str, dict[str, float]] = {name: {} for name in names}
    for case, row in times.items():
        least = min(map(median, row.values()))
        for name, values in row.items():
            ratios[name][case] = median(values) / least
        worst = max(ratios[name][case] for name in row)
        judged = [f"{worst:.2f}", f"at most {runtimes.BAR:g}", verdict(worst <= runtimes.BAR)]
        cells = [str(Quartiles.of(row[name])) if name in row else "" for name in names]
        rows.append([case, *cells, *(judged if len(row) > 1 else ["", "", ""])])
    first = {record.subject: number(record.values[0]) for record in result.select(quantity="first picture")}
    if first:
        rows.append([FIRST, *(first.get(name, "") for name in names), "", "", ""])
    parts = [RUNTIMES, table(["", *names, "ratio", "bar", ""], rows)]
    if len(names) > 1:
        parts += [
            EACH,
            table(["", "fastest in", "median ratio", "worst"], [_beside(name, ratios[name]) for name in names]),
        ]
    return parts


def _beside(name: str, ratios: dict[str, float]) -> list[str]:
    """A runtime's name, the number of rows in which it is fastest, its median ratio and its worst row."""
    worst = max(ratios, key=lambda case: ratios[case])
    fastest = sum(ratio == 1 for ratio in ratios.values())
    return [name, f"{fastest} of {len(ratios)}", f"{median(ratios.values()):.2f}", f"{ratios[worst]:.2f} ({worst})"]
