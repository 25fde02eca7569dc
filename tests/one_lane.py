"""The kernels' GPU form on whatever device there is."""

from __future__ import annotations

import dataclasses
from collections.abc import Generator
from contextlib import contextmanager

from pyibr.opencl import device


@contextmanager
def one_lane() -> Generator[None, None, None]:
    """Within it kernels have one lane, and memory is copied to and fro."""
    session = device.current()
    index = session.device.index
    device._sessions[index] = dataclasses.replace(session, lanes=1, is_cpu=False, kernels={}, spare=[], in_flight=[])
    device._default_session.cache_clear()
    try:
        assert device.current().lanes == 1
        yield
    finally:
        device._sessions[index] = session
        device._default_session.cache_clear()
