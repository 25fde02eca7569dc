"""Arrays on the device: whose memory they are, and for how long."""

from __future__ import annotations

import gc
import mmap
import os
import sys

import numpy as np
import pytest

from pyibr.opencl import memory
from pyibr.opencl.device import current

SMALL, LARGE = (100, 100), (1500, 1001)  # below and above a huge page


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


def test_memory_is_handed_out_again():
    session = current()
    session.spare.clear()
    array = memory.empty(LARGE, np.float32)
    buffer = array.buffer
    del array
    gc.collect()
    assert any(block.buffer is buffer for block in session.spare)
    assert memory.empty(LARGE, np.float32).buffer is buffer


def test_spare_memory_is_bounded(monkeypatch):
    monkeypatch.setattr(memory, "_SPARE_BYTES", 10_000_000)
    arrays = [memory.empty(LARGE, np.float32) for _ in range(5)]  # 6 MB each
    del arrays
    gc.collect()
    assert sum(block.size for block in current().spare) <= 10_000_000


@pytest.mark.parametrize("shape", [SMALL, LARGE])
def test_systems_without_huge_pages(monkeypatch, shape):
    monkeypatch.delattr(mmap, "MADV_HUGEPAGE", raising=False)
    current().spare.clear()
    array = memory.empty(shape, np.float32)
    array.fill(2.0)
    assert array.to_host().shape == shape
    assert (array.to_host() == 2.0).all()


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
