"""Arrays on the device: in place on a CPU, copied on a GPU."""

from __future__ import annotations

import contextlib
import mmap
import weakref
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from pyibr.opencl.device import current

if TYPE_CHECKING:
    import pyopencl as cl
    from numpy.typing import DTypeLike, NDArray

    from pyibr.opencl.device import Session

_HUGE_PAGE = 1 << 21
_SPARE_BYTES = 1 << 28  # how much memory a session keeps for its next calls


@dataclass(frozen=True, eq=False)
class Block:
    """A piece of device memory, and the same memory on the host where the device works in place."""

    buffer: cl.Buffer
    host: NDArray[np.uint8] | None
    size: int


@dataclass(frozen=True, eq=False)
class DeviceArray:
    """A device buffer with the shape and dtype of what lies in it."""

    buffer: cl.Buffer
    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    host: NDArray[Any] | None  # the memory itself, where the device works in place
    session: Session

    def to_host(self) -> NDArray[Any]:
        """The values, once all launches are done."""
        import pyopencl as cl

        queue = self.session.queue
        if self.host is None:
            values = np.empty(self.shape, self.dtype)
            cl.enqueue_copy(queue, values, self.buffer)
        else:
            values = self.host
            mapped, _ = cl.enqueue_map_buffer(queue, self.buffer, cl.map_flags.READ, 0, self.shape, self.dtype)
            mapped.base.release(queue)
        queue.finish()
        self.session.in_flight.clear()
        return values

    def fill(self, value: float) -> None:
        """Sets every element, in the order of launches."""
        import pyopencl as cl

        size = int(np.prod(self.shape)) * self.dtype.itemsize
        cl.enqueue_fill_buffer(self.session.queue, self.buffer, self.dtype.type(value), 0, size)


def upload(array: NDArray[Any]) -> DeviceArray:
    """``array`` (C-contiguous) as a read-only input. It must not change while launches read it."""
    import pyopencl as cl

    session = current()
    flags = cl.mem_flags.READ_ONLY
    flags |= cl.mem_flags.USE_HOST_PTR if session.is_cpu else cl.mem_flags.COPY_HOST_PTR
    buffer = cl.Buffer(session.context, flags, hostbuf=array)
    return DeviceArray(buffer, array.shape, array.dtype, array if session.is_cpu else None, session)


def empty(shape: tuple[int, ...], dtype: DTypeLike) -> DeviceArray:
    """An uninitialised array for launches to write and the caller to keep."""
    session = current()
    host = np.empty(shape, dtype) if session.is_cpu else None
    kind = np.dtype(dtype)
    return DeviceArray(_buffer(session, host, int(np.prod(shape)) * kind.itemsize), shape, kind, host, session)


def scratch(shape: tuple[int, ...], dtype: DTypeLike) -> DeviceArray:
    """As `empty`, in memory that is handed out again once nobody refers to the array."""
    session = current()
    kind = np.dtype(dtype)
    size = int(np.prod(shape)) * kind.itemsize
    fitting = [block for block in session.spare if size <= block.size <= 2 * size]
    if fitting:
        block = min(fitting, key=lambda block: block.size)
        session.spare.remove(block)
    else:
        host = _allocate(size) if session.is_cpu else None
        block = Block(_buffer(session, host, size), host, size)
    host = None if block.host is None else block.host[:size].view(kind).reshape(shape)
    array = DeviceArray(block.buffer, shape, kind, host, session)
    weakref.finalize(array, _give_back, session, block).atexit = False
    return array


def _give_back(session: Session, block: Block) -> None:
    session.spare.append(block)
    while sum(kept.size for kept in session.spare) > _SPARE_BYTES:
        session.spare.pop(0)


def _buffer(session: Session, host: NDArray[Any] | None, size: int) -> cl.Buffer:
    import pyopencl as cl

    if host is None:
        return cl.Buffer(session.context, cl.mem_flags.READ_WRITE, size)
    return cl.Buffer(session.context, cl.mem_flags.READ_WRITE | cl.mem_flags.USE_HOST_PTR, hostbuf=host)


def _allocate(size: int) -> NDArray[np.uint8]:
    """Page-aligned memory, in huge pages where it is large and the system has them.

    Kernels walk columns as well as rows, and with small pages every step of such a walk misses the TLB.
    """
    huge = size >= _HUGE_PAGE and hasattr(mmap, "MADV_HUGEPAGE")
    memory = mmap.mmap(-1, size + _HUGE_PAGE if huge else max(size, 1))
    array = np.frombuffer(memory, np.uint8)
    if not huge:
        return array[:size]
    with contextlib.suppress(OSError):  # a kernel built without huge pages
        memory.madvise(mmap.MADV_HUGEPAGE)
    start = -array.ctypes.data % _HUGE_PAGE
    return array[start : start + size]
