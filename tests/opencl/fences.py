"""Puts kernels' arrays between protected pages (fences), so that an access one byte outside ends the process.

An array starts or ends exactly at a fence: PoCL uses the host's memory in place, at any address. Uploaded arrays are
also protected against writes. Kernels in one lane, which would otherwise use device memory, get such arrays, too.

Run as a program, with a group of kernels and 16 or 1 lanes, this module runs `cases` with fences at the start of
arrays, then with fences at their end. After each run it uses the same programs for cases whose structs are poisoned
with invalid numbers: results are arbitrary, but kernels must end and stay within their arrays. Programs are built
without optimisation: this takes half the time, and keeps reads whose values are not used.
"""

from __future__ import annotations

import ctypes
import math
import mmap
import sys
from contextlib import nullcontext
from functools import partial
from typing import Any, Literal, get_args

import numpy as np
import pyopencl as cl
from numpy.typing import DTypeLike, NDArray

from pyibr.opencl import memory, program
from pyibr.opencl.device import Session, current
from pyibr.opencl.memory_pool import Block
from pyibr.raster import bins
from tests.one_lane import one_lane
from tests.opencl.cases import check_all_ran, run_all
from tests.opencl.setting import KINDS, Launches, Poisoned, Setting

Where = Literal["start", "end"]

_GUARD = 1 << 20  # bytes of a fence, because a wrong index may be far off

_libc = ctypes.CDLL(None, use_errno=True)
_make_buffer = cl.Buffer


def _forbid(address: int, size: int, allowed: int = 0) -> None:
    assert _libc.mprotect(ctypes.c_void_p(address), size, allowed) == 0, ctypes.get_errno()


def _fenced_bytes(size: int, where: Where) -> tuple[mmap.mmap, int]:
    """Map pages with fences; returns them, and the offset of `size` bytes in them that touch a fence."""
    whole = -(-max(size, 1) // mmap.PAGESIZE) * mmap.PAGESIZE
    pages = mmap.mmap(-1, whole + 2 * _GUARD)
    address = np.frombuffer(pages, np.uint8).ctypes.data
    _forbid(address, _GUARD)
    _forbid(address + _GUARD + whole, _GUARD)
    return pages, _GUARD + (whole - max(size, 1) if where == "end" else 0)


def fenced(shape: tuple[int, ...], dtype: DTypeLike, where: Where) -> NDArray[Any]:
    """Make an array that touches a fence at its start or end."""
    size = math.prod(shape) * np.dtype(dtype).itemsize
    pages, start = _fenced_bytes(size, where)
    return np.frombuffer(pages, np.uint8)[start : start + size].view(dtype).reshape(shape)


def raise_fences(where: Where) -> None:
    """Make all further buffers of this process touch fences."""

    def take(session: Session, size: int) -> Block:
        if not session.profile.in_place:
            return Block(cl.Buffer(session.context, cl.mem_flags.READ_WRITE, size), size)
        pages, start = _fenced_bytes(size, where)
        hostbuf = np.frombuffer(pages, np.uint8)[start : start + max(size, 1)]
        flags = cl.mem_flags.READ_WRITE | cl.mem_flags.USE_HOST_PTR
        return Block(_make_buffer(session.context, flags, hostbuf=hostbuf), size, pages, start)

    def make_buffer(context: cl.Context, flags: int, size: int = 0, hostbuf: NDArray[Any] | None = None) -> cl.Buffer:
        kinds = cl.mem_flags
        if flags & kinds.USE_HOST_PTR and not flags & kinds.READ_ONLY:
            return _make_buffer(context, flags, hostbuf=hostbuf)  # memory that the caller reads
        kept = flags & (kinds.READ_ONLY | kinds.WRITE_ONLY | kinds.READ_WRITE) | kinds.USE_HOST_PTR
        if hostbuf is None:
            return _make_buffer(context, kept, hostbuf=fenced((max(size, 1),), np.uint8, where))
        copy = fenced((hostbuf.nbytes,), np.uint8, where)
        copy[:] = hostbuf.reshape(-1).view(np.uint8)
        if flags & kinds.READ_ONLY:
            first = copy.ctypes.data // mmap.PAGESIZE * mmap.PAGESIZE
            _forbid(first, copy.ctypes.data + copy.nbytes - first, mmap.PROT_READ)
        return _make_buffer(context, kept, hostbuf=copy)

    bins._UNASKED = 0  # lists get no spare room, so that an overrun is noticed
    memory._take = take
    memory._give_back = lambda session, block: None
    cl.Buffer = make_buffer


if __name__ == "__main__":
    group, lanes = sys.argv[1:]
    current()  # opened before the fences, because its test makes buffers, too
    program._OPTIONS.append("-cl-opt-disable")
    kinds = KINDS if lanes == "16" else KINDS[:1]  # in one lane, Oclgrind checks the other kinds of colours
    with one_lane() if lanes == "1" else nullcontext():
        for seed, where in enumerate(get_args(Where)):
            print("fences at the", where)
            raise_fences(where)
            # Accesses are the same for other kinds of colours, apart from the colours.
            settings = [Setting(kind, 2 if kind == "uint8" else 1, partial(fenced, where=where)) for kind in kinds]
            ran = {one for setting in settings for one in run_all(setting, Launches(), group)}
            if kinds == KINDS:
                check_all_ran(ran, group)
            print("poisoned", seed)
            run_all(Setting("uint8", 1), Poisoned(seed), group)
        print("through in lanes:", current().profile.lanes)
