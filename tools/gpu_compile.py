"""Ask GPU compilers, without a GPU, for each kernel's costs: registers, private memory, occupancy.

    python tools/gpu_compile.py [PART OF A FILE'S NAME ...] [--nvidia sm_80] [--amd gfx90a] [--json FILE]

The programs get the defines of `pyibr doctor --build`, but with LANES=1, which is the GPU form. Clang compiles them,
and NVIDIA's own assembler makes the code for NVIDIA. Private memory is the number of bytes per work-item that a kernel
keeps in the device's memory instead of registers. A multiprocessor can keep a limited number of groups of work-items
in flight; occupancy is the share of these for which there are enough registers, by the vendors' formulas.

Needs Debian's clang and libclc (`apt install clang-15 libclc-15`), and PyPI's nvidia-cuda-nvcc-cu12, which is fetched
into a cache folder once.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, cast

from pyibr.app.commands.doctor import PICTURES
from pyibr.opencl.device import current
from pyibr.opencl.headers import expanded
from tools.one_lane import one_lane

ASSEMBLER = "nvidia-cuda-nvcc-cu12"
LIBRARIES = Path("/usr/lib/clc")  # libclc: OpenCL's built-in functions
TARGETS = {"nvidia": ("nvptx64-nvidia-nvcl", "nvptx64--nvidiacl.bc"), "amd": ("amdgcn-amd-amdhsa", "amdgcn--amdhsa.bc")}
REGISTERS, WARP, WARPS = 65536, 32, 64  # in an NVIDIA multiprocessor; work-items per warp; most warps in flight
NOTES = r"; (?:NumVgprs|ScratchSize|Occupancy): (\d+)"  # lines in AMD's assembly; only kernels have an occupancy
WAVES = 8  # most waves that a unit of AMD's CDNA keeps in flight

Program = tuple[str, tuple[tuple[str, int], ...]]  # the file, and the defines with their values


@dataclass(frozen=True)
class Cost:
    """Cost of a kernel on one GPU."""

    registers: int
    private_bytes: int
    occupancy: float  # 0 to 1


@dataclass(frozen=True)
class Row:
    """Costs of a kernel for one set of defines."""

    file: str
    kernel: str
    defines: dict[str, int]
    nvidia: Cost
    amd: Cost


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="*", help="parts of the names of kernel files (default: all files)")
    parser.add_argument("--nvidia", default="sm_80", metavar="ARCHITECTURE")
    parser.add_argument("--amd", default="gfx90a", metavar="ARCHITECTURE")
    parser.add_argument("--all", action="store_true", help="list all sets of defines, not only each kernel's costliest")
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the table to this file")
    options = parser.parse_args()
    clang, ptxas = compiler(), assembler()
    wanted = [each for each in programs() if not options.files or any(part in each[0] for part in options.files)]
    with ThreadPoolExecutor() as pool:
        tables = list(pool.map(lambda each: rows(each, clang, ptxas, options.nvidia, options.amd), wanted))
    found = [row for table in tables for row in table]
    print(table_of(found if options.all else list(merged(found)), options.nvidia, options.amd))
    if options.json:
        options.json.write_text(json.dumps([asdict(row) for row in found], indent=1) + "\n")


def programs() -> list[Program]:
    """List the programs that the usual pictures need."""
    with one_lane():
        for draw in PICTURES:
            draw()
        return sorted({program for program, _ in cast("Iterable[tuple[Program, str]]", current().kernels)})


def compiler() -> str:
    """Find the newest clang; ends the process if clang or libclc is missing."""
    names = ["clang", *(f"clang-{version}" for version in range(30, 14, -1))]
    found = next((path for name in names if (path := shutil.which(name))), None)
    if found is None or not LIBRARIES.is_dir():
        sys.exit("needs clang and libclc: apt install clang-15 libclc-15")
    return found


def assembler() -> Path:
    """Find NVIDIA's assembler; downloads it if it is missing."""
    folder = Path(tempfile.gettempdir()) / ASSEMBLER
    ptxas = folder / "nvidia" / "cuda_nvcc" / "bin" / "ptxas"
    if not ptxas.exists():
        fetch = [sys.executable, "-m", "pip", "download", "-q", "--no-deps", "-d", str(folder), ASSEMBLER]
        subprocess.run(fetch, check=True)
        with zipfile.ZipFile(next(folder.glob("*.whl"))) as wheel:
            wheel.extract("nvidia/cuda_nvcc/bin/ptxas", folder)
        ptxas.chmod(0o755)
    return ptxas


def rows(program: Program, clang: str, ptxas: Path, nvidia: str, amd: str) -> list[Row]:
    """Compile a program; returns the costs of its kernels."""
    file, given = program
    defines = {**dict(given), "LANES": 1}
    with tempfile.TemporaryDirectory() as place:
        source = Path(place) / "program.cl"
        source.write_text(expanded(file))
        code = compiled(clang, source, defines, "nvidia", nvidia)
        told = ran([str(ptxas), f"-arch={nvidia}", "-v", str(code), "-o", "/dev/null"], file)
        costs = of_nvidia(told)
        others = of_amd(compiled(clang, source, defines, "amd", amd).read_text())
    return [Row(file, name, dict(given), costs[name], others[name]) for name in costs]


def compiled(clang: str, source: Path, defines: dict[str, int], vendor: str, architecture: str) -> Path:
    """Compile a program to a GPU's assembly."""
    target, library = TARGETS[vendor]
    language = ["-x", "cl", "-cl-std=CL1.2", "-cl-denorms-are-zero", "-O3", "-Xclang", "-finclude-default-header", "-w"]
    builtins = ["-Xclang", "-mlink-bitcode-file", "-Xclang", str(LIBRARIES / library), "-nogpulib"]
    given = [f"-D{name}={value}" for name, value in defines.items()]
    code = source.with_suffix(f".{vendor}")
    place = ["-target", target, f"-mcpu={architecture}" if vendor == "amd" else f"-march={architecture}"]
    ran([clang, *language, *place, *builtins, *given, "-Dcl_clang_storage_class_specifiers", "-S", str(source), "-o",
         str(code)], str(source))  # fmt: skip
    return code


def ran(command: list[str], file: str) -> str:
    """Run a command and return its output; ends the process if it fails."""
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"{file}: {done.stderr.strip()}")
    return done.stdout + done.stderr


def of_nvidia(told: str) -> dict[str, Cost]:
    """Parse the costs of kernels from the output of NVIDIA's assembler."""
    pattern = r"entry function '(\w+)'.*?(\d+) bytes stack frame.*?Used (\d+) registers"
    return {
        name: Cost(int(registers), int(stack), nvidia_occupancy(int(registers)))
        for name, stack, registers in re.findall(pattern, told, re.DOTALL)
    }


def nvidia_occupancy(registers: int) -> float:
    """Share of a multiprocessor's warps for which there are registers; a warp gets them in units of 256."""
    warp = -(-registers * WARP // 256) * 256
    return min(REGISTERS // warp, WARPS) / WARPS


def of_amd(code: str) -> dict[str, Cost]:
    """Parse the costs of kernels from the compiler's notes in AMD's assembly."""
    costs = dict[str, Cost]()
    for function in code.split("; -- Begin function ")[1:]:
        name, (registers, scratch, *waves) = function.split(maxsplit=1)[0], re.findall(NOTES, function)
        if waves:  # only kernels have an occupancy
            costs[name] = Cost(int(registers), int(scratch), int(waves[0]) / WAVES)
    return costs


def merged(found: Iterable[Row]) -> Iterable[Row]:
    """Keep the costliest row of each kernel."""
    most = dict[tuple[str, str], Row]()
    for row in found:
        before = most.get((row.file, row.kernel))
        if before is None or _weight(row) > _weight(before):
            most[row.file, row.kernel] = row
    return most.values()


def _weight(row: Row) -> tuple[int, int]:
    return row.nvidia.private_bytes + row.amd.private_bytes, row.nvidia.registers


def table_of(found: list[Row], nvidia: str, amd: str) -> str:
    """Make a Markdown table of all rows."""
    lines = [
        f"| kernel | defines | {nvidia}: registers | private bytes | occupancy "
        f"| {amd}: registers | private bytes | occupancy |",
        "|---|---|---|---|---|---|---|---|",
    ]

    def cells(cost: Cost) -> Any:
        return f"{cost.registers} | {cost.private_bytes} | {100 * cost.occupancy:.0f} %"

    for row in sorted(found, key=_weight, reverse=True):
        given = ", ".join(f"{name}={value}" for name, value in row.defines.items())
        lines.append(f"| `{row.kernel}` | {given} | {cells(row.nvidia)} | {cells(row.amd)} |")
    return "\n".join(lines)


if __name__ == "__main__":
    main()
