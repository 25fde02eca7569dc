"""The kernels' GPU form on whatever device there is."""

from __future__ import annotations

import dataclasses
import shutil
import subprocess
import sys
from collections.abc import Generator
from contextlib import contextmanager

import pytest

from pyibr.opencl import device
from pyibr.opencl.in_flight import InFlight
from pyibr.opencl.memory_pool import MemoryPool
from pyibr.opencl.profile import GPU
from tests.processes import with_path


@contextmanager
def one_lane() -> Generator[None, None, None]:
    """Within it kernels have one lane, and memory is copied to and fro."""
    session = device.current()
    # Of the sizes of work-groups that it may choose, PoCL compiles each anew.
    profile = dataclasses.replace(GPU, local_size=1)
    index = session.device.index
    device._sessions[index] = dataclasses.replace(
        session, profile=profile, kernels={}, memory_pool=MemoryPool(), in_flight=InFlight()
    )
    device._default_session.cache_clear()
    try:
        assert device.current().profile.lanes == 1
        yield
    finally:
        device._sessions[index] = session
        device._default_session.cache_clear()


def check_bounds(script: str) -> None:
    """Run a script under Oclgrind, which sees reads and writes beyond the arrays."""
    if shutil.which("oclgrind") is None:
        pytest.skip("oclgrind is not installed (apt-get install oclgrind)")
    script += "\nfrom pyibr.opencl import device\nprint('done on', device.current().device.name)\n"
    command = ("oclgrind", "--check-api", sys.executable, "-W", "ignore", "-c", script)
    variables = with_path(PYIBR_DEVICE="oclgrind")
    result = subprocess.run(command, env=variables, capture_output=True, text=True, timeout=300)
    assert "done on Oclgrind" in result.stdout, result.stdout + result.stderr
    for report in ("Invalid read", "Invalid write"):
        assert report not in result.stdout + result.stderr, (result.stdout + result.stderr)[:3000]
