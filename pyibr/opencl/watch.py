"""Observation of builds, uploads and launches, for benchmarks, tests and pages that show times."""

from __future__ import annotations

import math
import time
from collections import defaultdict
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from typing import Any, TypeVar


class Watch:
    """Base of observers, which intercept requests to the device. The base passes them on unchanged."""

    def build(self, name: str, defines: Mapping[str, int], make: Callable[[Mapping[str, int]], Any]) -> Any:
        """Return the kernel `name` with these defines, which `make` builds or finds."""
        return make(defines)

    def launch(
        self, kernel: Any, grid: tuple[int, ...], arguments: Mapping[str, Any], enqueue: Callable[..., None]
    ) -> None:
        """Make a launch by `enqueue(**arguments)`, which also takes further arguments of the kernel."""
        enqueue(**arguments)

    def upload(self, nbytes: int) -> None:
        """Observe that an array of `nbytes` bytes becomes an input of kernels."""

    def download(self, nbytes: int) -> None:
        """Observe a copy of `nbytes` bytes to the host."""

    def wait(self) -> None:
        """Observe that the host waits for the device."""


class Traffic(Watch):
    """Traffic between the host and the device.

    Attributes
    ----------
    of : list of (str, str, int)
        Events in order: "launch" with the kernel's name and work-items, "upload" and "download" with bytes, "wait".
    """

    def __init__(self) -> None:
        self.of: list[tuple[str, str, int]] = []

    def launch(
        self, kernel: Any, grid: tuple[int, ...], arguments: Mapping[str, Any], enqueue: Callable[..., None]
    ) -> None:
        """Make the launch in one piece, however long it takes, and record it."""
        known, kernel.cost.seconds_per_item = kernel.cost.seconds_per_item, 0.0
        enqueue(**arguments)
        kernel.cost.seconds_per_item = known
        self.of.append(("launch", kernel.name, math.prod(map(int, grid))))

    def upload(self, nbytes: int) -> None:
        """Record an upload."""
        self.of.append(("upload", "", nbytes))

    def download(self, nbytes: int) -> None:
        """Record a download."""
        self.of.append(("download", "", nbytes))

    def wait(self) -> None:
        """Record a wait."""
        self.of.append(("wait", "", 0))

    def count(self, what: str) -> int:
        """Return the number of launches, uploads, downloads or waits."""
        return sum(kind == what for kind, _, _ in self.of)

    def total(self, what: str) -> int:
        """Return the work-items of all launches, or the bytes of all uploads or downloads."""
        return sum(size for kind, _, size in self.of if kind == what)


class LaunchTimes(Watch):
    """Times of launches, measured with a wait for the queue before and after each.

    Attributes
    ----------
    of : dict
        Seconds by kernel name, one value per launch.
    """

    def __init__(self) -> None:
        self.of: dict[str, list[float]] = defaultdict(list)

    def launch(
        self, kernel: Any, grid: tuple[int, ...], arguments: Mapping[str, Any], enqueue: Callable[..., None]
    ) -> None:
        """Make the launch and time it."""
        kernel.session.wait()
        start = time.perf_counter()
        enqueue(**arguments)
        kernel.session.wait()
        self.of[kernel.name].append(time.perf_counter() - start)


_Watching = TypeVar("_Watching", bound=Watch)

watches: list[Watch] = []
"""Active observers. Only the last one is called."""


@contextmanager
def watching(watch: _Watching) -> Generator[_Watching, None, None]:
    """Let `watch` observe all kernels and launches of this process inside the ``with`` block."""
    watches.append(watch)
    try:
        yield watch
    finally:
        watches.remove(watch)
