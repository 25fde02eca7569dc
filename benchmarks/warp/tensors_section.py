"""The report's section on features and tensors."""

from __future__ import annotations

from pathlib import Path

from benchmarks.results import Result
from benchmarks.statistics import Quartiles, median
from benchmarks.tables import only, table, verdict
from benchmarks.warp import tensors as bench

FEATURES = """## Features and tensors

Times are milliseconds of a warp of a kept depth image with features, to new arrays, and of a copy of as many bytes by
NumPy. The depth is a wavy wall with a disk in front of it.
"""

PATH = """### A path in one call

`ibr.torch.warp` draws {frames} frames of a path with three channels in one call; the time is that of a frame. *With
gradient*: a frame, and the gradient of its sum. The splat adds up the four pixels around each sample, weighted by
depth, in PyTorch on the same processor. Video models share functions of this kind, which take longer.
"""


def tensors_section(result: Result, _: Path) -> list[str]:
    """Make the tables of features, with their bars, and of paths."""
    parts = [FEATURES, _features(result)]
    return parts + ([PATH.format(frames=bench.FRAMES), _paths(result)] if list(result.select(case="path")) else [])


def _features(result: Result) -> str:
    rows: list[list[str]] = []
    for size in dict.fromkeys(str(record.parameters["size"]) for record in result.select(subject=bench.OURS)):
        times: dict[str, list[float]] = {}
        for name in bench.FEATURES:
            ours, copy = (
                only(result.select(subject=subject, size=size, features=name)) for subject in (bench.OURS, bench.COPY)
            )
            times[name] = ours
            narrow, (channels, _) = times[next(iter(bench.FEATURES))], bench.FEATURES[name]
            over = [f"{median(ours) / median(narrow):.2f}", f"{median(ours) / median(copy):.2f}"]
            bars = {16: (over[0], bench.WIDE_BAR), 1024: (over[1], bench.MOST_BAR)}
            found = bars.get(channels)
            judged = ["", ""] if found is None else [f"at most {found[1]:g}", verdict(float(found[0]) <= found[1])]
            rows.append([size, name, str(Quartiles.of(ours)), str(Quartiles.of(copy)), *over, *judged])
    return table(["size", "channels", bench.OURS, bench.COPY, "over 3 channels", "over the copy", "bar", ""], rows)


def _paths(result: Result) -> str:
    rows: list[list[str]] = []
    for size in dict.fromkeys(str(record.parameters["size"]) for record in result.select(subject=bench.SPLAT)):
        times = [only(result.select(subject=name, size=size)) for name in (bench.ONE_CALL, bench.GRADIENT, bench.SPLAT)]
        times[0] = [each / bench.FRAMES for each in times[0]]
        rate = median(times[2]) / median(times[0])
        rows.append([size, *(str(Quartiles.of(one)) for one in times), f"{rate:.1f}"])
    return table(["size", bench.ONE_CALL, bench.GRADIENT, bench.SPLAT, "rate over the splat's"], rows)
