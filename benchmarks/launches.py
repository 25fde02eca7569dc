"""Times of kernels, launch by launch, and counts of the samples that a warp visits."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from pyibr.opencl.memory import empty
from pyibr.opencl.watch import LaunchTimes, Watch, watching

COUNTED = ("epipolar_sweep", "search", "resolve")


@dataclass(frozen=True)
class Visited:
    """Counts of the samples and pixels that a kernel visited, over all its launches.

    Attributes
    ----------
    samples : int
        Steps along epipolar lines in the source. All lanes of a packet count the slowest one's steps.
    pixels : int
        Target pixels that the sweep writes, or that `resolve` traces again; 0 for a search.
    """

    samples: int = 0
    pixels: int = 0


@contextmanager
def kernel_times() -> Iterator[dict[str, list[float]]]:
    """Yield each kernel's times in milliseconds, one per launch, from an empty queue to the launch's end."""
    times: dict[str, list[float]] = {}
    with watching(LaunchTimes()) as seen:
        yield times
    times |= {name: [1e3 * seconds for seconds in each] for name, each in seen.of.items()}
    _require(times, "no launch was seen")


class _BuildTimes(Watch):
    def __init__(self) -> None:
        self.of: dict[str, float] = {}

    def build(self, name: str, defines: Mapping[str, int], make: Callable[[Mapping[str, int]], Any]) -> Any:
        start = time.perf_counter()
        found = make(defines)
        self.of.setdefault(name, 1e3 * (time.perf_counter() - start))
        return found


@contextmanager
def build_times() -> Iterator[dict[str, float]]:
    """Yield the milliseconds that each kernel's first call takes to build it or to load it."""
    times = _BuildTimes()
    with watching(times):
        yield times.of
    _require(times.of, "no kernel was requested")


class _Counts(Watch):
    def __init__(self) -> None:
        self.of: dict[str, Visited] = {}

    def build(self, name: str, defines: Mapping[str, int], make: Callable[[Mapping[str, int]], Any]) -> Any:
        return make({**defines, "COUNTERS": 1} if name in COUNTED else defines)

    def launch(
        self, kernel: Any, grid: tuple[int, ...], arguments: Mapping[str, Any], enqueue: Callable[..., None]
    ) -> None:
        if kernel.name not in COUNTED:
            enqueue(**arguments)
            return
        target = arguments["map"].values
        shape = {
            "epipolar_sweep": lambda: (arguments["packet_count"], 2),
            "search": lambda: (int(target["dst_height"]), -(-int(target["dst_width"]) // kernel.session.profile.lanes)),
            "resolve": lambda: (math.prod(grid), 2),
        }[kernel.name]()
        visited = empty(shape, np.uint32)
        visited.fill(0)
        enqueue(**arguments, counters=visited)
        host = visited.to_host().astype(np.uint64)
        samples, pixels = (host.sum(), 0) if kernel.name == "search" else host.sum(axis=0)
        before = self.of.get(kernel.name, Visited())
        self.of[kernel.name] = Visited(before.samples + int(samples), before.pixels + int(pixels))


@contextmanager
def counted_samples() -> Iterator[dict[str, Visited]]:
    """Yield the numbers of samples and pixels that kernels visit, separately for sweep (or search) and `resolve`."""
    counts = _Counts()
    with watching(counts):
        yield counts.of
    _require(counts.of, "neither a sweep nor a search was launched")


def _require(seen: object, otherwise: str) -> None:
    if not seen:
        raise RuntimeError(f"benchmarks: {otherwise}")
