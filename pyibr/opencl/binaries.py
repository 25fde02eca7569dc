"""Program binaries for the cache: read immediately if the runtime has them, otherwise in idle time.

Before it returns a binary, PoCL compiles every kernel of the program again, for work-groups of any size; that takes too
long for a first picture. So a thread reads binaries after the first picture. The next process builds the programs that
were not read before the end of this one again, with help from PoCL's own cache of kernels.
"""

from __future__ import annotations

import ctypes
import functools
import os
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING, NamedTuple, cast

from pyibr.core.errors import ArgumentError
from pyibr.opencl.cache import Entry
from pyibr.opencl.calls import Calls

if TYPE_CHECKING:
    import pyopencl as cl

VARIABLE = "PYIBR_BINARIES"
_CHOICES = ("later", "now", "never")
_QUIET = 1.0  # seconds without a build or a call before binaries are read
_NICE = 10  # added to the thread's nice value

reading = threading.RLock()
"""Held while a binary is read: the end or a fork of the process waits for it."""


class _Waiting(NamedTuple):
    program: cl.Program
    entry: Entry
    head: bytes
    calls: Calls


_waiting: deque[_Waiting] = deque()
_changed = threading.Condition()
_last_build = 0.0
_thread: threading.Thread | None = None


def keep_binary(program: cl.Program, entry: Entry, head: bytes, compiles_for_it: bool, calls: Calls) -> None:
    """Put a program that was just built into the cache, now, later or never, according to ``$PYIBR_BINARIES``.

    Parameters
    ----------
    program : pyopencl.Program
        The program.
    entry : Entry
        Cache entry for the binary.
    head : bytes
        Data before the binary in the entry.
    compiles_for_it : bool
        Whether the runtime compiles again to return a binary. If so, the default is "later", otherwise "now".
    calls : Calls
        Calls in progress; binaries are read between them.

    Raises
    ------
    ArgumentError
        The variable has another value.
    """
    chosen = os.environ.get(VARIABLE) or ("later" if compiles_for_it else "now")
    if chosen not in _CHOICES:
        raise ArgumentError(f"${VARIABLE}", f"one of {', '.join(_CHOICES)}", repr(chosen))
    if chosen == "now":
        _keep(program, entry, head)
    elif chosen == "later":
        _keep_later(_Waiting(program, entry, head, calls))


def read_all(progress: Callable[[int, int], object]) -> None:
    """Read all binaries that are still waiting; `progress` gets the number that are left, and the total."""
    total = len(_waiting)
    progress(total, total)
    while _keep_next():
        progress(len(_waiting), total)


def forget_all() -> None:
    """Forget waiting binaries in a forked process, which has neither the thread nor the runtime."""
    global _thread
    _waiting.clear()
    _thread = None


def _keep_later(one: _Waiting) -> None:
    global _last_build, _thread
    with _changed:
        _waiting.append(one)
        _last_build = time.monotonic()
        if _thread is None:
            _thread = threading.Thread(target=_read_when_quiet, name="pyibr binaries", daemon=True)
            _thread.start()
        _changed.notify()


def _read_when_quiet() -> None:
    with suppress(AttributeError, OSError):  # on Linux, each thread has its own priority
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _NICE)
    while True:
        with _changed:
            _changed.wait_for(lambda: len(_waiting) > 0)
            left = _last_build + _QUIET - time.monotonic()
            calls = _waiting[0].calls
        if left <= 0 and not calls.others:
            _keep_next()
        else:
            time.sleep(max(left, _QUIET / 4))


def _keep_next() -> bool:
    """Store the binary of the program that has waited longest; False if there is none."""
    with reading:
        with _changed:
            if not _waiting:
                return False
            one = _waiting.popleft()
        _keep(one.program, one.entry, one.head)
        return True


def _keep(program: cl.Program, entry: Entry, head: bytes) -> None:
    if binary := _binary_of(program):  # some runtimes have no binaries
        entry.write(head + binary)


def _binary_of(program: cl.Program) -> bytes:
    """The binary, read without the GIL, which pyopencl would hold while the runtime compiles."""
    import pyopencl as cl

    info = _program_info()
    if info is None:
        return cast("list[bytes]", program.get_info(cl.program_info.BINARIES))[0]
    handle, size = ctypes.c_void_p(program.int_ptr), ctypes.c_size_t()
    if info(handle, cl.program_info.BINARY_SIZES, ctypes.sizeof(size), ctypes.byref(size), None) or not size.value:
        return b""
    binary = ctypes.create_string_buffer(size.value)
    pointer = ctypes.pointer(binary)
    if info(handle, cl.program_info.BINARIES, ctypes.sizeof(pointer), ctypes.byref(pointer), None):
        return b""
    return binary.raw


@functools.cache
def _program_info() -> Callable[..., int] | None:
    """``clGetProgramInfo`` of the loader that pyopencl is linked with; None if it is not found there."""
    import pyopencl._cl as module

    try:
        function = ctypes.CDLL(module.__file__).clGetProgramInfo
    except (AttributeError, OSError):
        return None
    function.argtypes = [ctypes.c_void_p, ctypes.c_uint32, ctypes.c_size_t, ctypes.c_void_p, ctypes.c_void_p]
    function.restype = ctypes.c_int32
    return function
