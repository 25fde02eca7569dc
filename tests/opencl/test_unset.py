"""Kernels never read uninitialized variables.

PoCL passes everything after a tab in an option on to clang. By the option below, clang sets uninitialized variables to
NaN or to a large negative number.
"""

from __future__ import annotations

import dataclasses
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pyopencl as cl
import pytest

from pyibr.opencl import device, program
from pyibr.opencl.in_flight import InFlight
from pyibr.opencl.memory_pool import MemoryPool
from tools.everything import calls, same

pytestmark = pytest.mark.thorough

SET_BY_CLANG = "-DUNSET=1\t-ftrivial-auto-var-init=pattern"


@pytest.fixture
def pocl() -> device.Session:
    session = device.current()
    if "Portable" not in session.device.platform:
        pytest.skip("only PoCL passes options on to clang")
    return session


def test_clang_sets_what_is_unset(pocl):
    text = "kernel void seen(global float *out, int n) { float a[4]; if (n > 4) a[n & 3] = 1.0f; *out = a[n]; }"
    out, buffer = np.zeros(1, np.float32), cl.Buffer(pocl.context, cl.mem_flags.READ_WRITE, 4)
    built = program._quietly_built(cl.Program(pocl.context, text), [SET_BY_CLANG])
    cl.Kernel(built, "seen")(pocl.queue, (1,), None, buffer, np.int32(2))
    cl.enqueue_copy(pocl.queue, out, buffer)
    assert np.isnan(out)


@contextmanager
def built_with(session: device.Session, *options: str) -> Iterator[None]:
    """Build all kernels again with these options, and without optimisation, which halves the time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(program, "_OPTIONS", [*program._OPTIONS, "-cl-opt-disable", *options])
        fresh = dataclasses.replace(session, kernels={}, memory_pool=MemoryPool(), flights=defaultdict(InFlight))
        patch.setitem(device._sessions, session.device.index, fresh)
        device._default_session.cache_clear()
        assert device.current() is fresh
        yield
    device._default_session.cache_clear()


def test_no_picture_depends_on_what_is_unset(pocl):
    expected = {name: call() for name, call in calls().items()}
    with built_with(pocl, SET_BY_CLANG):
        for name, call in calls().items():
            assert same(call(), expected[name]), name
