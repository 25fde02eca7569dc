"""The report's section on filled holes."""

from __future__ import annotations

from pathlib import Path

from benchmarks.results import Record, Result
from benchmarks.tables import table, verdict
from benchmarks.warp.filling import BETWEEN, FILLS, HIDDEN, RADII, TELEA

FILLING = """## Filled holes

The filled colours are compared with the picture that the new camera took: cells show mean differences in levels of 255.
They are taken over all holes except pixels outside the source's image, and over the *hidden* pixels alone, which the
source did not see. Other holes are places, such as windows, where the source has colours without depth. {telea} fills
the unfilled picture by the method of Telea (2004), with radius {radii} pixels, whichever is better.
"""


def filling_section(result: Result, _: Path) -> list[str]:
    """Table of errors by pair and fill, with the bar for filling from behind."""
    groups: dict[tuple[str, str], list[Record]] = {}
    for record in result.records:
        groups.setdefault((str(record.parameters["scene"]), str(record.parameters["motion"])), []).append(record)
    lines: list[list[str]] = []
    for at, records in groups.items():
        off = {(record.quantity, record.subject): 255 * record.values[0] for record in records}
        cells = [
            f"{off[key]:.1f}" if (key := (part, subject)) in off else ""
            for part in (BETWEEN, HIDDEN)
            for subject in (*FILLS, TELEA)
        ]
        judged = verdict(off[BETWEEN, FILLS[0]] < off[BETWEEN, TELEA])
        lines.append([*at, *cells[: len(FILLS) + 1], f"below {TELEA}", judged, *cells[len(FILLS) + 1 :]])
    hidden = [f"hidden: {subject}" for subject in (*FILLS, TELEA)]
    heads = ["scene", "motion", *FILLS, TELEA, "bar for background", "", *hidden]
    return [FILLING.format(telea=TELEA, radii=" or ".join(map(str, RADII))), table(heads, lines)]
