"""Calls of several threads on one device: who is in one, who goes first, and how all of them are awaited."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass, field

from pyibr.opencl.in_flight import InFlight

_AHEAD_SECONDS = 0.05  # seconds that a long call leaves the device to one that began later
_GAP = 1e-3  # seconds between looks at calls that are awaited


@dataclass(eq=False)
class _Call:
    number: int  # calls that began later have greater ones
    in_flight: InFlight
    going_on: threading.Lock = field(default_factory=threading.Lock)  # held until it has ended

    def wait(self, seconds: float) -> None:
        """Until it has ended, for so long at most."""
        if self.going_on.acquire(timeout=seconds):
            self.going_on.release()


class Calls:
    """The calls in progress on a device, one a thread."""

    def __init__(self) -> None:
        self._running: dict[int, _Call] = {}
        self._numbers = itertools.count(1)
        self._gate = threading.RLock()

    @property
    def others(self) -> list[_Call]:
        """Those of other threads."""
        me = threading.get_ident()
        return [call for thread, call in list(self._running.items()) if thread != me]

    @contextmanager
    def one(self, in_flight: InFlight, wait: Callable[[], None]) -> Generator[None, None, None]:
        """Be in a call of this thread, which has that in flight; one within another is a part of that.

        If it fails, it is waited for: it may not have asked for its results.
        """
        me = threading.get_ident()
        within = me in self._running
        try:
            if not within:
                call = _Call(next(self._numbers), in_flight)
                call.going_on.acquire()
                with self._gate:
                    self._running[me] = call
            yield
        except BaseException:
            wait()
            raise
        finally:
            ended = None if within else self._running.pop(me, None)
            if ended is not None:
                ended.going_on.release()

    def let_others(self) -> None:
        """Let calls that began after this thread's and wait for the device end first: once, and only short ones."""
        mine = self._running.get(threading.get_ident())
        if mine is None:
            return
        for other in self.others:
            if other.number > mine.number and other.in_flight.used:
                other.wait(_AHEAD_SECONDS)
                mine.number = max(mine.number, other.number)

    def stop(self, end: float) -> threading.RLock | None:
        """Wait until no other thread is in a call, until `end` by `time.monotonic`, and let no further one begin.

        Returns the lock to let go of for calls to go on; None if even that was not to be had.
        """
        if not self._gate.acquire(timeout=max(0.0, end - time.monotonic())):
            return None
        while self.others and time.monotonic() < end:
            time.sleep(_GAP)
        return self._gate
