"""Arrays on the device: in place on a CPU, copied on a GPU."""

from __future__ import annotations

import contextlib
import mmap
import weakref
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from pyibr.errors import DeviceError
from pyibr.opencl.device import current

if TYPE_CHECKING:
    import pyopencl as cl
    from numpy.typing import DTypeLike, NDArray

    from pyibr.opencl.device import Session

_HUGE_PAGE = 1 << 21
_SPARE_BYTES = 1 << 28  # how much memory a session keeps for its next calls


@dataclass(frozen=True, eq=False)
class Block:
    """A piece of device memory; where the device works in place, also the pages on the host that it lies in."""

    buffer: cl.Buffer
    size: int
    pages: mmap.mmap | None = None
    start: int = 0  # in the pages


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
        if 0 in self.shape:
            values = np.empty(self.shape, self.dtype)
        elif self.host is None:
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
    if not array.size:
        return empty(array.shape, array.dtype)
    flags = cl.mem_flags.READ_ONLY
    flags |= cl.mem_flags.USE_HOST_PTR if session.is_cpu else cl.mem_flags.COPY_HOST_PTR
    buffer = cl.Buffer(session.context, flags, hostbuf=array)
    return DeviceArray(buffer, array.shape, array.dtype, array if session.is_cpu else None, session)


def copy(source: DeviceArray, target: DeviceArray) -> None:
    """Copies all of `source` to the start of `target`, in the order of launches."""
    import pyopencl as cl

    size = int(np.prod(source.shape)) * source.dtype.itemsize
    if size:
        cl.enqueue_copy(source.session.queue, target.buffer, source.buffer, byte_count=size)


def empty(shape: tuple[int, ...], dtype: DTypeLike) -> DeviceArray:
    """An uninitialised array for launches to write.

    Its memory is handed out again once nobody refers to the array, on the device or on the host: the system takes
    longer to give a process fresh pages than a kernel to fill them.
    """
    session = current()
    kind = np.dtype(dtype)
    size = int(np.prod(shape)) * kind.itemsize
    block = _take(session, size)
    if block.pages is None:
        array = DeviceArray(block.buffer, shape, kind, None, session)
        weakref.finalize(array, _give_back, session, block).atexit = False
        return array
    # Views of an array keep alive the one that is made of the pages themselves.
    pages = np.frombuffer(block.pages, np.uint8)
    weakref.finalize(pages, _give_back, session, block).atexit = False
    host = pages[block.start : block.start + size].view(kind).reshape(shape)
    return DeviceArray(block.buffer, shape, kind, host, session)


def _take(session: Session, size: int) -> Block:
    """A block for `size` bytes: a spare one that is not much larger, else a new one."""
    import pyopencl as cl

    for block in sorted(session.spare, key=lambda block: block.size):
        if size <= block.size <= size + size // 4:
            with contextlib.suppress(ValueError):  # a finalizer may have let it go meanwhile
                session.spare.remove(block)
                return block
    flags = cl.mem_flags.READ_WRITE
    try:
        if not session.is_cpu:
            return Block(cl.Buffer(session.context, flags, max(size, 1)), size)
        pages = _pages(size)
        memory = np.frombuffer(pages, np.uint8)
        start = -memory.ctypes.data % _HUGE_PAGE if memory.size >= size + _HUGE_PAGE else 0
        hostbuf = memory[start : start + max(size, 1)]
        return Block(cl.Buffer(session.context, flags | cl.mem_flags.USE_HOST_PTR, hostbuf=hostbuf), size, pages, start)
    except (OSError, MemoryError, cl.MemoryError) as error:
        raise DeviceError(f"not enough memory on {session.device} for {size / 2**20:.0f} MiB more") from error


def _give_back(session: Session, block: Block) -> None:
    spare = session.spare
    spare.append(block)
    while sum(kept.size for kept in spare) > _SPARE_BYTES:
        spare.pop(0)


def _pages(size: int) -> mmap.mmap:
    """Whole pages, which CPU runtimes use in place; huge ones for large sizes, where the system has them.

    Kernels walk columns as well as rows, and with small pages every step of such a walk misses the TLB.
    """
    # Private: shared pages stay small, and a forked child would write into its parent's frames.
    private: dict[str, Any] = {"flags": mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS} if hasattr(mmap, "MAP_PRIVATE") else {}
    if size < _HUGE_PAGE or not hasattr(mmap, "MADV_HUGEPAGE"):
        return mmap.mmap(-1, max(size, 1), **private)
    pages = mmap.mmap(-1, size + _HUGE_PAGE, **private)
    with contextlib.suppress(OSError):  # a kernel built without huge pages
        pages.madvise(mmap.MADV_HUGEPAGE)
    return pages
