"""Programs' binaries for the cache: read at once where a runtime has them, else when nobody waits.

PoCL compiles every kernel of a program once more, for work-groups of any size, before it hands out its binary; that
takes longer than a first picture should. So a thread asks for it after the first picture. What it has not read when the
process ends is built again by the next one, for which PoCL keeps kernels of its own.
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
_QUIET = 1.0  # seconds without a build or a call, after which nobody waits for a picture
_NICE = 10  # how much less the thread counts than others that want the processor

reading = threading.RLock()
"""Held while a binary is read: whoever ends or forks the process waits for that."""


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
    """Put a program that was just built into the cache, now or later, as ``$PYIBR_BINARIES`` says.

    Parameters
    ----------
    program : pyopencl.Program
        The program.
    entry : Entry
        Where it is kept.
    head : bytes
        What comes before its binary there.
    compiles_for_it : bool
        Whether its runtime compiles anew to hand it out: then "later" is the default, else "now".
    calls : Calls
        Those that somebody waits for.

    Raises
    ------
    ArgumentError
        The variable is something else.
    """
    chosen = os.environ.get(VARIABLE) or ("later" if compiles_for_it else "now")
    if chosen not in _CHOICES:
        raise ArgumentError(f"${VARIABLE}", f"one of {', '.join(_CHOICES)}", repr(chosen))
    if chosen == "now":
        _keep(program, entry, head)
    elif chosen == "later":
        _keep_later(_Waiting(program, entry, head, calls))


def read_all(progress: Callable[[int, int], object]) -> None:
    """Read all that the thread has not read yet; `progress` is told how many are left, and of how many."""
    total = len(_waiting)
    progress(total, total)
    while _keep_next():
        progress(len(_waiting), total)


def forget_all() -> None:
    """In a process that was forked: the thread stayed behind, and so did the runtime."""
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
    with suppress(AttributeError, OSError):  # Linux has a priority for each thread
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
    """Keep the program that waits longest; False if none does."""
    with reading:
        with _changed:
            if not _waiting:
                return False
            one = _waiting.popleft()
        _keep(one.program, one.entry, one.head)
        return True


def _keep(program: cl.Program, entry: Entry, head: bytes) -> None:
    if binary := _binary_of(program):  # some runtimes have none
        entry.write(head + binary)


def _binary_of(program: cl.Program) -> bytes:
    """The binary, as pyopencl reads it, but without Python's lock, for which all other threads would wait."""
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
    """``clGetProgramInfo`` of the loader that pyopencl is linked with; None where the linker does not find it there."""
    import pyopencl._cl as module

    try:
        function = ctypes.CDLL(module.__file__).clGetProgramInfo
    except (AttributeError, OSError):
        return None
    function.argtypes = [ctypes.c_void_p, ctypes.c_uint32, ctypes.c_size_t, ctypes.c_void_p, ctypes.c_void_p]
    function.restype = ctypes.c_int32
    return function
