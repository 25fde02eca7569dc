"""Kernels under Oclgrind, which detects accesses outside of arrays.

Oclgrind's check for uninitialized values is not used: it crashes in some kernels, and reports converted numbers.
"""

from __future__ import annotations

import shutil

import pytest

from tests.opencl.cases import GROUPS
from tests.processes import said_under_oclgrind

pytestmark = pytest.mark.thorough


@pytest.mark.skipif(shutil.which("oclgrind") is None, reason="Oclgrind is not installed (apt-get install oclgrind)")
@pytest.mark.parametrize("group", GROUPS)
def test_no_kernel_reads_or_writes_what_is_not_its_own(group: str):
    said = said_under_oclgrind(("-m", "tests.opencl.cases", group), seconds=600)
    assert "\nthrough on Oclgrind\n" in said, said[-3000:]
