"""Counts a GPU's work without a GPU: launches and copies of each call, and instructions of each kernel.

Each call draws the second frame of kept views. Launches, waits, copies and work-items are counted on any device that
runs the kernels' GPU form. Oclgrind counts instructions and bytes at a smaller size, to be scaled by the pixels.
"""

from __future__ import annotations

import functools
import math
import re
import shutil
import sys
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import cast

from benchmarks.cases import Plan, Size
from benchmarks.gpu.calls import CALLS
from benchmarks.gpu.counted import LAUNCH, PIECE
from benchmarks.results import Parameter, Record, Skip
from benchmarks.runner import Case, Work
from benchmarks.scenes import shown
from pyibr.opencl.device import current
from pyibr.opencl.watch import Traffic, watching
from tools import gpu_compile
from tools.one_lane import one_lane
from tools.processes import run_within

_SECONDS = 1200  # limit for a call under Oclgrind
_LATENCY = 4  # cycles from an instruction to one that needs its result
_NO_WORK = re.compile(
    r"(alloca|bitcast|br|getelementptr|phi|ret|sext|switch|trunc|unreachable|zext|\w+ private"
    r"|call llvm\.(lifetime|dbg|mem)\S*|call (?!_Z|llvm)\w+)\b"
)
"""Instructions that compilers remove: private memory becomes registers, addresses are folded, calls are inlined."""


@dataclass(frozen=True)
class Card:
    """A GPU, with its maker's published figures."""

    bytes_per_second: float
    operations_per_second: float  # a multiplication with an addition counts as two
    clock: float  # Hz

    def seconds(self, cost: Cost) -> float:
        """Lower bound of a kernel's time: the greatest of its times for bytes, instructions, and chains."""
        return max(
            (cost.read + cost.written) / self.bytes_per_second,
            cost.instructions / (self.operations_per_second / 2),
            cost.chain * _LATENCY / self.clock,
        )


CARDS = {
    "NVIDIA A100 40 GB": Card(1555e9, 19.5e12, 1.41e9),
    "NVIDIA RTX A4500": Card(640e9, 23.7e12, 1.65e9),
    "AMD MI210": Card(1638e9, 22.6e12, 1.7e9),
}


@dataclass
class Cost:
    """Cost of a kernel's launches in a call.

    Attributes
    ----------
    chain : float
        Instructions in sequence: the most in one work-item of a launch, added over the launches. Only work-items that
        were counted alone are compared.
    """

    items: float = 0
    instructions: float = 0
    read: float = 0
    written: float = 0
    chain: float = 0


@dataclass
class _Counts:
    """Instructions and bytes of one launch so far."""

    kernel: str
    items: int
    cost: Cost = field(default_factory=Cost)


def cases(plan: Plan) -> Iterator[Case]:
    """One case per call and size."""
    for (name, size), small in plan.gpu.items():
        parameters: dict[str, Parameter] = {"call": name, "size": shown(size)}
        yield Case(parameters, functools.partial(_prepare, name, size, small, parameters))


def _prepare(name: str, size: Size, small: Size | None, parameters: dict[str, Parameter]) -> Work | Skip:
    if small is None:
        return Skip(f"instructions of {name}", "a simulator would take hours")
    if shutil.which("oclgrind") is None:
        return Skip("instructions on GPUs", "oclgrind is not installed")
    if isinstance(work := CALLS[name](small), Skip):
        return work

    def read() -> Iterator[Record]:
        traffic, registers = _traffic_of(name, size)
        for what, unit in (("launch", "count"), ("wait", "count"), ("upload", "bytes"), ("download", "bytes")):
            amount = traffic.count(what) if unit == "count" else traffic.total(what)
            yield Record(name, what, unit, parameters, [amount])
        costs = _grown(_counted(name, small), math.prod(size) / math.prod(small), traffic)
        for kernel, cost in costs.items():
            for quantity, value in vars(cost).items():
                unit = "bytes" if quantity in ("read", "written") else "count"
                yield Record(kernel, quantity, unit, parameters, [value])
            for quantity, value in registers.get(kernel, {}).items():
                yield Record(kernel, quantity, "count", parameters, [value])
        for card, figures in CARDS.items():
            yield Record(card, "bound", "ms", parameters, [1e3 * sum(map(figures.seconds, costs.values()))])

    return Work(read=read)


def _traffic_of(name: str, size: Size) -> tuple[Traffic, dict[str, dict[str, float]]]:
    """Count a call's launches and copies at its full size, and get the compilers' figures for its kernels."""
    with one_lane():
        work = CALLS[name](size)
        assert not isinstance(work, Skip)
        work()
        with watching(Traffic()) as traffic:
            work()
        return traffic, _registers({kernel for kind, kernel, _ in traffic.of if kind == "launch"})


def _registers(kernels: set[str]) -> dict[str, dict[str, float]]:
    """Registers and private bytes of each kernel, for the defines that need most; empty without compilers for GPUs."""
    try:
        clang, ptxas = gpu_compile.compiler(), gpu_compile.assembler()
    except SystemExit:
        return {}
    built = cast("Iterable[tuple[gpu_compile.Program, str]]", current().kernels)
    programs = {program for program, kernel in built if kernel in kernels}
    found = [row for each in sorted(programs) for row in gpu_compile.rows(each, clang, ptxas, "sm_80", "gfx90a")]
    return {
        row.kernel: {
            "registers, sm_80": row.nvidia.registers,
            "private, sm_80": row.nvidia.private_bytes,
            "registers, gfx90a": row.amd.registers,
            "private, gfx90a": row.amd.private_bytes,
        }
        for row in gpu_compile.merged(found)
        if row.kernel in kernels
    }


def _counted(name: str, size: Size) -> list[_Counts]:
    """Run a call under Oclgrind, and return the counts of its launches."""
    command = ["oclgrind", "--inst-counts", "--build-options", "-cl-opt-disable -DINLINED=static", sys.executable]
    command += ["-m", "benchmarks.gpu.counted", name, *map(str, size)]
    done = run_within(_SECONDS, command, PYIBR_DEVICE="oclgrind")
    if done.returncode:
        raise RuntimeError(f"{name} under Oclgrind: {done.stderr[-2000:]}")
    return parsed(done.stdout)


def parsed(told: str) -> list[_Counts]:
    """Parse the counts of launches in the output of `benchmarks.gpu.counted`, which Oclgrind's lines interleave."""
    launches: list[_Counts] = []
    alone, here = False, 0
    for line in told.splitlines():
        words = line.split()
        if line.startswith(LAUNCH):
            launches.append(_Counts(words[2], int(words[3])))
        elif line.startswith(PIECE):
            alone, here = int(words[2]) == 1, 0
        elif launches and (match := re.fullmatch(r"\s*([\d,]+) - (.+?)(?: \(([\d,]+) bytes\))?", line)):
            count, opcode, nbytes = match.groups()
            cost, number = launches[-1].cost, int(count.replace(",", ""))
            if not _NO_WORK.match(opcode):
                cost.instructions += number
                here += number
                cost.chain = max(cost.chain, here if alone else 0)
            if nbytes and re.match(r"\w+ (global|constant)", opcode):
                moved = int(nbytes.replace(",", ""))
                cost.read += moved * opcode.startswith("load")
                cost.written += moved * opcode.startswith("store")
    return [launch for launch in launches if launch.items]


def _grown(small: list[_Counts], growth: float, traffic: Traffic) -> dict[str, Cost]:
    """Scale costs to the call's full size by the growth in pixels; only work-items are counted at the full size."""
    items, of = defaultdict[str, int](int), defaultdict[str, Cost](Cost)
    for kind, kernel, count in traffic.of:
        items[kernel] += count if kind == "launch" else 0
    counted = defaultdict[str, int](int)
    for launch in small:
        counted[launch.kernel] += launch.items
        cost = of[launch.kernel]
        cost.instructions += growth * launch.cost.instructions
        cost.read += growth * launch.cost.read
        cost.written += growth * launch.cost.written
        cost.chain += launch.cost.chain
    for kernel, cost in of.items():
        cost.items = items[kernel]
        cost.chain *= growth * counted[kernel] / max(items[kernel], 1)  # as the instructions of the mean work-item
    return dict(of)
