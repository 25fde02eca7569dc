"""The report's section on displaced surfaces and meshes cut from the same base."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks import displaced, plots
from benchmarks.results import Result
from benchmarks.statistics import Quartiles, median, number
from benchmarks.tables import only, table

DISPLACED = """## Displaced surfaces and meshes

A donut of 1,152 triangles carries a height map, a tenth of its radius deep: *smooth* repeats 128 x 128 texels 6 x 3
times, *rough* is noise of 1024 x 1024 texels with more weight on longer waves. The truth is the same base, cut 75 x 75
and displaced, ray cast by Embree. *Error* is the mean difference of depth where both pictures are covered, in percent
of the map's depth. *Mesh at equal error* is the time of a mesh with that error, interpolated between the cuts, and in
brackets its ratio to the row's time; above 1, the row is faster. Memory is that of vertices, triangles and heights,
without colours.

![Time against error](displaced.png)
"""


def displaced_section(result: Result, folder: Path) -> list[str]:
    """Make a table for each map, and the plot of time against error."""
    parts, points = [DISPLACED], dict[tuple[str, str], dict[str, tuple[float, float]]]()
    for name in displaced.MAPS:
        rows: list[list[str]] = []
        for size in dict.fromkeys(str(record.parameters["size"]) for record in result.select(map=name)):
            records = list(result.select(map=name, size=size, quantity="end to end"))
            errors = {
                r.subject: only(result.select(map=name, size=size, subject=r.subject, quantity="depth error"))[0]
                for r in records
            }
            times = {record.subject: median(record.values) for record in records}
            points[name, size] = {subject: (errors[subject], times[subject]) for subject in times}
            meshes = [points[name, size][one] for one in times if one not in displaced.OURS]
            for record in records:
                more = {r.quantity: r.values[0] for r in result.select(map=name, size=size, subject=record.subject)}
                ours = record.subject in displaced.OURS
                rows.append(
                    [
                        size,
                        record.subject,
                        str(Quartiles.of(record.values)),
                        f"{errors[record.subject]:.2%}",
                        f"{more['silhouette (IoU)']:.4f}",
                        number(more["memory"] / 2**20),
                        equal_error(meshes, *points[name, size][record.subject]) if ours else "",
                    ]
                )
        heads = ["size", "", "ms", "error", "IoU", "MiB", "mesh at equal error"]
        parts += [f"### A {name} map\n", table(heads, rows)]
    plots.displaced(points, list(displaced.OURS), folder / "displaced.png")
    return parts


def equal_error(meshes: list[tuple[float, float]], error: float, time: float) -> str:
    """Time of a mesh with this error, interpolated in logarithms, and its ratio to `time`; bounds beyond the meshes."""
    errors, times = np.array(sorted(meshes)).T
    found = float(np.exp(np.interp(np.log(error), np.log(errors), np.log(times))))
    sign = "over " if error < errors[0] else "under " if error > errors[-1] else ""
    return f"{sign}{number(found)} ({sign}{found / time:.2f})"
