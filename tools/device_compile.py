"""Compile every kernel for GPUs of NVIDIA, AMD and Intel, which this machine need not have.

    python tools/device_compile.py [PART OF A FILE'S NAME ...]

The tests' calls of all systems and the usual pictures decide which programs are compiled, and with which defines. All
have the GPU form. For NVIDIA, clang makes PTX, and NVIDIA's assembler makes each card's code from it. For AMD, clang
makes the code. For Intel, a translator makes SPIR-V, which Intel's drivers accept.

Needs the same tools as `tools/gpu_compile.py`, and Debian's llvm-spirv of clang's version (`apt install
llvm-spirv-15`).
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import cast

from pyibr.app.commands.doctor import PICTURES
from pyibr.opencl.device import current
from pyibr.opencl.headers import expanded
from tools.everything import calls
from tools.gpu_compile import Program, assembler, compiled, compiler, ran
from tools.one_lane import one_lane

NVIDIA = ("sm_75", "sm_90")
AMD = ("gfx1100", "gfx90a")
# Not optimized: that could make 31-bit integers, which SPIR-V does not have. Drivers optimize SPIR-V later.
SPIRV = ["-target", "spir64", "-x", "cl", "-cl-std=CL1.2", "-Xclang", "-disable-llvm-passes", "-w"]
SPIRV += ["-Xclang", "-finclude-default-header"]
VALIDATOR = "spirv-val"  # from Debian's spirv-tools, used if installed


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="*", help="parts of the names of kernel files (default: all files)")
    options = parser.parse_args()
    clang, ptxas = compiler(), assembler()
    wanted = [each for each in programs() if not options.files or any(part in each[0] for part in options.files)]
    count = 0
    with ThreadPoolExecutor() as pool:
        for faults in pool.map(lambda each: faults_of(each, clang, ptxas), wanted):
            count += len(faults)
            print(*faults, sep="\n", end="\n" * bool(faults), flush=True)
    print(f"{len(wanted)} programs for {', '.join([*NVIDIA, *AMD, 'SPIR-V'])}: {count or 'no'} faults")
    sys.exit(bool(count))


def programs() -> list[Program]:
    """List the programs that calls of all systems need, for colours in bytes, colours in floats, and no colours."""
    with one_lane():
        for draw in (*PICTURES, *calls().values()):
            draw()
        built = {program for program, _ in cast("Iterable[tuple[Program, str]]", current().kernels)}
    others = [{"COLOR_BYTES": 4}, {"CHANNELS": 0}]
    kinds = {(file, tuple({**dict(given), **other}.items())) for file, given in built for other in others
             if other.keys() <= dict(given).keys()}  # fmt: skip
    return sorted(built | kinds)


def faults_of(program: Program, clang: str, ptxas: Path) -> list[str]:
    """List the devices for which a program does not compile, each with the compiler's message."""
    file, given = program
    defines, faults = {**dict(given), "LANES": 1}, list[str]()
    with tempfile.TemporaryDirectory() as place:
        source = Path(place) / "program.cl"
        source.write_text(expanded(file))

        def for_nvidia() -> None:
            code = compiled(clang, source, defines, "nvidia", NVIDIA[0])
            for name in NVIDIA:
                ran([str(ptxas), f"-arch={name}", str(code), "-o", "/dev/null"], name)

        makers: dict[str, Callable[[], object]] = {
            "NVIDIA": for_nvidia,
            "Intel": lambda: to_spirv(clang, source, defines),
        }
        makers |= {name: lambda name=name: compiled(clang, source, defines, "amd", name) for name in AMD}
        for device, make in makers.items():
            try:
                make()
            except SystemExit as error:
                faults.append(f"{file} {dict(given)}, {device}: {error}")
    return faults


def to_spirv(clang: str, source: Path, defines: dict[str, int]) -> None:
    """Make SPIR-V from a program, and check it if a validator is installed."""
    version = subprocess.run([clang, "-dumpversion"], capture_output=True, text=True).stdout.split(".")[0]
    bitcode, module = source.with_suffix(".bc"), source.with_suffix(".spv")
    given = [f"-D{name}={value}" for name, value in defines.items()]
    ran([clang, *SPIRV, *given, "-emit-llvm", "-c", str(source), "-o", str(bitcode)], str(source))
    ran([f"llvm-spirv-{version}", "--spirv-max-version=1.0", str(bitcode), "-o", str(module)], str(source))
    if shutil.which(VALIDATOR):
        ran([VALIDATOR, "--target-env", "opencl1.2", str(module)], str(source))


if __name__ == "__main__":
    main()
