"""Kernels under Oclgrind, which sees what they read and write beyond arrays.

Its search for values that are unset ends the process in some kernels, and takes numbers that were converted for such.
"""

from __future__ import annotations

import shutil
import subprocess
import sys

import pytest

from tests.opencl.cases import FOLDERS
from tests.processes import with_path

pytestmark = pytest.mark.thorough


@pytest.mark.skipif(shutil.which("oclgrind") is None, reason="Oclgrind is not installed (apt-get install oclgrind)")
@pytest.mark.parametrize("folder", FOLDERS)
def test_no_kernel_reads_or_writes_what_is_not_its_own(folder: str):
    command = ("oclgrind", "--check-api", sys.executable, "-m", "tests.opencl.cases", folder)
    variables = with_path(PYIBR_DEVICE="oclgrind")
    done = subprocess.run(command, env=variables, capture_output=True, text=True, timeout=1800)
    said = done.stdout + done.stderr
    assert done.stdout.endswith("through on Oclgrind\n"), said[-3000:]
    for report in ("Invalid read", "Invalid write"):
        assert report not in said, said[max(said.index(report) - 500, 0) :][:3000]
