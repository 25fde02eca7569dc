"""What single launches of a warp cost, and how many samples they visit.

`pyibr.warp` looks up `launch` and `kernel` when it is called: while these contexts are open it finds others
in their place, which do the same with the same arguments and take notes.
"""

from __future__ import annotations

import math
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any
from unittest import mock

import numpy as np

from pyibr.opencl import launch as launching
from pyibr.opencl import program
from pyibr.opencl.memory import empty

COUNTED = ("epipolar_sweep", "search", "resolve")


@dataclass(frozen=True)
class Visited:
    """What launches of a kernel visited.

    Attributes
    ----------
    samples : int
        Steps along epipolar lines in the source: samples or cells. A packet of lanes takes as many as its slowest.
    pixels : int
        Of the target: those that the sweep settles, those that `resolve` traces once more; of a search none.
    """

    samples: int = 0
    pixels: int = 0


@contextmanager
def kernel_times() -> Iterator[dict[str, list[float]]]:
    """Yields milliseconds by kernel, one value a launch; the queue is awaited before and after each."""
    times: dict[str, list[float]] = defaultdict(list)
    launch = launching.launch

    def timed(kernel: program.Kernel, grid: tuple[int, ...], **arguments: Any) -> None:
        kernel.session.queue.finish()
        start = time.perf_counter()
        launch(kernel, grid, **arguments)
        kernel.session.queue.finish()
        times[kernel.name].append(1e3 * (time.perf_counter() - start))

    with mock.patch.object(launching, "launch", timed):
        yield times
    _require(times, "no launch was seen")


@contextmanager
def build_times() -> Iterator[dict[str, float]]:
    """Yields milliseconds that kernels took to be there, built or loaded; a kernel's first call."""
    times: dict[str, float] = {}
    kernel = program.kernel

    def timed(file: str, name: str, **defines: int) -> program.Kernel:
        start = time.perf_counter()
        found = kernel(file, name, **defines)
        times.setdefault(name, 1e3 * (time.perf_counter() - start))
        return found

    with mock.patch.object(program, "kernel", timed):
        yield times
    _require(times, "no kernel was asked for")


@contextmanager
def counted_samples() -> Iterator[dict[str, Visited]]:
    """Yields by kernel what a whole call visits: the sweep or the search, and `resolve`."""
    counts: dict[str, Visited] = {}
    kernel, launch = program.kernel, launching.launch

    def with_counts(file: str, name: str, **defines: int) -> program.Kernel:
        return kernel(file, name, **defines, **({"COUNTED": 1} if name in COUNTED else {}))

    def counting(kernel: program.Kernel, grid: tuple[int, ...], **arguments: Any) -> None:
        if kernel.name not in COUNTED:
            return launch(kernel, grid, **arguments)
        target = arguments["map"].values
        shape = {
            "epipolar_sweep": lambda: (arguments["packet_count"], 2),
            "search": lambda: (int(target["dst_height"]), -(-int(target["dst_width"]) // kernel.session.lanes)),
            "resolve": lambda: (math.prod(grid), 2),
        }[kernel.name]()
        visited = empty(shape, np.uint32)
        visited.fill(0)
        launch(kernel, grid, **arguments, counts=visited)
        host = visited.to_host().astype(np.uint64)
        samples, pixels = (host.sum(), 0) if kernel.name == "search" else host.sum(axis=0)
        before = counts.get(kernel.name, Visited())
        counts[kernel.name] = Visited(before.samples + int(samples), before.pixels + int(pixels))
        return None

    with mock.patch.object(program, "kernel", with_counts), mock.patch.object(launching, "launch", counting):
        yield counts
    _require(counts, "neither a sweep nor a search was launched")


def _require(seen: object, otherwise: str) -> None:
    """A context that sees nothing means that `pyibr.warp` takes its launches from elsewhere now."""
    if not seen:
        raise RuntimeError(f"benchmarks/launches.py: {otherwise}")
