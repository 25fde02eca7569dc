"""Launches in flight on a queue, and their expected time. Commands in a queue cannot be stopped."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pyopencl as cl

UNSPLIT_SECONDS = 0.005  # longest expected time of a launch that is not split
QUEUED_SECONDS_MAX = 0.04  # longest expected time of all launches in the queue together
PIECE_SECONDS = 0.06  # target time of a piece of a launch
SHARED_PIECE_SECONDS = 0.02  # target time while other threads are in calls
_GROWTH = 4  # a piece has at most this multiple of the previous piece's items, as its items may be slower
_SHORT, _GROWTH_OF_SHORT = 0.0005, 32  # after pieces up to _SHORT seconds, the growth may be larger
_FORGETTING = 0.9  # decay of the known cost per launch: a kernel may be slow only in every tenth launch
_UNEXPECTED = 4  # launches that take this multiple of the expected time update the estimate


@dataclass(eq=False)
class KernelCost:
    """Cost of a kernel's launches so far."""

    seconds_per_item: float = math.inf  # mean over the items of the slowest recent launch; infinite while unknown

    def add(self, seconds_per_item: float) -> None:
        """Add the cost of a launch. The estimate is the maximum of this cost and of earlier costs, which decay."""
        known = self.seconds_per_item if math.isfinite(self.seconds_per_item) else 0.0
        self.seconds_per_item = max(seconds_per_item, _FORGETTING * known)

    def piece_after(self, items: int, seconds: float, shared: bool) -> int:
        """Return the number of work-items of the next piece.

        items, seconds: work-items and time of the previous piece; 0 items before the first. shared: whether other
        threads are in calls.
        """
        if not items:
            return max(int(UNSPLIT_SECONDS / self.seconds_per_item), 1)
        slowest = max(seconds / items, self.seconds_per_item if math.isfinite(self.seconds_per_item) else 0.0)
        growth = _GROWTH if seconds > _SHORT else _GROWTH_OF_SHORT
        return max(int(min((SHARED_PIECE_SECONDS if shared else PIECE_SECONDS) / slowest, growth * items)), 1)


class InFlight:
    """A thread's launches in flight."""

    def __init__(self) -> None:
        self.used: list[object] = []  # buffers that the launches use, kept alive until they finish
        self.seconds = 0.0  # expected time of the launches
        self._launches: list[tuple[KernelCost, int, cl.Event]] = []

    def add(self, cost: KernelCost, items: int, event: cl.Event) -> None:
        """Add a launch of `items` work-items."""
        self._launches.append((cost, items, event))
        self.seconds += items * cost.seconds_per_item

    def finish(self, waited: float) -> None:
        """Clear the finished launches after a wait of `waited` seconds, and raise estimates that were far too low."""
        for cost, items, event in self._launches if waited > QUEUED_SECONDS_MAX else ():
            slow = seconds_of(event) / items
            if slow > _UNEXPECTED * cost.seconds_per_item:
                cost.add(slow)
        self.used.clear()
        self._launches.clear()
        self.seconds = 0.0


def seconds_of(event: cl.Event) -> float:
    """Return the seconds that the device took for a command, without time in the queue."""
    return 1e-9 * (event.profile.end - event.profile.start)


def piece_of(grid: Sequence[int], done: int, items_max: int) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return the offset and size of the next piece of a grid, after `done` work-items.

    A piece is a number of whole slices along the last axis. If a slice has more than `items_max` work-items, the piece
    lies within one slice.
    """
    *inner, last = grid
    row = math.prod(inner)
    at, inside = divmod(done, row)
    if inside or items_max < row:
        offset, size = piece_of(inner, inside, items_max)
        return (*offset, at), (*size, 1)
    return (0,) * len(inner) + (at,), (*inner, min(items_max // row, last - at))
