"""Makes a call's launches under Oclgrind, which counts instructions. `benchmarks.gpu.gpu` starts this as a process.

Each launch is split into pieces of 1 and of 61 work-items, in turns, so that some work-items are counted alone.
"""

from __future__ import annotations

import ctypes
import math
import sys
from collections.abc import Callable, Mapping
from typing import Any

from benchmarks.gpu.calls import CALLS
from benchmarks.results import Skip
from pyibr.opencl.in_flight import KernelCost
from pyibr.opencl.watch import Watch, watching

LAUNCH, PIECE = "=== launch", "=== piece"
_SOME = 61  # work-items between two that are counted alone; a prime, so that the latter lie in all columns of a picture


def _say(*words: object) -> None:
    """Print after all that Oclgrind has printed so far."""
    ctypes.CDLL(None).fflush(None)
    print(*words, flush=True)


class _InPieces(Watch):
    def launch(
        self, kernel: Any, grid: tuple[int, ...], arguments: Mapping[str, Any], enqueue: Callable[..., None]
    ) -> None:
        _say(LAUNCH, kernel.name, math.prod(map(int, grid)))
        kernel.cost.seconds_per_item = math.inf
        enqueue(**arguments)


def _piece_after(self: KernelCost, items: int, seconds: float, shared: bool) -> int:
    size = _SOME if items == 1 else 1
    _say(PIECE, size)
    return size


def main(name: str, size: tuple[int, int]) -> None:
    """Make the call twice; only the second one is counted."""
    work = CALLS[name](size)
    assert not isinstance(work, Skip)
    work()
    KernelCost.piece_after = _piece_after
    with watching(_InPieces()):
        work()
    _say(LAUNCH, "end", 0)


if __name__ == "__main__":
    called, width, height = sys.argv[1:]
    main(called, (int(width), int(height)))
