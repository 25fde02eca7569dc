"""Work in flight on a queue, and its expected time: nobody can stop what the device has been given."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

UNSPLIT_SECONDS = 0.005  # seconds that a launch may take, by what its kernel took before, to be one piece
QUEUED_SECONDS_MAX = 0.04  # seconds of launches that may wait in the queue
PIECE_SECONDS = 0.06  # seconds that a piece of a launch is meant to take
_GROWTH = 4  # at most, from piece to piece: what comes next may take longer
_UNEXPECTED = 4  # times as long as expected: what was expected is wrong


@dataclass(eq=False)
class KernelCost:
    """Cost of a kernel's launches so far.

    Attributes
    ----------
    seconds_per_item : float
        Seconds that a work-seconds_per_item took, on average; infinite as long as nobody knows.
    """

    seconds_per_item: float = math.inf

    def piece_after(self, items: int, seconds: float) -> int:
        """Work-items of the next piece, after one of so many that took so long; 0 before the first."""
        if not items:
            return max(int(UNSPLIT_SECONDS / self.seconds_per_item), 1)
        slowest = max(seconds / items, self.seconds_per_item if math.isfinite(self.seconds_per_item) else 0.0)
        return max(int(min(PIECE_SECONDS / slowest, _GROWTH * items)), 1)


class InFlight:
    """Launches in flight.

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
        self._costs: set[KernelCost] = set()  # of a kernel that is in flight several times, one

    def add(self, used: object, cost: KernelCost, seconds: float) -> None:
        """A launch joins."""
        self.used.append(used)
        self.seconds += seconds
        self._costs.add(cost)

    def finish(self, waited: float) -> None:
        """All of it is done; `waited` seconds for that. Whose launches took far longer than expected is slower."""
        if waited > QUEUED_SECONDS_MAX and waited > _UNEXPECTED * self.seconds > 0:
            for cost in self._costs:
                cost.seconds_per_item *= waited / self.seconds
        self.used.clear()
        self._costs.clear()
        self.seconds = 0.0


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
