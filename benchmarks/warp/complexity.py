"""Measures how time and visited samples grow with the image's side n: by O(n^3) for `search`, O(n^2) for `epipolar`.

The smooth scene has the same shape at any n, so that epipolar segments grow in proportion to n. White noise in the same
range of depth is the other extreme. The hit on a pixel's epipolar line then hardly predicts the hit on the pixel's own
ray, so this ray is traced, in a number of windows that grows with n. The number of windows is bounded, but these images
are too small to reach the bound, so visits on noise have no bar. Both scenes are drawn with `edges="connect"`, like the
paper's displacement maps: one surface without holes, however steep it is.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator
from typing import Any

import pyibr as ibr
from benchmarks import scenes
from benchmarks.cases import Plan
from benchmarks.launches import counted_samples, kernel_times
from benchmarks.results import Parameter, Record
from benchmarks.runner import Case, Work

SLOW = 512  # a search of this size or more takes seconds, and runs without a warm-up

SMOOTH, NOISE, SEARCH = "epipolar", "epipolar, white noise", "search"
SUBJECTS: dict[str, tuple[Any, Callable[[int], Any]]] = {
    SMOOTH: ("epipolar", scenes.relief),
    NOISE: ("epipolar", scenes.white_noise),
    SEARCH: ("search", scenes.relief),
}
"""Method and surface, by subject."""

BARS = {
    (SMOOTH, "visited"): (-math.inf, 2.1),
    (SMOOTH, "end to end"): (-math.inf, 2.25),
    (NOISE, "end to end"): (-math.inf, 2.25),
    (SEARCH, "visited"): (2.85, 3.15),
}
"""Least and greatest exponent, by subject and quantity. O(n^2) is an upper bound, so it sets no least exponent."""


def cases(plan: Plan) -> Iterator[Case]:
    """One case per subject, size and position."""
    for subject, sizes in plan.complexity.items():
        for n, repeats in sizes.items():
            for region, motion in plan.complexity_positions:
                parameters: dict[str, Parameter] = {"size": n, "region": region, "motion": motion}
                yield Case(
                    {"subject": subject, **parameters}, functools.partial(_prepare, subject, parameters, repeats)
                )


def _prepare(subject: str, parameters: dict[str, Parameter], repeats: int) -> Work:
    n, region, motion = int(parameters["size"]), str(parameters["region"]), str(parameters["motion"])
    method = SUBJECTS[subject][0]
    color, depth = _surface(subject, n)
    source, target = scenes.source_camera(n), scenes.target_camera(n, region, motion)

    def warp() -> ibr.Frame:
        return ibr.warp(ibr.DepthImage(color, depth, source), target, method=method, edges="connect")

    def read() -> Iterator[Record]:
        with counted_samples() as counts:
            warp()
        visited = {kernel: seen.samples + seen.pixels for kernel, seen in counts.items()}
        yield Record(subject, "visited", "samples", parameters, [sum(visited.values())])
        for kernel, steps in visited.items():
            yield Record(f"{subject}: {kernel}", "visited", "samples", parameters, [steps])
        if method == "epipolar":
            with kernel_times() as times:
                warp()
            for name, values in times.items():
                yield Record(f"{subject}: {name}", "kernel", "ms", parameters, values)

    return Work({subject: warp}, repeats, read, warm=method == "epipolar" or n < SLOW)


@functools.lru_cache(maxsize=1)
def _surface(subject: str, n: int) -> Any:
    return SUBJECTS[subject][1](n)
