"""Device memory: how much of it is taken, and what nobody refers to any more, kept for those who ask next."""

from __future__ import annotations

import atexit
import functools
import threading
import weakref
from collections import OrderedDict
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pyopencl as cl

_SIZE_MIN = 1 << 12  # bytes: a page


class _Last(weakref.ref[Any]):
    """A weak reference that makes a call once what it refers to is gone."""

    __slots__ = ("arguments", "call")
    call: Callable[..., object]
    arguments: tuple[Any, ...]
    __eq__, __hash__ = object.__eq__, object.__hash__  # arrays have no hash


_waiting: set[_Last] = set()
atexit.register(_waiting.clear)  # after that, nobody is told: modules are taken apart


def when_gone(owner: object, call: Callable[..., object], *arguments: Any) -> None:
    """Make a call once nobody refers to its owner any more, but not when the process ends.

    It is `weakref.finalize`, in a third of the time: a picture asks for it some thirty times.
    """
    last = _Last(owner, _make_call)
    last.call, last.arguments = call, arguments
    _waiting.add(last)


def _make_call(last: _Last) -> None:
    _waiting.discard(last)
    last.call(*last.arguments)


@dataclass(frozen=True, eq=False)
class Block:
    """A piece of device memory, and where it lies on the host, if it does."""

    buffer: cl.Buffer
    size: int
    pages: Any = None  # an mmap, or a memoryview
    start: int = 0  # in the pages


@functools.lru_cache(maxsize=1024)
def rounded(size: int) -> int:
    """Bytes of the block for `size` of them: up to an eighth more, so that sizes that are much the same are one."""
    step = max(1 << max(size.bit_length() - 4, 0), _SIZE_MIN)
    return -(-max(size, 1) // step) * step


class Room:
    """Memory of a device by its own figure, in bytes: runtimes may promise more than there is."""

    def __init__(self, total: int, taken: int = 0) -> None:
        self.total, self.taken = total, taken
        self._lock = threading.RLock()

    def require(self, size: int) -> None:
        """Raise MemoryError if there are not so many bytes."""
        if size > self.total - self.taken:
            raise MemoryError

    def hold(self, owner: object, size: int) -> None:
        """So many bytes are taken until their owner is gone."""
        self._add(size)
        when_gone(owner, self._add, -size)

    def _add(self, size: int) -> None:
        with self._lock:
            self.taken += size


class MemoryPool:
    """Blocks by size. Finalizers give them back, in any thread and at any time: amid `take` and `give`, too."""

    def __init__(self) -> None:
        self.size = 0
        self._blocks: OrderedDict[int, list[Block]] = OrderedDict()  # lists stay, if empty: `give` may hold one
        self._lock = threading.RLock()

    def __iter__(self) -> Iterator[Block]:
        return iter([block for blocks in self._blocks.values() for block in blocks])

    def take(self, size: int) -> Block | None:
        """A block of that size, the one given last, or None."""
        with self._lock:
            blocks = self._blocks.get(size)
            block = blocks.pop() if blocks else None
            if block is not None:
                self.size -= size
            return block

    def give(self, block: Block, size_max: int) -> None:
        """Keep a block, and at most that many bytes: blocks of the size that was given longest ago go first."""
        with self._lock:
            self.size += block.size  # first: where Ctrl-C comes between, it is too large, and counted anew
            self._blocks.setdefault(block.size, []).append(block)
            self._blocks.move_to_end(block.size)
            if self.size > size_max:
                self.size = sum(kept.size for kept in self)
            for blocks in [*self._blocks.values()] if self.size > size_max else ():
                while blocks and self.size > size_max:
                    oldest = blocks.pop(0)
                    self.size -= oldest.size

    def clear(self) -> None:
        """Let go of all of them."""
        while (block := next(iter(self), None)) is not None:
            self.take(block.size)
