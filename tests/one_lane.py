"""The kernels' GPU form on whatever device there is."""

from __future__ import annotations

import dataclasses
import shutil
from collections import defaultdict
from collections.abc import Generator
from contextlib import contextmanager
from functools import cache
from typing import Any

import pytest

from pyibr.opencl import device
from pyibr.opencl.in_flight import InFlight
from pyibr.opencl.memory_pool import MemoryPool
from pyibr.opencl.profile import GPU
from tests.processes import said_under_oclgrind


@cache  # so that its kernels are built once
def _of_one_lane(session: device.Session, **changed: Any) -> device.Session:
    # Of the sizes of work-groups that it may choose, PoCL compiles each anew.
    own = {"kernels": {}, "memory_pool": MemoryPool(), "flights": defaultdict(InFlight)}
    return dataclasses.replace(session, profile=dataclasses.replace(GPU, **{"group": (1, 1, 1), **changed}), **own)


@contextmanager
def one_lane(**changed: Any) -> Generator[None, None, None]:
    """Within it kernels have one lane, and memory is copied to and fro; `changed`: of the GPUs' profile."""
    session = device.current()
    index = session.device.index
    device._sessions[index] = _of_one_lane(session, **changed)
    device._default_session.cache_clear()
    try:
        assert device.current().profile.lanes == 1
        yield
    finally:
        device._sessions[index] = session
        device._default_session.cache_clear()


def skip_where_unused(lanes: int) -> None:
    """GPUs' compilers are given one lane alone."""
    if lanes > 1 and device.current().profile.lanes == 1:
        pytest.skip("this device's kernels have one lane")


def check_bounds(script: str) -> None:
    """Run a script under Oclgrind, which sees reads and writes beyond the arrays."""
    if shutil.which("oclgrind") is None:
        pytest.skip("oclgrind is not installed (apt-get install oclgrind)")
    script += "\nfrom pyibr.opencl import device\nprint('done on', device.current().device.name)\n"
    said = said_under_oclgrind(("-W", "ignore", "-c", script), seconds=300)
    assert "done on Oclgrind" in said, said
