"""Seeing what is built, uploaded and launched: for benchmarks, tests and pages that show where the time goes."""

from __future__ import annotations

import math
import time
from collections import defaultdict
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from typing import Any, TypeVar


class Watch:
    """Stands between whoever asks the device for something and what is done; this one changes nothing."""

    def build(self, name: str, defines: Mapping[str, int], make: Callable[[Mapping[str, int]], Any]) -> Any:
        """The kernel `name` with these defines, which `make` builds or finds."""
        return make(defines)

    def launch(
        self, kernel: Any, grid: tuple[int, ...], arguments: Mapping[str, Any], enqueue: Callable[..., None]
    ) -> None:
        """A launch, which `enqueue(**arguments)` makes; it takes further arguments of the kernel, too."""
        enqueue(**arguments)

    def upload(self, nbytes: int) -> None:
        """An array of so many bytes becomes an input of kernels."""

    def download(self, nbytes: int) -> None:
        """So many bytes are to be copied to the host."""

    def wait(self) -> None:
        """The host waits for the device."""


class Traffic(Watch):
    """Traffic between the host and the device.

    Attributes
    ----------
    of : list of (str, str, int)
        In order: "launch" with the kernel's name and its work-items, "upload" and "download" with bytes, "wait".
    """

    def __init__(self) -> None:
        self.of: list[tuple[str, str, int]] = []

    def launch(
        self, kernel: Any, grid: tuple[int, ...], arguments: Mapping[str, Any], enqueue: Callable[..., None]
    ) -> None:
        """Make the launch, in one piece however long it takes here, and note it."""
        known, kernel.cost.seconds_per_item = kernel.cost.seconds_per_item, 0.0
        enqueue(**arguments)
        kernel.cost.seconds_per_item = known
        self.of.append(("launch", kernel.name, math.prod(map(int, grid))))

    def upload(self, nbytes: int) -> None:
        """Note it."""
        self.of.append(("upload", "", nbytes))

    def download(self, nbytes: int) -> None:
        """Note it."""
        self.of.append(("download", "", nbytes))

    def wait(self) -> None:
        """Note it."""
        self.of.append(("wait", "", 0))

    def count(self, what: str) -> int:
        """Number of launches, uploads, downloads or waits."""
        return sum(kind == what for kind, _, _ in self.of)

    def total(self, what: str) -> int:
        """Work-items of all launches, or bytes of all uploads or downloads."""
        return sum(size for kind, _, size in self.of if kind == what)


class LaunchTimes(Watch):
    """Times of launches; the queue is awaited before and after each.

    Attributes
    ----------
    of : dict
        Seconds by kernel, one value a launch.
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
"""Those that are open; the last one sees everything."""


@contextmanager
def watching(watch: _Watching) -> Generator[_Watching, None, None]:
    """Within it, `watch` sees all kernels and launches of this process."""
    watches.append(watch)
    try:
        yield watch
    finally:
        watches.remove(watch)
