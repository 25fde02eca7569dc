"""Tests of kernels in the form for GPUs, and of reads and writes beyond arrays."""

from __future__ import annotations

import shutil

import pytest

from pyibr.opencl import device
from tools.one_lane import one_lane as one_lane
from tools.processes import said_under_oclgrind


def skip_where_unused(lanes: int) -> None:
    """Skip a test with several lanes on devices whose kernels have one lane, such as GPUs."""
    if lanes > 1 and device.current().profile.lanes == 1:
        pytest.skip("this device's kernels have one lane")


def check_bounds(script: str) -> None:
    """Run a script under Oclgrind, which detects reads and writes beyond the arrays."""
    if shutil.which("oclgrind") is None:
        pytest.skip("oclgrind is not installed (apt-get install oclgrind)")
    script += "\nfrom pyibr.opencl import device\nprint('done on', device.current().device.name)\n"
    said = said_under_oclgrind(("-W", "ignore", "-c", script), seconds=300)
    assert "done on Oclgrind" in said, said
