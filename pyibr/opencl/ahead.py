"""Programs built or loaded before a picture needs them, while what comes first is done."""

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
    """A thread that does one thing after the other, and ends when there is nothing left to do."""

    def __init__(self) -> None:
        self._left: deque[Callable[[], object]] = deque()
        self._lock = threading.Lock()
        self._works = False

    def do(self, one: Callable[[], object]) -> None:
        """Do this, too."""
        with self._lock:
            self._left.append(one)
            if not self._works:
                with suppress(RuntimeError):  # the process ends: who needs it does it
                    threading.Thread(target=self._work, name="pyibr ahead").start()
                    self._works = True

    def _work(self) -> None:
        while True:
            with self._lock:
                if not self._left:
                    self._works = False
                    return
                one = self._left.popleft()
            with suppress(Exception):  # who needs it meets the same
                one()


_thread = _Thread()


def build_ahead(file: str, name: str, *, compiled: bool = False, **defines: int) -> None:
    """Have a program of pyibr's built or loaded beside this thread, which will need it in its first picture.

    A thread does so, one program after the other in the order in which they are asked for. It waits for the process
    that has tested the device, where that is there to build (`builder`).

    Parameters
    ----------
    file, name, **defines
        As of `kernel`.
    compiled : bool
        That process also compiles this kernel for its launches: one that others are launched before, and that takes
        long to compile.
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
