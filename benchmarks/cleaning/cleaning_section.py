"""The report's section on cleaned depth."""

from __future__ import annotations

from pathlib import Path

from benchmarks.cleaning.cleaning import BARS, BILATERAL, CLEANED, LOST, STEADY, TWIN
from benchmarks.results import Record, Result
from benchmarks.statistics import Quartiles, median
from benchmarks.tables import table, verdict

CLEANING = """## Cleaned depth

Frame 0 of the scene of *Real RGB-D* gets noise (in pixels of disparity), and loses {lost:.0%} of its samples and
squares of 16 x 16 pixels. Colours guide the cleaning. Times are in milliseconds, from NumPy arrays to NumPy arrays,
measured in turns in one process. The {twin} is the tests' reference, in NumPy and OpenCV. {bilateral} is a filter of
the same radius, which does not treat holes, edges or planes. *Gain* is the reduction of the mean error of 1/depth.
"""

_SUBJECTS = (CLEANED, STEADY, TWIN, BILATERAL)


def cleaning_section(result: Result, _: Path) -> list[str]:
    """Make the table of times, ratios with their bars, and gains, by size and noise."""
    groups: dict[tuple[str, float], list[Record]] = {}
    for record in result.records:
        groups.setdefault((str(record.parameters["size"]), float(record.parameters["noise"])), []).append(record)
    lines: list[list[str]] = []
    for (size, noise), records in groups.items():
        values = {(record.subject, record.quantity): record.values for record in records}
        ratio = median(values[CLEANED, "end to end"]) / median(values[TWIN, "end to end"])
        bar = BARS.get(size)
        judged = ["", ""] if bar is None else [f"at most {bar:g}", verdict(ratio <= bar)]
        times = [str(Quartiles.of(values[subject, "end to end"])) for subject in _SUBJECTS]
        gains = [f"{values[subject, 'gain'][0]:.1f} dB" for subject in (CLEANED, TWIN)]
        lines.append([size, f"{noise:g}", *times, f"{ratio:.2f}", *judged, *gains])
    heads = ["size", "noise", *_SUBJECTS, f"{CLEANED} / {TWIN}", "bar", "", f"{CLEANED} gains", f"{TWIN} gains"]
    return [CLEANING.format(lost=LOST, twin=TWIN, bilateral=BILATERAL), table(heads, lines)]
