"""Work in flight on a queue, and its expected time: nobody can stop what the device has been given."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pyopencl as cl

UNSPLIT_SECONDS = 0.005  # seconds that a launch may take, by what its kernel took before, to be one piece
QUEUED_SECONDS_MAX = 0.04  # seconds of launches that may wait in the queue
PIECE_SECONDS = 0.06  # seconds that a piece of a launch is meant to take
SHARED_PIECE_SECONDS = 0.02  # the same while other threads are in calls
_GROWTH = 4  # at most, from piece to piece: what comes next may take longer
_SHORT, _GROWTH_OF_SHORT = 0.0005, 32  # seconds of a piece, and growth after it: the next is no long one, even so
_FORGETTING = 0.9  # of what is known, by each launch: the same kernel may have much to do in every tenth
_UNEXPECTED = 4  # times as long as expected: what was expected is wrong


@dataclass(eq=False)
class KernelCost:
    """Cost of a kernel's launches so far.

    Attributes
    ----------
    seconds_per_item : float
        Seconds that a work-item took, on average, in the slowest launch of late; infinite as long as nobody knows.
    """

    seconds_per_item: float = math.inf

    def add(self, seconds_per_item: float) -> None:
        """A launch took so long: those to come may be as slow as that, or as some before it."""
        known = self.seconds_per_item if math.isfinite(self.seconds_per_item) else 0.0
        self.seconds_per_item = max(seconds_per_item, _FORGETTING * known)

    def piece_after(self, items: int, seconds: float, shared: bool) -> int:
        """Work-items of the next piece, after one of so many that took so long; 0 before the first."""
        if not items:
            return max(int(UNSPLIT_SECONDS / self.seconds_per_item), 1)
        slowest = max(seconds / items, self.seconds_per_item if math.isfinite(self.seconds_per_item) else 0.0)
        growth = _GROWTH if seconds > _SHORT else _GROWTH_OF_SHORT
        return max(int(min((SHARED_PIECE_SECONDS if shared else PIECE_SECONDS) / slowest, growth * items)), 1)


class InFlight:
    """A thread's launches in flight.

    Attributes
    ----------
    used : list
        What it reads and writes: that must stay until it is done.
    seconds : float
        How long it takes, as far as is known.
    """

    def __init__(self) -> None:
        self.used: list[object] = []
        self.seconds = 0.0
        self._launches: list[tuple[KernelCost, int, cl.Event]] = []

    def add(self, cost: KernelCost, items: int, event: cl.Event) -> None:
        """A launch of so many work-items joins."""
        self._launches.append((cost, items, event))
        self.seconds += items * cost.seconds_per_item

    def finish(self, waited: float) -> None:
        """All of it is done; `waited` seconds for that. Launches that took far longer than expected are slower."""
        for cost, items, event in self._launches if waited > QUEUED_SECONDS_MAX else ():
            slow = seconds_of(event) / items
            if slow > _UNEXPECTED * cost.seconds_per_item:
                cost.add(slow)
        self.used.clear()
        self._launches.clear()
        self.seconds = 0.0


def seconds_of(event: cl.Event) -> float:
    """Seconds that the device took for a command, whatever else waited in the queue."""
    return 1e-9 * (event.profile.end - event.profile.start)


def piece_of(grid: Sequence[int], done: int, items_max: int) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Offset and size of the next piece of a grid of which so many work-items are done: whole rows, or within one.

    A row is what `items_max` work-items make none of: of one axis, or of several.
    """
    *inner, last = grid
    row = math.prod(inner)
    at, inside = divmod(done, row)
    if inside or items_max < row:
        offset, size = piece_of(inner, inside, items_max)
        return (*offset, at), (*size, 1)
    return (0,) * len(inner) + (at,), (*inner, min(items_max // row, last - at))
