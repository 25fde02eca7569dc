"""Device memory: a count of bytes in use, a pool of free blocks for reuse, and the error if memory is short."""

from __future__ import annotations

import atexit
import errno
import functools
import threading
import weakref
from collections import OrderedDict
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from pyibr.core.errors import Error, OutOfMemoryError

if TYPE_CHECKING:
    import pyopencl as cl

_SIZE_MIN = 1 << 12  # bytes: a page


class _Last(weakref.ref[Any]):
    """A weak reference that makes a call when its object is gone."""

    __slots__ = ("arguments", "call")
    call: Callable[..., object]
    arguments: tuple[Any, ...]
    __eq__, __hash__ = object.__eq__, object.__hash__  # arrays have no hash


_waiting: set[_Last] = set()
atexit.register(_waiting.clear)  # at exit, no calls are made, since modules are being torn down


def when_gone(owner: object, call: Callable[..., object], *arguments: Any) -> None:
    """Make a call when its owner is garbage-collected, but not at the end of the process.

    This takes a third of the time of `weakref.finalize`, and a picture needs it some thirty times.
    """
    last = _Last(owner, _make_call)
    last.call, last.arguments = call, arguments
    _waiting.add(last)


def _make_call(last: _Last) -> None:
    _waiting.discard(last)
    last.call(*last.arguments)


@dataclass(frozen=True, eq=False)
class Block:
    """A block of device memory, and its pages if it lies on the host."""

    buffer: cl.Buffer
    size: int
    pages: Any = None  # an mmap, or a memoryview
    start: int = 0  # offset in the pages


@functools.lru_cache(maxsize=1024)
def rounded(size: int) -> int:
    """Return the block size for `size` bytes: up to an eighth more, so that similar sizes share blocks."""
    step = max(1 << max(size.bit_length() - 4, 0), _SIZE_MIN)
    return -(-max(size, 1) // step) * step


class Room:
    """Count of a device's memory in bytes, since runtimes may allocate more than the device reports."""

    def __init__(self, total: int, taken: int = 0) -> None:
        self.total, self.taken = total, taken
        self._lock = threading.RLock()

    def require(self, size: int) -> None:
        """Raise MemoryError if fewer than `size` bytes are free."""
        if size > self.total - self.taken:
            raise MemoryError

    def hold(self, owner: object, size: int) -> None:
        """Count `size` bytes as in use until their owner is gone."""
        self._add(size)
        when_gone(owner, self._add, -size)

    def _add(self, size: int) -> None:
        with self._lock:
            self.taken += size


class MemoryPool:
    """Unused blocks of device memory, kept by size for reuse.

    Finalizers return blocks in any thread and at any time, even during `take` and `give`.
    """

    def __init__(self) -> None:
        self.size = 0
        self._blocks: OrderedDict[int, list[Block]] = OrderedDict()  # empty lists stay, as `give` may be using one
        self._lock = threading.RLock()

    def __iter__(self) -> Iterator[Block]:
        return iter([block for blocks in self._blocks.values() for block in blocks])

    def take(self, size: int) -> Block | None:
        """Return the block of this size that was returned last, or None."""
        with self._lock:
            blocks = self._blocks.get(size)
            block = blocks.pop() if blocks else None
            if block is not None:
                self.size -= size
            return block

    def give(self, block: Block, size_max: int) -> None:
        """Keep a block. Above `size_max` bytes, drop blocks of the least recently given size first."""
        with self._lock:
            self.size += block.size  # first: if Ctrl-C comes next, the sum is too large and is computed again below
            self._blocks.setdefault(block.size, []).append(block)
            self._blocks.move_to_end(block.size)
            if self.size > size_max:
                self.size = sum(kept.size for kept in self)
            for blocks in [*self._blocks.values()] if self.size > size_max else ():
                while blocks and self.size > size_max:
                    oldest = blocks.pop(0)
                    self.size -= oldest.size

    def clear(self) -> None:
        """Release all blocks."""
        while (block := next(iter(self), None)) is not None:
            self.take(block.size)


@contextmanager
def telling_shortage(device: object) -> Generator[None, None, None]:
    """Convert out-of-memory errors inside the ``with`` block by `tell_shortage`."""
    try:
        yield
    except Exception as error:
        tell_shortage(error, device)
        raise


def tell_shortage(error: Exception, device: object, needed: str | None = None) -> None:
    """Raise OutOfMemoryError if an error from NumPy, the system or OpenCL means a lack of memory.

    device: to be named in the message. needed: purpose of the memory; by default, the message quotes the error.
    """
    if not isinstance(error, Error) and is_shortage(error):
        what = f" for {needed}" if needed else f": {error}" if str(error) else ""
        raise OutOfMemoryError(f"not enough memory on {device}{what}") from error


def is_shortage(error: Exception) -> bool:
    """Tell whether an error means that memory is short, or that a buffer is too large for the device."""
    import pyopencl as cl

    if isinstance(error, (MemoryError, cl.MemoryError)) or getattr(error, "errno", None) == errno.ENOMEM:
        return True
    return isinstance(error, cl.Error) and error.code == cl.status_code.INVALID_BUFFER_SIZE
