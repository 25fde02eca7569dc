"""The report's section on registration."""

from __future__ import annotations

from pathlib import Path

from benchmarks.results import Record, Result
from benchmarks.statistics import Quartiles, median
from benchmarks.tables import table, verdict
from benchmarks.warp.opencv import REGISTER
from benchmarks.warp.registration import BARS, COLORS, DILATED, MILLIMETRES, REGISTERED, ZOOM

REGISTRATION = """## Registration

Depth of a depth camera in the image of a colour camera 2.5 cm beside it, which sees {wider:.0%} farther to each side:
frame 0 of the scene of *Real RGB-D*, without noise and with so many pixels of disparity. Milliseconds from NumPy arrays
to NumPy arrays, in turns in one process. *Covers*: the share of the colour image that gets depth. {register} moves
samples to whole pixels and leaves gaps where they spread; dilated, it writes each to four.
"""

_SUBJECTS = (REGISTERED, MILLIMETRES, COLORS, REGISTER, DILATED)


def registration_section(result: Result, _: Path) -> list[str]:
    """Times by size and noise, the ratio with its bar, and how much is covered."""
    groups: dict[tuple[str, float], list[Record]] = {}
    for record in result.records:
        groups.setdefault((str(record.parameters["size"]), float(record.parameters["noise"])), []).append(record)
    lines: list[list[str]] = []
    for (size, noise), records in groups.items():
        values = {(record.subject, record.quantity): record.values for record in records}
        ratio = median(values[REGISTERED, "end to end"]) / median(values[REGISTER, "end to end"])
        bar = BARS.get(size)
        judged = ["", ""] if bar is None else [f"at most {bar:g}", verdict(ratio <= bar)]
        times = [str(Quartiles.of(values[subject, "end to end"])) for subject in _SUBJECTS]
        covered = [f"{values[subject, 'coverage'][0]:.1%}" for subject in (REGISTERED, REGISTER, DILATED)]
        lines.append([size, f"{noise:g}", *times, f"{ratio:.2f}", *judged, *covered])
    covers = [f"{subject} covers" for subject in (REGISTERED, REGISTER, DILATED)]
    heads = ["size", "noise", *_SUBJECTS, f"{REGISTERED} / {REGISTER}", "bar", "", *covers]
    return [REGISTRATION.format(register=REGISTER, wider=1 / ZOOM - 1), table(heads, lines)]
