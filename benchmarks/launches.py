"""What single launches of a warp cost, and how many samples they visit.

`pyibr.warp` looks up `launch` and `kernel` when it is called: while these contexts are open it finds others
in their place, which do the same with the same arguments and take notes.
"""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from unittest import mock

import numpy as np

from pyibr.opencl import launch as launching
from pyibr.opencl import program
from pyibr.opencl.memory import empty

COUNTED = {"search": "warp/search.cl", "epipolar_sweep": "warp/epipolar.cl"}


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
def counted_samples() -> Iterator[dict[str, int]]:
    """Yields what the sweep and the search visit: "samples" of the source and "pixels" of the target."""
    counts: dict[str, int] = {}
    launch = launching.launch

    def counting(kernel: program.Kernel, grid: tuple[int, ...], **arguments: Any) -> None:
        file = COUNTED.get(kernel.name)
        if file is None:
            return launch(kernel, grid, **arguments)
        sweep = kernel.name == "epipolar_sweep"
        target = arguments["map"].values
        shape = (arguments["packet_count"], 2) if sweep else (int(target["dst_height"]), int(target["dst_width"]))
        visited = empty(shape, np.uint32)
        visited.fill(0)
        counter = program.kernel(file, kernel.name, COUNT_SAMPLES=1)
        launch(counter, grid, **arguments, counts=visited)
        host = visited.to_host().astype(np.uint64)
        samples, pixels = (host[:, 0].sum(), host[:, 1].sum()) if sweep else (host.sum(), host.size)
        counts["samples"] = counts.get("samples", 0) + int(samples)
        counts["pixels"] = counts.get("pixels", 0) + int(pixels)
        return None

    with mock.patch.object(launching, "launch", counting):
        yield counts
    _require(counts, "neither a sweep nor a search was launched")


def _require(seen: object, otherwise: str) -> None:
    """A context that sees nothing means that `pyibr.warp` takes its launches from elsewhere now."""
    if not seen:
        raise RuntimeError(f"benchmarks/launches.py: {otherwise}")
