"""Arrays on the device: in place on a CPU, copied on a GPU."""

from __future__ import annotations

import contextlib
import gc
import math
import mmap
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar, cast

import numpy as np

from pyibr.opencl.device import Session, current
from pyibr.opencl.memory_pool import Block, MemoryPool, is_shortage, rounded, tell_shortage, when_gone
from pyibr.opencl.watch import watches

if TYPE_CHECKING:
    import pyopencl as cl
    from numpy.typing import DTypeLike, NDArray


_Made = TypeVar("_Made")

_HUGE_PAGE = 1 << 21
_POOL_BYTES_MAX = 1 << 28  # free memory that a session keeps for its next calls


@dataclass(frozen=True, eq=False)
class DeviceArray:
    """A device buffer with a shape and a dtype."""

    buffer: cl.Buffer
    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    host: NDArray[Any] | None  # the memory itself if the device works in place; otherwise the destination of copies
    session: Session
    is_own: bool = True  # whole pages, in which CPU runtimes work in place (`pyibr.opencl.selftest`)
    is_input: bool = False  # read-only for kernels: their writes may or may not reach the host

    @property
    def nbytes(self) -> int:
        """Size of the values in bytes."""
        return math.prod(map(int, self.shape)) * self.dtype.itemsize

    def to_host(self) -> NDArray[Any]:
        """Wait for all launches and return the values."""
        return to_host([self])[0]

    def fill(self, value: float) -> None:
        """Set every element, in order with launches."""
        import pyopencl as cl

        self.session.in_flight.used.append(self)
        cl.enqueue_fill_buffer(self.session.queue, self.buffer, self.dtype.type(value), 0, self.nbytes)


def to_host(arrays: Sequence[DeviceArray]) -> list[NDArray[Any]]:
    """Return the values of arrays of one session, after one wait for all launches."""
    values = begin_to_host(arrays)
    arrays[0].session.wait()
    return values


def begin_to_host(arrays: Sequence[DeviceArray]) -> list[NDArray[Any]]:
    """Return host arrays that hold the values of device arrays of one session, after a later wait for it.

    Copies start when the launches made so far are done. They overlap with later launches, which must not write the
    arrays.
    """
    import pyopencl as cl

    session = arrays[0].session
    values: list[NDArray[Any]] = []
    launches = None if session.profile.in_place else [cl.enqueue_marker(session.queue)]
    session.queue.flush()  # required before another queue waits for it
    for array in arrays:
        if 0 in array.shape:
            values.append(np.empty(array.shape, array.dtype))
        elif array.host is None or not session.profile.in_place:
            host = _copied_fast(array) if array.host is None else array.host
            if watches:
                watches[-1].download(array.nbytes)
            done = cl.enqueue_copy(session.copies, host, array.buffer, is_blocking=False, wait_for=launches)
            # Kept: releasing such an event waits for it while holding the GIL.
            session.in_flight.used.append((array, done))
            values.append(host)
        elif array.is_own:
            values.append(array.host)
        else:
            mapped, _ = cl.enqueue_map_buffer(
                session.queue, array.buffer, cl.map_flags.READ, 0, array.shape, array.dtype, is_blocking=False
            )
            mapped.base.release(session.queue)
            values.append(array.host)
    session.copies.flush()
    return values


def upload(array: NDArray[Any]) -> DeviceArray:
    """Return ``array`` (C-contiguous) as a read-only input. It must not change while launches read it."""
    import pyopencl as cl

    session = current()
    if watches:
        watches[-1].upload(array.nbytes)
    if not array.size:
        return empty(array.shape, array.dtype)
    if not session.profile.in_place:
        made = _copied(session, _take(session, array.nbytes), array.shape, array.dtype, is_input=True)
        done = cl.enqueue_copy(session.queue, made.buffer, array, is_blocking=False)
        session.in_flight.used.append((array, made, done))
        return made

    def in_place() -> DeviceArray:
        buffer = cl.Buffer(session.context, cl.mem_flags.READ_ONLY | cl.mem_flags.USE_HOST_PTR, hostbuf=array)
        return DeviceArray(buffer, array.shape, array.dtype, array, session, is_input=True)

    return _within_room(session, array.nbytes, in_place)


def output(array: NDArray[Any]) -> DeviceArray:
    """Return ``array`` (C-contiguous, writable) as an output: in place on a CPU, otherwise `to_host` copies into it."""
    import pyopencl as cl

    session = current()
    if session.profile.in_place and array.size:
        flags = cl.mem_flags.READ_WRITE | cl.mem_flags.USE_HOST_PTR

        def made() -> DeviceArray:
            buffer = cl.Buffer(session.context, flags, hostbuf=array)
            return DeviceArray(buffer, array.shape, array.dtype, array, session, is_own=False)

        return _within_room(session, array.nbytes, made)
    return empty(array.shape, array.dtype, array)


def copy(source: DeviceArray, target: DeviceArray, at: int = 0) -> None:
    """Copy all of `source` to `target`, starting at element `at`, in order with launches."""
    import pyopencl as cl

    if source.nbytes:
        start = at * target.dtype.itemsize
        source.session.in_flight.used.append((source, target))
        cl.enqueue_copy(source.session.queue, target.buffer, source.buffer, byte_count=source.nbytes, dst_offset=start)


def empty(shape: tuple[int, ...], dtype: DTypeLike, into: NDArray[Any] | None = None) -> DeviceArray:
    """Return an uninitialised array for launches to write.

    On devices with their own memory, `to_host` copies the values to the host array `into`. The array's memory is reused
    when there are no more references to the array, on the device or on the host: fresh pages from the system take
    longer than the kernels that fill them.
    """
    session = current()
    kind, whole = np.dtype(dtype), tuple(map(int, shape))  # NumPy's integers would overflow in products
    size = math.prod(whole) * kind.itemsize
    block = _take(session, size)
    if block.pages is None:
        return _copied(session, block, whole, kind, into)
    host = _lying_in(block, session.memory_pool, whole, kind)
    return DeviceArray(block.buffer, whole, kind, host, session)


def zeros(shape: tuple[int, ...], dtype: DTypeLike) -> DeviceArray:
    """Return an array of zeros for launches to write."""
    array = empty(shape, dtype)
    if array.host is not None and array.session.profile.in_place:  # no launch uses it yet
        array.host[...] = 0
    else:
        array.fill(0)
    return array


def _copied(
    session: Session,
    block: Block,
    shape: tuple[int, ...],
    dtype: np.dtype[Any],
    into: NDArray[Any] | None = None,
    is_input: bool = False,
) -> DeviceArray:
    """An array in a block of the device's own memory."""
    array = DeviceArray(block.buffer, shape, dtype, into, session, is_input=is_input)
    when_gone(array, _give_back, session.memory_pool, block)
    return array


def _lying_in(block: Block, pool: MemoryPool, shape: tuple[int, ...], dtype: np.dtype[Any]) -> NDArray[Any]:
    """An array in a block's pages, which return to the pool when there are no more references to them."""
    # `when_gone` watches the base array, which views keep alive.
    pages = np.frombuffer(block.pages, dtype, math.prod(shape), block.start)
    when_gone(pages, _give_back, pool, block)
    return pages.reshape(shape)


def _copied_fast(array: DeviceArray) -> NDArray[Any]:
    """A host array for a device array's values: in pinned memory, where copies are several times as fast, up to a limit
    of pinned memory."""
    session, size = array.session, rounded(array.nbytes)
    block = session.pinned_pool.take(size)
    if block is None:
        try:
            block = _new_pinned(session, size)
        except Exception as error:
            if not is_shortage(error):
                raise
            return np.empty(array.shape, array.dtype)
    return _lying_in(block, session.pinned_pool, array.shape, array.dtype)


def _take(session: Session, size: int) -> Block:
    """A block for `size` bytes, from the pool or new."""
    size = rounded(size)
    spare = session.memory_pool.take(size)
    return _within_room(session, size, lambda: _new(session, size)) if spare is None else spare


def _within_room(session: Session, size: int, make: Callable[[], _Made]) -> _Made:
    """Call `make`, which allocates `size` bytes on the device; if they are short, first free unused memory."""

    def made() -> _Made:
        session.room.require(size)
        owner = make()
        session.room.hold(owner, size)
        return owner

    try:
        return made()
    except Exception as error:
        if not is_shortage(error):
            raise
    session.wait()  # launches in flight keep their memory
    gc.collect()  # errors keep the memory of their failed calls
    session.memory_pool.clear()
    room, most = session.room, session.context.devices[0].max_mem_alloc_size
    there = f"{_mib(room.taken)} of {_mib(room.total)} are in use, one buffer has {_mib(most)} at most"
    try:
        return made()
    except Exception as error:
        tell_shortage(error, session.device, f"{_mib(size)} more: {there}")
        raise


def _mib(size: int) -> str:
    return f"{size / 2**20:.0f} MiB"


def _new(session: Session, size: int) -> Block:
    import pyopencl as cl

    flags = cl.mem_flags.READ_WRITE
    if not session.profile.in_place:
        return Block(cl.Buffer(session.context, flags, size), size)
    pages = _pages(size)
    memory = np.frombuffer(pages, np.uint8)
    start = -memory.ctypes.data % _HUGE_PAGE if memory.size >= size + _HUGE_PAGE else 0
    hostbuf = memory[start : start + size]
    return Block(cl.Buffer(session.context, flags | cl.mem_flags.USE_HOST_PTR, hostbuf=hostbuf), size, pages, start)


def _new_pinned(session: Session, size: int) -> Block:
    import pyopencl as cl

    session.pinned.require(size)
    buffer = cl.Buffer(session.context, cl.mem_flags.READ_WRITE | cl.mem_flags.ALLOC_HOST_PTR, size)
    both = cast("cl.map_flags", cl.map_flags.READ | cl.map_flags.WRITE)
    pages, _ = cl.enqueue_map_buffer(session.copies, buffer, both, 0, (size,), np.dtype(np.uint8))
    block = Block(buffer, size, memoryview(pages))
    session.pinned.hold(block, size)
    return block


def _give_back(pool: MemoryPool, block: Block) -> None:
    pool.give(block, _POOL_BYTES_MAX)


def _pages(size: int) -> mmap.mmap:
    """Whole pages, which CPU runtimes use in place; huge pages for large sizes, if the system has them.

    Kernels also walk along columns, and with small pages each step down a column misses the TLB.
    """
    # Private, since shared pages stay small, and a forked child would write into its parent's frames.
    private: dict[str, Any] = {"flags": mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS} if hasattr(mmap, "MAP_PRIVATE") else {}
    if size < _HUGE_PAGE or not hasattr(mmap, "MADV_HUGEPAGE"):
        return mmap.mmap(-1, size, **private)
    pages = mmap.mmap(-1, size + _HUGE_PAGE, **private)
    with contextlib.suppress(OSError):  # a kernel built without huge pages
        pages.madvise(mmap.MADV_HUGEPAGE)
    return pages
