"""The report's section on depth edges."""

from __future__ import annotations

from pathlib import Path

from benchmarks.results import Result
from benchmarks.tables import table, verdict
from benchmarks.warp.edges import AUTOMATIC, BARS, BASE, FEW, SEPARATOR, SHEETS, TORN, WAYS

EDGES = """## Depth edges

Noise of each kind is added to images of {count} scenes whose depth and depth edges are known exactly. *Torn* counts
samples that the edge test cuts from a neighbour on the same surface. *Sheets* counts samples that it joins to another
surface, across empty space. Each cell is *torn / sheets*, added over all scenes. Scenes are left out if their pattern
repeats within fewer than three samples.

Every edge counts, even a step of 1 % of the depth, which is below the ratios' limits, and a step that the noise hides.
Required: the default test tears at most {torn:g} times as many samples as {base}. It leaves at most {sheets:g} times as
many sheets plus {more} samples, and no more than {base} in images less than {few} samples wide.
"""

LOSSES = """### Where the ratio is better

There is a row for each size, noise and scene: {rows} in all. In {torn} rows the default test tears more samples than
{base}, in {sheets} it leaves more sheets. For each size and scene, the row with the greatest loss is taken; the table
shows the worst {shown} of these {count}.
"""

_SHOWN = 20

Key = tuple[str, str, str]  # size, noise, scene
Counts = dict[str, tuple[int, int]]  # by way: torn, sheets


def edges_section(result: Result, _: Path) -> list[str]:
    """Tables of totals by size and noise with their bars, and of scenes in which the ratio is better."""
    rows = _rows(result)
    ways = [way for way in WAYS if any(way in counts for counts in rows.values())]
    lines: list[list[str]] = []
    for size, noise in dict.fromkeys(key[:2] for key in rows):
        here = [counts for key, counts in rows.items() if key[:2] == (size, noise)]
        total = {way: (sum(c[way][0] for c in here), sum(c[way][1] for c in here)) for way in ways}
        (torn, sheets), (base_torn, base_sheets) = total[AUTOMATIC], total[BASE]
        factor, more = BARS[SHEETS] if int(size.split(" x ")[0]) >= FEW else (1, 0)
        met = [torn <= BARS[TORN][0] * base_torn + BARS[TORN][1], sheets <= factor * base_sheets + more]
        lines.append([size, noise, *(_cell(total[way]) for way in ways), *map(verdict, met)])
    text = EDGES.format(
        count=len({scene for _, _, scene in rows}),
        base=BASE,
        torn=BARS[TORN][0],
        sheets=BARS[SHEETS][0],
        more=BARS[SHEETS][1],
        few=FEW,
    )
    return [text, table(["size", "noise", *ways, "torn", "sheets"], lines), *_losses(rows, ways)]


def _rows(result: Result) -> dict[Key, Counts]:
    rows: dict[Key, Counts] = {}
    for torn in result.select(quantity=TORN):
        (sheets,) = result.select(subject=torn.subject, quantity=SHEETS, **torn.parameters)
        size, scene, noises = (str(torn.parameters[name]) for name in ("size", "scene", "noises"))
        for noise, *counts in zip(noises.split(SEPARATOR), torn.values, sheets.values, strict=True):
            rows.setdefault((size, noise, scene), {})[torn.subject] = int(counts[0]), int(counts[1])
    return rows


def _losses(rows: dict[Key, Counts], ways: list[str]) -> list[str]:
    """Table of the scenes in which the default test loses most."""
    excess = {key: tuple(a - b for a, b in zip(c[AUTOMATIC], c[BASE], strict=True)) for key, c in rows.items()}
    worst: dict[tuple[str, str], tuple[int, Key]] = {}
    for key, more in excess.items():
        if max(more) > 0:
            at = key[0], key[2]
            worst[at] = max(worst.get(at, (0, key)), (max(more), key), key=lambda item: item[0])
    if not worst:
        return []
    shown = sorted(worst.values(), key=lambda item: -item[0])[:_SHOWN]
    text = LOSSES.format(
        torn=sum(more[0] > 0 for more in excess.values()),
        sheets=sum(more[1] > 0 for more in excess.values()),
        rows=len(rows),
        base=BASE,
        shown=len(shown),
        count=len(worst),
    )
    lines = [[key[0], key[2], key[1], *(_cell(rows[key][way]) for way in ways)] for _, key in shown]
    return [text, table(["size", "scene", "noise", *ways], lines)]


def _cell(counts: tuple[int, int]) -> str:
    return f"{counts[0]:,} / {counts[1]:,}"
