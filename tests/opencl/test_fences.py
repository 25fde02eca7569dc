"""Kernels, in both forms, stay within their arrays, which lie between protected pages, and under Oclgrind.

Oclgrind's check for uninitialized values is not used: it crashes in some kernels, and reports converted numbers.
"""

from __future__ import annotations

import shutil
import signal
import sys

import pytest

from pyibr.opencl.headers import kernels_folder
from tests.opencl.cases import GROUPS
from tools.processes import run_within, said_under_oclgrind

pytestmark = pytest.mark.thorough

linux = pytest.mark.skipif(sys.platform != "linux", reason="pages are protected by Linux' mprotect")

STEP = """
import sys
import numpy as np
import pyopencl as cl
from pyibr.opencl.device import current
from pyibr.opencl.memory import empty, upload
from tests.opencl.fences import raise_fences

where, of = sys.argv[1:]
session = current()
raise_fences(where)
given, made = upload(np.arange(1, 8, dtype=np.uint8)), empty((7,), np.uint8)
source = '''
kernel void put(global const uchar *given, global uchar *made, int from, int to, int given_too)
{
    made[to] = given[from];
    if (given_too)
        ((global uchar *)given)[0] = 9;
}'''
put = cl.Kernel(cl.Program(session.context, source).build(), "put")
for by in (0, 1):
    off = 6 + by if where == "end" else -by
    steps = {"reads": (off, 3, 0), "writes": (3, off, 0), "changes": (3, 3, by)}[of]
    put(session.queue, (1,), None, given.buffer, made.buffer, *map(np.int32, steps))
    session.queue.finish()
    print("through", by, flush=True)
"""


@linux
@pytest.mark.parametrize("where", ["start", "end"])
@pytest.mark.parametrize("of", ["reads", "writes", "changes"])
def test_a_byte_too_far_ends_the_process(where, of):
    """If it did not, the runtime would not use memory in place, and the next test would prove nothing."""
    done = run_within(1800, [sys.executable, "-c", STEP, where, of])
    assert done.stdout == "through 0\n" and done.returncode == -signal.SIGSEGV, done.stderr


@linux
@pytest.mark.parametrize("lanes", [16, 1])
@pytest.mark.parametrize("group", GROUPS)
def test_no_kernel_leaves_its_arrays(group, lanes):
    """Kernels terminate and stay within their arrays, even if numbers in their structs are replaced by invalid ones."""
    done = run_within(1800, [sys.executable, "-m", "tests.opencl.fences", group, str(lanes)])
    last = done.stdout.splitlines()[-1:]
    assert done.returncode == 0, f"{done.returncode} in {last}, {done.stderr[-2000:]}"
    assert last == [f"through in lanes: {lanes}"]


@pytest.mark.skipif(shutil.which("oclgrind") is None, reason="Oclgrind is not installed (apt-get install oclgrind)")
@pytest.mark.parametrize("group", GROUPS)
def test_no_kernel_reads_or_writes_what_is_not_its_own(group: str):
    said = said_under_oclgrind(("-m", "tests.opencl.cases", group), seconds=600)
    assert "\nthrough on Oclgrind\n" in said, said[-3000:]


def test_every_folder_of_kernels_has_cases():
    folders = {path.parent.name for path in kernels_folder().glob("*/*.cl")}
    assert folders == {folder for folders, _ in GROUPS.values() for folder in folders}
