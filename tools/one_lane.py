"""Kernels in the form for GPUs, in which each work-item has one lane, run on any device."""

from __future__ import annotations

import dataclasses
from collections import defaultdict
from collections.abc import Generator
from contextlib import contextmanager
from functools import cache
from typing import Any

from pyibr.opencl import device
from pyibr.opencl.in_flight import InFlight
from pyibr.opencl.memory_pool import MemoryPool
from pyibr.opencl.profile import GPU


@cache  # so that its kernels are built once
def _of_one_lane(session: device.Session, **changed: Any) -> device.Session:
    # A fixed size of work-groups, since PoCL compiles a kernel anew for each size that it chooses.
    own = {"kernels": {}, "memory_pool": MemoryPool(), "flights": defaultdict(InFlight)}
    return dataclasses.replace(session, profile=dataclasses.replace(GPU, **{"group": (1, 1, 1), **changed}), **own)


@contextmanager
def one_lane(**changed: Any) -> Generator[None, None, None]:
    """Run kernels with one lane within the context, and copy memory between host and device.

    `changed` holds fields of the device's profile, `pyibr.opencl.profile`, with other values.
    """
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
