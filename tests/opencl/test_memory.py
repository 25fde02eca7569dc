"""Memory of arrays on the device: its owners, and when it is freed."""

from __future__ import annotations

import errno
import gc
import mmap
import os
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pyopencl as cl
import pytest

import pyibr as ibr
from pyibr.core.checks import Immutable
from pyibr.opencl import memory
from pyibr.opencl.device import current, one_call
from pyibr.opencl.memory_pool import rounded, when_gone
from pyibr.picture.target import clear
from tests.one_lane import one_lane
from tools.everything import calls

SMALL, LARGE = (100, 100), (1500, 1001)  # arrays smaller and larger than a huge page


@pytest.mark.parametrize("shape", [SMALL, LARGE])
def test_memory_is_not_handed_out_while_a_view_of_it_lives(shape):
    array = memory.empty(shape, np.float32)
    array.fill(3.0)
    corner = array.to_host()[5:, 7:][::2]
    del array
    gc.collect()
    others = [memory.empty(shape, np.float32) for _ in range(4)]
    for other in others:
        other.fill(-1.0)
        other.to_host()
    assert (corner == 3.0).all()


@pytest.mark.parametrize("room", [1 << 29, 100_000], ids=["pinned", "ordinary, above the limit"])
def test_copies_are_not_handed_out_while_a_view_of_them_lives(monkeypatch, room):
    with one_lane():
        pinned = current().pinned
        current().pinned_pool.clear()
        gc.collect()
        monkeypatch.setattr(pinned, "total", pinned.taken + room)
        before = pinned.taken
        array = memory.empty(SMALL, np.float32)
        array.fill(3.0)
        corner = array.to_host()[5:, 7:][::2]
        gc.collect()
        others = [memory.empty(SMALL, np.float32) for _ in range(4)]
        for number, other in enumerate(others):
            other.fill(-1.0 - number)
        copies = [other.to_host() for other in others]
        assert (corner == 3.0).all()
        assert [copy.flat[0] for copy in copies] == [-1.0, -2.0, -3.0, -4.0]
        assert 0 < pinned.taken - before <= room
        kept = pinned.taken
        del corner, copies
        gc.collect()
        assert (memory.empty(SMALL, np.uint32).to_host().shape, pinned.taken) == (SMALL, kept), "memory is reused"


def test_a_call_is_made_once_its_owner_is_gone():
    """Owners may be equal to one another, or arrays, which have no hash; each one's end is still noticed."""
    owners, gone = [np.zeros(3) for _ in range(5)], list[tuple[int, str]]()
    views = [owner[1:] for owner in owners]
    for number, owner in enumerate(owners):
        when_gone(owner, lambda *told: gone.append(told), number, "a")
        when_gone(owner, lambda *told: gone.append(told), number, "b")
    del owner, owners
    assert not gone, "views keep them"
    for number in (3, 0, 4):
        views[number] = np.zeros(2)
    assert sorted(gone) == [(number, kind) for number in (0, 3, 4) for kind in "ab"]


def test_spare_memory_is_bounded_and_what_lay_idle_longest_goes_first(monkeypatch):
    session = current()
    session.memory_pool.clear()
    sizes = [100_000, 200_000, 300_000]
    monkeypatch.setattr(memory, "_POOL_BYTES_MAX", sum(map(rounded, sizes[1:])))
    for size in sizes:
        memory.empty((size,), np.uint8)
    assert [block.size for block in session.memory_pool] == [rounded(size) for size in sizes[1:]]


@pytest.mark.parametrize(("size", "next_size"), [(6_006_000, 6_006_000), (1_000_000, 1_010_000)])
def test_memory_is_handed_out_again_also_for_much_the_same_size(size, next_size):
    session = current()
    session.memory_pool.clear()
    buffer = memory.empty((size,), np.uint8).buffer
    assert any(block.buffer is buffer for block in session.memory_pool)
    assert memory.empty((next_size,), np.uint8).buffer is buffer


def test_sizes_are_rounded_up_a_little():
    for size in (0, 1, 4096, 4097, 10**6, 2**31 + 1):
        assert size <= rounded(size) <= max(size + size // 8, size + 4096)
        assert rounded(rounded(size)) == rounded(size)


@pytest.mark.parametrize("shape", [SMALL, LARGE])
def test_systems_without_huge_pages(monkeypatch, shape):
    monkeypatch.delattr(mmap, "MADV_HUGEPAGE", raising=False)
    current().memory_pool.clear()
    array = memory.empty(shape, np.float32)
    array.fill(2.0)
    assert array.to_host().shape == shape and (array.to_host() == 2.0).all()


@pytest.mark.skipif(not hasattr(os, "fork") or sys.platform != "linux", reason="no fork here")
@pytest.mark.parametrize("shape", [SMALL, LARGE])
def test_a_forked_child_does_not_write_into_its_parents_arrays(shape):
    array = memory.empty(shape, np.float32)
    array.fill(2.0)
    host = array.to_host()
    child = os.fork()
    if child == 0:
        host[:] = -7.0
        os._exit(0)
    os.waitpid(child, 0)
    assert (host == 2.0).all()


def test_sizes_are_pythons_own_integers():
    """Callers multiply the sizes; the product of NumPy's integers could overflow."""
    made = memory.empty((np.int32(70_000), np.int64(2)), np.uint8)
    assert [type(size) for size in made.shape] == [int, int]


def refusing(error: BaseException) -> Callable[..., Any]:
    """A function that raises the error, whatever it is called with."""

    def refuse(*_: object, **__: object) -> None:
        raise error

    return refuse


def test_what_lies_idle_is_given_back_before_memory_counts_as_short(monkeypatch):
    session = current()
    memory.empty(LARGE, np.float32)
    assert list(session.memory_pool)
    answers = [refusing(OSError(errno.ENOMEM, "Cannot allocate memory")), memory._new]
    monkeypatch.setattr(memory, "_new", lambda *of: answers.pop(0)(*of))
    kept = memory.empty((3000, 1001), np.float32)
    assert kept.shape == (3000, 1001) and not answers and not list(session.memory_pool)


@pytest.mark.parametrize("error", [OSError(errno.ENOMEM, "no pages"), MemoryError(), cl.MemoryError("no room")])
def test_arrays_that_find_no_memory_say_how_much(monkeypatch, error):
    monkeypatch.setattr(memory, "_new", refusing(error))
    current().memory_pool.clear()
    with pytest.raises(ibr.OutOfMemoryError, match=r"not enough memory on .* for 12 MiB more") as caught:
        memory.empty((3000, 1000), np.float32)
    assert isinstance(caught.value, (ibr.Error, MemoryError)) and caught.value.__cause__ is error


def test_uploads_that_find_no_memory_say_how_much(monkeypatch):
    monkeypatch.setattr(cl, "Buffer", refusing(cl.MemoryError("no room")))
    for make in (memory.upload, memory.output):
        with pytest.raises(ibr.OutOfMemoryError, match="for 4 MiB more"):
            make(np.zeros((1024, 1024), np.float32))


@pytest.mark.parametrize("error", [MemoryError("Unable to allocate 3.4 GiB"), cl.MemoryError("no 3.4 GiB")])
def test_a_call_that_runs_out_of_memory_anywhere_says_so(error):
    """During a call, NumPy may run out of the host's memory, and OpenCL of the device's."""
    with pytest.raises(ibr.OutOfMemoryError, match=r"not enough memory on .*3\.4 GiB"), one_call():
        raise error
    with pytest.raises(ValueError, match="another"), one_call():
        raise ValueError("another")
    with pytest.raises(ibr.ArgumentError), one_call():
        raise ibr.ArgumentError("views", "fewer", "many")


def test_launches_that_find_no_memory_name_the_kernel(monkeypatch):
    array = memory.empty((1 << 20,), np.float32)
    clear(array, 0.0)
    monkeypatch.setattr(cl, "enqueue_nd_range_kernel", refusing(cl.MemoryError("no room")))
    with pytest.raises(ibr.OutOfMemoryError, match=r"for the 4 MiB that clear\(\) reads and writes"):
        clear(array, 0.0)


@pytest.mark.thorough
def test_things_go_with_their_last_use():
    """Memory is freed at once. The garbage collector would leave a recording's frames on the device for a long time."""
    made = calls()
    for call in made.values():
        call()  # fills caches that stay
    gc.collect()
    gc.disable()
    try:
        for name, call in made.items():
            call()
            left = [thing for thing in gc.get_objects(generation=0) if isinstance(thing, Immutable)]
            assert not left, name
    finally:
        gc.enable()
