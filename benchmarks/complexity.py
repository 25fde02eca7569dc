"""How time and visited samples grow with the image's side: O(n^3) for `search`, O(n^2) for `epipolar`.

The scene is fixed in normalised image coordinates, so that the depth's range spans a part of the image that
does not depend on n, and epipolar segments grow with n. It is drawn with `edges="connect"`, as the paper's displacement
maps are: one surface without holes, whatever n makes of its steps.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator
from typing import Any

import pyibr as ibr
from benchmarks import scenes
from benchmarks.cases import Plan
from benchmarks.launches import counted_samples, kernel_times
from benchmarks.results import Record
from benchmarks.runner import Case, Work

SLOW = 512  # from here on a search takes seconds: no turn for nothing before

BARS = {
    ("epipolar", "visited"): (1.9, 2.1),
    ("epipolar", "end to end"): (-math.inf, 2.25),
    ("search", "visited"): (2.85, 3.15),
}
"""The exponent's least and greatest, by method and quantity."""


def cases(plan: Plan) -> Iterator[Case]:
    """One case a method, size and position."""
    for method, sizes in plan.complexity.items():
        for n, repeats in sizes.items():
            for region, motion in plan.complexity_positions:
                parameters = {"method": method, "size": n, "region": region, "motion": motion}
                yield Case(parameters, functools.partial(_prepare, method, n, region, motion, repeats))


def _prepare(method: Any, n: int, region: str, motion: str, repeats: int) -> Work:
    color, depth = _relief(n)
    source, target = scenes.source_camera(n), scenes.target_camera(n, region, motion)

    def warp() -> ibr.Frame:
        return ibr.warp(ibr.DepthImage(color, depth, source), target, method=method, edges="connect")

    def read() -> Iterator[Record]:
        parameters = {"method": method, "size": n, "region": region, "motion": motion}
        with counted_samples() as counts:
            warp()
        # A search's pixels do nothing of their own; the sweep's are steps of its walk as its samples are.
        visited = counts["samples"] + (counts["pixels"] if method == "epipolar" else 0)
        yield Record(method, "visited", "samples", parameters, [visited])
        yield Record(method, "source samples", "samples", parameters, [counts["samples"]])
        if method == "epipolar":
            with kernel_times() as times:
                warp()
            for name, values in times.items():
                yield Record(f"{method}: {name}", "kernel", "ms", parameters, values)

    return Work({method: warp}, repeats, read, warm=method == "epipolar" or n < SLOW)


@functools.lru_cache(maxsize=1)
def _relief(n: int) -> Any:
    return scenes.relief(n)
