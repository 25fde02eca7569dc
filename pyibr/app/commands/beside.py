"""Work beside the device: frames are read ahead, and written while the next ones are drawn."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextvars import copy_context
from typing import TypeVar, cast

_Thing = TypeVar("_Thing")

_AHEAD = 2  # frames: of more, none comes sooner
_BEHIND = 4
_WRITERS = 2  # what packs pictures leaves Python's lock
_END = object()


def read_ahead(things: Iterable[_Thing]) -> Iterator[_Thing]:
    """The things, one after the other, which a thread of their own makes while the last ones are used."""
    source, waiting = iter(things), deque[Future[object]]()
    context = copy_context()  # in which the device may have been chosen
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
    """Calls that threads do meanwhile, a few at a time; the first error of one is raised by a later one, or at the end.

    in_order: whether one must be done before the next begins.
    """

    def __init__(self, in_order: bool) -> None:
        self._pool = ThreadPoolExecutor(1 if in_order else _WRITERS)
        self._waiting = deque[Future[object]]()

    def add(self, call: Callable[[], object]) -> None:
        """Have it done."""
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
