"""The report's section on registration."""

from __future__ import annotations

from pathlib import Path

from benchmarks.results import Record, Result
from benchmarks.statistics import Quartiles, median
from benchmarks.tables import table, verdict
from benchmarks.warp.opencv import REGISTER
from benchmarks.warp.registration import BARS, COLORS, DILATED, MILLIMETRES, REGISTERED, RIGS

REGISTRATION = """## Registration

Depth of a depth camera in the image of a colour camera next to it: frame 0 of the scene of *Real RGB-D*, without noise
and with noise in pixels of disparity. Milliseconds from NumPy arrays to NumPy arrays, in turns in one process.
*Covers*: the share of the colour image that gets depth. {register} moves samples to whole pixels and leaves gaps where
they spread; dilated, it writes each sample to four pixels. It asks the system for fresh pages in each call; in a
process that has freed larger arrays before, it reuses their pages and takes less than half as long. The colour camera
is

{rigs}
"""

_RIG = "- *{name}*: {aside:g} cm aside, turned by {turn:g}°, its focal length {zoom:.2f} of the depth camera's."

_SUBJECTS = (REGISTERED, MILLIMETRES, COLORS, REGISTER, DILATED)


def registration_section(result: Result, _: Path) -> list[str]:
    """Times by rig, size and noise, the ratio with its bar, and the covered share."""
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
