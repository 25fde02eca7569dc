"""Building and loading of programs in advance, while earlier steps of a picture run."""

from __future__ import annotations

import functools
import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from contextvars import copy_context

from pyibr.opencl.builder import builder_of
from pyibr.opencl.device import current
from pyibr.opencl.program import kernel
from pyibr.opencl.runtimes import found_devices
from pyibr.opencl.watch import watches


class _Thread:
    """A thread that makes one call after the other, and ends when none is left."""

    def __init__(self) -> None:
        self._left: deque[Callable[[], object]] = deque()
        self._lock = threading.Lock()
        self._works = False

    def do(self, one: Callable[[], object]) -> None:
        """Add a call."""
        with self._lock:
            self._left.append(one)
            if not self._works:
                with suppress(RuntimeError):  # no thread can start at the process's end; the picture builds the program
                    threading.Thread(target=self._work, name="pyibr ahead").start()
                    self._works = True

    def _work(self) -> None:
        while True:
            with self._lock:
                if not self._left:
                    self._works = False
                    return
                one = self._left.popleft()
            with suppress(Exception):  # the picture that needs the program raises the same error
                one()


_thread = _Thread()


def build_ahead(file: str, name: str, *, compiled: bool = False, **defines: int) -> None:
    """Build or load one of pyibr's programs in a thread, before the first picture needs it.

    The thread handles programs in the order of the requests. If there is a builder process (`builder`), the thread
    waits for its builds. With `compiled`, the builder process also compiles this kernel for launches: use it for a
    kernel that takes long to compile and is launched after others. Other arguments: as in `kernel`.
    """
    if watches:
        return
    session = current()
    program = file, tuple(sorted(defines.items()))
    if program in session.ahead:
        return
    session.ahead.add(program)
    known: dict[str, int] = {"LANES": session.profile.lanes, **defines}
    builder = builder_of(found_devices()[session.device.index].key)
    if builder is not None:
        builder.ask(file, name, known, compiled=compiled)
    _thread.do(functools.partial(copy_context().run, kernel, file, name, **defines))
