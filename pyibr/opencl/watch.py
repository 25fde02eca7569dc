"""Seeing what is built and launched: for benchmarks and tests."""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from typing import Any


class Watch:
    """Stands between whoever asks for a kernel, or launches one, and what is done; this one changes nothing."""

    def build(self, name: str, defines: Mapping[str, int], make: Callable[[Mapping[str, int]], Any]) -> Any:
        """The kernel `name` with these defines, which `make` builds or finds."""
        return make(defines)

    def launch(
        self, kernel: Any, grid: tuple[int, ...], arguments: Mapping[str, Any], enqueue: Callable[..., None]
    ) -> None:
        """A launch, which `enqueue(**arguments)` makes; it takes further arguments of the kernel, too."""
        enqueue(**arguments)


watches: list[Watch] = []
"""Those that are open; the last one sees everything."""


@contextmanager
def watching(watch: Watch) -> Generator[Watch, None, None]:
    """Within it, `watch` sees all kernels and launches of this process."""
    watches.append(watch)
    try:
        yield watch
    finally:
        watches.remove(watch)
