"""The report's section on registration."""

from __future__ import annotations

from pathlib import Path

from benchmarks.results import Record, Result
from benchmarks.statistics import Quartiles, median
from benchmarks.tables import table, verdict
from benchmarks.warp.opencv import REGISTER
from benchmarks.warp.registration import BARS, COLORS, DILATED, MILLIMETRES, REGISTERED, RIGS

REGISTRATION = """## Registration

Each call gives depth to the pixels of a colour camera beside the depth camera. The depth is frame 0 of the scene of
*Real RGB-D*; noise is in pixels of disparity. Times are milliseconds from NumPy arrays to NumPy arrays, in turns in one
process. *Covers* is the share of the colour image that gets depth. {register} moves each sample to one pixel, which
leaves gaps where samples spread apart; *dilated*, it writes each sample to four pixels. {register} also takes fresh
memory pages from the system in each call. In a process that has freed larger arrays before, it reuses their pages, and
takes less than half as long. There are two colour cameras:

{rigs}
"""

_RIG = "- *{name}*: {aside:g} cm aside, turned by {turn:g}°, with {zoom:.2f} times the depth camera's focal length."

_SUBJECTS = (REGISTERED, MILLIMETRES, COLORS, REGISTER, DILATED)


def registration_section(result: Result, _: Path) -> list[str]:
    """Table of times, the ratio with its bar, and the covered share, by rig, size and noise."""
    groups: dict[tuple[str, str, float], list[Record]] = {}
    for record in result.records:
        rig, size, noise = (record.parameters[name] for name in ("rig", "size", "noise"))
        groups.setdefault((str(rig), str(size), float(noise)), []).append(record)
    lines: list[list[str]] = []
    for (rig, size, noise), records in groups.items():
        values = {(record.subject, record.quantity): record.values for record in records}
        ratio = median(values[REGISTERED, "end to end"]) / median(values[REGISTER, "end to end"])
        bar = BARS.get((rig, size))
        judged = ["", ""] if bar is None else [f"at most {bar:g}", verdict(ratio <= bar)]
        times = [str(Quartiles.of(values[subject, "end to end"])) for subject in _SUBJECTS]
        covered = [f"{values[subject, 'coverage'][0]:.1%}" for subject in (REGISTERED, REGISTER, DILATED)]
        lines.append([rig, size, f"{noise:g}", *times, f"{ratio:.2f}", *judged, *covered])
    covers = [f"{subject} covers" for subject in (REGISTERED, REGISTER, DILATED)]
    heads = ["rig", "size", "noise", *_SUBJECTS, f"{REGISTERED} / {REGISTER}", "bar", "", *covers]
    rigs = (_RIG.format(name=n, aside=100 * rig.aside, turn=rig.turn, zoom=rig.zoom) for n, rig in RIGS.items())
    return [REGISTRATION.format(register=REGISTER, rigs="\n".join(rigs)), table(heads, lines)]
