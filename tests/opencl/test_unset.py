"""Kernels never look at a variable that was not set.

PoCL hands what follows a tab in an option to clang, which gives such variables a value of its own choice then: NaN, or
a negative number far off.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pyopencl as cl
import pytest

from pyibr.opencl import device, program
from pyibr.opencl.flight import Flight
from pyibr.opencl.spare import Spare
from tests.opencl.everything import calls, same

_quietly_built = program._quietly_built


def set_by_clang(made: cl.Program, options: list[str]) -> cl.Program:
    return _quietly_built(made, [*options, "-DUNSET=1\t-ftrivial-auto-var-init=pattern"])


@pytest.fixture
def pocl() -> device.Session:
    session = device.current()
    if "Portable" not in session.device.platform:
        pytest.skip("other runtimes than PoCL do not hand clang's own options on")
    return session


def test_clang_sets_what_is_unset(pocl):
    text = "kernel void seen(global float *out, int n) { float a[4]; if (n > 4) a[n & 3] = 1.0f; *out = a[n]; }"
    out, buffer = np.zeros(1, np.float32), cl.Buffer(pocl.context, cl.mem_flags.READ_WRITE, 4)
    cl.Kernel(set_by_clang(cl.Program(pocl.context, text), []), "seen")(pocl.queue, (1,), None, buffer, np.int32(2))
    cl.enqueue_copy(pocl.queue, out, buffer)
    assert np.isnan(out)


@contextmanager
def built_by(
    build: Callable[[cl.Program, list[str]], cl.Program], session: device.Session, cache: Path
) -> Iterator[None]:
    """All kernels are built by this function, without optimisation: in half the time, and what is unset stays so."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYIBR_CACHE", str(cache))  # no other process takes these programs for its own
        patch.setenv("PYIBR_DEVICE", str(session.device.index))  # whichever a new cache finds to be faster
        patch.setattr(program, "_OPTIONS", [*program._OPTIONS, "-cl-opt-disable"])
        patch.setattr(program, "_quietly_built", build)
        fresh = dataclasses.replace(session, kernels={}, spare=Spare(), flight=Flight())
        patch.setitem(device._sessions, session.device.index, fresh)
        device._default_session.cache_clear()
        assert device.current() is fresh
        yield
    device._default_session.cache_clear()


def test_no_picture_depends_on_what_is_unset(pocl, tmp_path):
    with built_by(_quietly_built, pocl, tmp_path / "plain"):
        expected = {name: call() for name, call in calls().items()}
    with built_by(set_by_clang, pocl, tmp_path / "set"):
        for name, call in calls().items():
            assert same(call(), expected[name]), name
