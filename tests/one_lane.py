"""Tests of kernels in the form for GPUs, whose frames may differ a little, and of reads and writes beyond arrays."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from pyibr.images import Frame
from pyibr.opencl import device
from tools.one_lane import one_lane as one_lane
from tools.processes import said_under_oclgrind


def skip_where_unused(lanes: int) -> None:
    """Skip a test with several lanes on devices whose kernels have one lane, such as GPUs."""
    if lanes > 1 and device.current().profile.lanes == 1:
        pytest.skip("this device's kernels have one lane")


def both_forms(make: Callable[[], Any]) -> tuple[Any, Any]:
    """Results of the device's own form of the kernels, and of that of one lane."""
    wide = make()
    with one_lane():
        return wide, make()


def unlike(one: Frame, other: Frame, rtol: float = 1e-4, levels: int = 1) -> tuple[float, float, float]:
    """Fractions that differ by more: of pixels shown, of depths in both frames, and of colours where depths agree."""
    both = one.valid & other.valid
    depths = np.isclose(one.depth, other.depth, rtol=rtol, atol=0)
    colors = np.abs(one.color.astype(int) - other.color)[both & depths] <= levels
    return float((one.valid != other.valid).mean()), float((~depths[both]).mean()), float((~colors).mean())


def check_bounds(script: str) -> None:
    """Run a script under Oclgrind, which detects reads and writes beyond the arrays."""
    if shutil.which("oclgrind") is None:
        pytest.skip("oclgrind is not installed (apt-get install oclgrind)")
    script += "\nfrom pyibr.opencl import device\nprint('done on', device.current().device.name)\n"
    said = said_under_oclgrind(("-W", "ignore", "-c", script), seconds=300)
    assert "done on Oclgrind" in said, said
