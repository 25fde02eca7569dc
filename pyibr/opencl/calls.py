"""Calls of several threads on one device: their order, and waits for their end."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass, field

from pyibr.opencl.in_flight import InFlight

_AHEAD_SECONDS = 0.05  # seconds that a long call waits for a call that began later
_GAP = 1e-3  # seconds between checks for the end of calls


@dataclass(eq=False)
class _Call:
    number: int  # increases with the start of calls
    in_flight: InFlight
    going_on: threading.Lock = field(default_factory=threading.Lock)  # held until the call ends

    def wait(self, seconds: float) -> None:
        """Wait until the call ends, or for `seconds`."""
        if self.going_on.acquire(timeout=seconds):
            self.going_on.release()


class Calls:
    """The calls in progress on a device, one per thread."""

    def __init__(self) -> None:
        self._running: dict[int, _Call] = {}
        self._numbers = itertools.count(1)
        self._gate = threading.RLock()

    @property
    def others(self) -> list[_Call]:
        """Calls of other threads."""
        me = threading.get_ident()
        return [call for thread, call in list(self._running.items()) if thread != me]

    @contextmanager
    def one(self, in_flight: InFlight, wait: Callable[[], None]) -> Generator[None, None, None]:
        """Enter a call of this thread, with its launches in flight. A nested call is a part of the outer call.

        If the call fails, wait for its launches, as it may not have waited for its results.
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
        """Wait for later calls that use the device: for each only once, and at most `_AHEAD_SECONDS`."""
        mine = self._running.get(threading.get_ident())
        if mine is None:
            return
        for other in self.others:
            if other.number > mine.number and other.in_flight.used:
                other.wait(_AHEAD_SECONDS)
                mine.number = max(mine.number, other.number)

    def stop(self, end: float) -> threading.RLock | None:
        """Block new calls, and wait until no other thread is in a call, or until `time.monotonic()` reaches `end`.

        Returns the lock whose release lets calls start again; None if it could not be acquired in time.
        """
        if not self._gate.acquire(timeout=max(0.0, end - time.monotonic())):
            return None
        while self.others and time.monotonic() < end:
            time.sleep(_GAP)
        return self._gate
