"""Work in parallel with the device: frames are read ahead, and written while later frames are drawn."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextvars import copy_context
from typing import TypeVar, cast

_Thing = TypeVar("_Thing")

_AHEAD = 2  # frames; reading farther ahead brings no speed
_BEHIND = 4
_WRITERS = 2  # encoding pictures releases Python's lock
_END = object()


def read_ahead(things: Iterable[_Thing]) -> Iterator[_Thing]:
    """Yield the items in order; a thread of its own makes the next items while the last ones are used."""
    source, waiting = iter(things), deque[Future[object]]()
    context = copy_context()  # the device may have been chosen in it
    pool = ThreadPoolExecutor(1)
    try:
        while True:
            while len(waiting) < _AHEAD:
                waiting.append(pool.submit(context.run, next, source, _END))  # pyright: ignore[reportArgumentType]
            thing = waiting.popleft().result()
            if thing is _END:
                return
            yield cast("_Thing", thing)
    finally:
        pool.shutdown(cancel_futures=True)


class Behind:
    """Calls that run in threads, a few at a time; a later `add`, or the end, raises the first error.

    in_order: whether each call must end before the next begins.
    """

    def __init__(self, in_order: bool) -> None:
        self._pool = ThreadPoolExecutor(1 if in_order else _WRITERS)
        self._waiting = deque[Future[object]]()

    def add(self, call: Callable[[], object]) -> None:
        """Queue a call; wait while the queue is full."""
        while len(self._waiting) >= _BEHIND:
            self._waiting.popleft().result()
        self._waiting.append(self._pool.submit(copy_context().run, call))

    def __enter__(self) -> Behind:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            while self._waiting and kind is None:
                self._waiting.popleft().result()
        finally:
            self._pool.shutdown(cancel_futures=True)
