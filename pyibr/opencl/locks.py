"""A call that takes long lets others have their turn between its pieces."""

from __future__ import annotations

import threading
import time

_GAP = 5e-4  # seconds: who sleeps until a lock is free wakes up in a tenth of that


def yield_lock(lock: threading.RLock) -> None:
    """Let go of a lock until whoever waits has had it. Ctrl-C counts once it is back.

    Who holds it twice keeps it, and who does not hold it at all, since nobody else makes launches, goes without it.
    """
    if not _is_held(lock):
        return
    interrupted: BaseException | None = None
    try:
        lock.release()
        time.sleep(_GAP)
        lock.acquire()
    except BaseException as error:
        interrupted = error
    while not _is_held(lock):
        try:
            lock.acquire()
        except BaseException as error:
            interrupted = error
    if interrupted is not None:
        raise interrupted


def _is_held(lock: threading.RLock) -> bool:
    """Tell whether this thread holds it."""
    return lock._is_owned()  # pyright: ignore
