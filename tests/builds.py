"""A record of the kernels that are requested while pictures are drawn."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from pyibr.opencl.watch import Watch


class Builds(Watch):
    """Kernels that were requested, each with its defines, whether or not they were built before."""

    def __init__(self) -> None:
        self.of: set[tuple[object, ...]] = set()

    def build(self, name: str, defines: Mapping[str, int], make: Callable[[Mapping[str, int]], Any]) -> Any:
        """Note a kernel's name and defines, then build it."""
        self.of.add((name, *sorted(defines.items())))
        return make(defines)
