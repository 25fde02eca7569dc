"""Runs the kernels' tests on a real GPU, compares its pictures with a CPU's, and times its calls.

Without a GPU nothing is measured, and the report says so.
"""

from __future__ import annotations

import functools
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from typing import Any

import numpy as np
import pyopencl as cl
from numpy.typing import NDArray

import pyibr as ibr
from benchmarks.cases import Plan, Size
from benchmarks.gpu.calls import CALLS
from benchmarks.launches import kernel_times
from benchmarks.results import Parameter, Record, Skip
from benchmarks.runner import Case, Work, in_turns
from benchmarks.scenes import shown
from pyibr.opencl.device import current
from tools.everything import calls
from tools.processes import run_within

TESTS_SECONDS = 300
TURNS = 9
SAME = 1e-5
"""Relative difference of depths that another compiler may cause, as in the tests with one lane."""
ALIKE = 0.999
"""Fraction of the values that must be the same. At silhouettes, rounding decides which surface a pixel shows."""


def cases(plan: Plan) -> Iterator[Case]:
    """Yield cases of tests, then of pictures, then of times."""
    device = next((one for one in ibr.devices() if one.works and one.kind == plan.card), None)
    if device is None:
        missing = Skip("everything", f"there is no working device of the kind {plan.card}")
        yield Case({"case": "card"}, lambda: missing)
        return
    yield Case({"case": "tests"}, functools.partial(_tested, device, plan.card_tests))
    for name in calls():
        yield Case({"picture": name}, functools.partial(_compared, device, name))
    yield Case({"case": "private memory"}, functools.partial(_private, device))
    for name, size in plan.gpu:
        parameters: dict[str, Parameter] = {"call": name, "size": shown(size)}
        yield Case(parameters, functools.partial(_timed, device, name, size, parameters))


def _tested(device: ibr.Device, tests: tuple[str, ...]) -> Work:
    def read() -> Iterator[Record]:
        command = [sys.executable, "-m", "pytest", "-q", "-n", "logical", "--dist", "worksteal"]
        command += ["-m", "not thorough", *tests]
        try:
            told = run_within(TESTS_SECONDS, command, PYIBR_DEVICE=str(device.index)).stdout
        except subprocess.TimeoutExpired:
            told = "1 error: not done in time"
        for outcome in ("passed", "failed", "error", "skipped"):
            found = re.search(rf"(\d+) {outcome}", told)
            yield Record(outcome, "tests", "count", {}, [int(found[1]) if found else 0])

    return Work(read=read)


def _compared(device: ibr.Device, name: str) -> Work | Skip:
    other = next((one for one in ibr.devices() if one.works and one.kind == "cpu"), None)
    if other is None:
        return Skip(name, "there is no CPU device to compare with")

    def read() -> Iterator[Record]:
        with ibr.use_device(device):
            found = calls()[name]()
        with ibr.use_device(other):
            expected = calls()[name]()
        pairs = list(zip(found, expected, strict=True))
        yield Record(name, "alike", "share", {}, [min(alike(one, two) for one, two in pairs)])
        yield Record(name, "the same", "share", {}, [min(alike(one, two, 0) for one, two in pairs)])

    return Work(read=read)


def _private(device: ibr.Device) -> Work:
    """Ask the driver how much private memory each kernel of the pictures uses."""

    def read() -> Iterator[Record]:
        with ibr.use_device(device):
            session, most = current(), Counter[str]()
        for kernel in session.kernels.values():
            wanted = cl.kernel_work_group_info.PRIVATE_MEM_SIZE
            most |= Counter({kernel.name: kernel.handle.get_work_group_info(wanted, session.context.devices[0])})
        yield from (Record(name, "private", "bytes", {}, [size]) for name, size in most.items())
        yield Record("kernels", "number", "count", {}, [len({kernel.name for kernel in session.kernels.values()})])

    return Work(read=read)


def alike(found: NDArray[Any], expected: NDArray[Any], up_to: float = SAME) -> float:
    """Return the fraction of values that are the same up to rounding; 0 if the arrays' shapes differ."""
    if found.shape != expected.shape:
        return 0.0
    if found.dtype.kind == "f":
        return float(np.isclose(found, expected, rtol=up_to, atol=up_to, equal_nan=True).mean()) if found.size else 1.0
    step = found.dtype == np.uint8 and up_to > 0
    return float((abs(found.astype(int) - expected) <= step).mean()) if found.size else 1.0


def _timed(device: ibr.Device, name: str, size: Size, parameters: dict[str, Parameter]) -> Work | Skip:
    with ibr.use_device(device):
        work = CALLS[name](size)
    if isinstance(work, Skip):
        return work

    def read() -> Iterator[Record]:
        with ibr.use_device(device):
            times = in_turns({name: work}, TURNS)[name]
            with kernel_times() as launches:
                work()
        yield Record(name, "end to end", "ms", parameters, times)
        for kernel, values in launches.items():
            yield Record(kernel, "kernel", "ms", parameters, [sum(values)])

    return Work(read=read)
