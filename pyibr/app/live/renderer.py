"""One thread that draws the latest request of each of several clients, and drops older requests."""

from __future__ import annotations

import contextvars
import threading
import time
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import Generic, TypeVar

_Request = TypeVar("_Request")
_Result = TypeVar("_Result")


@dataclass
class _Client(Generic[_Request]):
    """Pending requests of a client."""

    newest: _Request | None = None  # request to draw as soon as it is this client's turn
    rested: _Request | None = None  # last request, to draw in full if no newer request comes for a while
    due: float = 0.0  # time of the full drawing, by `time.monotonic`
    used: float = 0.0  # seconds of device time used; the client with the least comes next


class Renderer(Generic[_Request, _Result]):
    """Draws requests on a thread of its own and delivers the results.

    A client has one request: a newer request replaces it, however long drawing takes. If a client's last request rests
    for a while, it is drawn again, in full. Clients get equal shares of the time. The thread keeps the device that is
    selected when the renderer is made.

    Parameters
    ----------
    draw : callable (request, full) -> result
    deliver : callable (request, full, result)
        Called on the same thread, in the order of drawing. Not called if the client has left, or if a full drawing is
        outdated by a newer request.
    failed : callable (request, exception)
        Called if drawing or delivering raises the exception.
    rest : float
        Seconds without a new request until a full drawing.
    """

    def __init__(
        self,
        draw: Callable[[_Request, bool], _Result],
        deliver: Callable[[_Request, bool, _Result], None],
        failed: Callable[[_Request, Exception], None],
        rest: float = 0.2,
    ) -> None:
        self._draw, self._deliver, self._failed, self._rest = draw, deliver, failed, rest
        self._clients: dict[Hashable, _Client[_Request]] = {}
        self._changed = threading.Condition()
        self._closed = False
        self.dropped = 0
        """Number of requests that were replaced before they were drawn."""
        context = contextvars.copy_context()  # `use_device` applies to the thread that calls it
        self._thread = threading.Thread(target=context.run, args=(self._run,), name="pyibr-renderer", daemon=True)
        self._thread.start()

    def ask(self, client: Hashable, request: _Request, at_once: bool = True) -> None:
        """Set the client's latest request; without `at_once`, it is only drawn in full, without waiting for a rest."""
        with self._changed:
            if self._closed:
                return
            known = self._clients.setdefault(client, _Client())
            if known.newest is None and known.rested is None:
                # A new or idle client gets no extra share for the time in which it asked for nothing.
                busy = [other.used for other in self._clients.values() if other is not known]
                known.used = max(known.used, min(busy, default=0.0))
            self.dropped += known.newest is not None
            known.newest = request if at_once else None
            known.rested = request
            known.due = time.monotonic() + (self._rest if at_once else 0.0)
            self._changed.notify()

    def leave(self, client: Hashable) -> None:
        """Forget a client: drop its requests, and do not deliver its current drawing."""
        with self._changed:
            self._clients.pop(client, None)

    @property
    def clients(self) -> list[Hashable]:
        """Clients that have made requests and have not left."""
        with self._changed:
            return list(self._clients)

    @property
    def waiting(self) -> int:
        """Number of requests waiting to be drawn: at most one for each client."""
        with self._changed:
            return sum(known.newest is not None for known in self._clients.values())

    def close(self, seconds: float = 10.0) -> None:
        """Stop drawing; wait at most `seconds` for the current drawing."""
        with self._changed:
            self._closed = True
            self._clients.clear()
            self._changed.notify()
        if threading.current_thread() is not self._thread:
            self._thread.join(seconds)

    def _run(self) -> None:
        while (turn := self._next()) is not None:
            client, request, full = turn
            start = time.monotonic()
            try:
                result = self._draw(request, full)
                with self._changed:  # a full drawing is outdated if the next request already waits
                    known = self._clients.get(client)
                    is_wanted = known is not None and not (full and known.rested is not None)
                if is_wanted:
                    self._deliver(request, full, result)
            except Exception as error:  # an error of one page must not end the other pages
                self._failed(request, error)
            seconds = time.monotonic() - start
            with self._changed:
                if client in self._clients:
                    self._clients[client].used += seconds

    def _next(self) -> tuple[Hashable, _Request, bool] | None:
        """Wait for the next client and its request; None once the renderer is closed."""
        with self._changed:
            while not self._closed:
                now = time.monotonic()
                ready = [
                    (known.used, number, client)
                    for number, (client, known) in enumerate(self._clients.items())
                    if known.newest is not None or (known.rested is not None and known.due <= now)
                ]
                if ready:
                    client = min(ready)[2]
                    known = self._clients[client]
                    if known.newest is not None:
                        request, known.newest = known.newest, None
                        return client, request, False
                    request, known.rested = known.rested, None
                    assert request is not None
                    return client, request, True
                due = min((known.due for known in self._clients.values() if known.rested is not None), default=None)
                self._changed.wait(None if due is None else max(due - now, 0.0))
            return None
