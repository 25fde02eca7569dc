"""Compare the results of every launch between PoCL and other OpenCL implementations, bit by bit.

    make test-devices

All runtimes make the same calls of all systems. PoCL and every other CPU runtime of this machine run the kernels' CPU
form. PoCL and Mesa's rusticl on llvmpipe run the GPU form; rusticl comes from a Debian 13 that is installed into a
folder (as root on Debian or Ubuntu). After each launch, its results are replaced by PoCL's, so that all launches get
PoCL's inputs. The outcome is written to benchmarks/results/devices.json, and printed as the table of docs/machines.md.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
from collections import defaultdict
from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import pyibr as ibr
from pyibr.opencl import device, memory
from pyibr.opencl.selftest import Outcome
from pyibr.opencl.watch import Watch, watching
from tools import debian
from tools.everything import calls
from tools.one_lane import one_lane

ROOT = Path(__file__).resolve().parents[1]
RECORD = ROOT / "benchmarks/results/devices.json"
TOLERANCE = 1e-5  # relative difference that rounding by other compilers may cause, as in the tests with one lane
SCRATCH = {"pool", "used"}  # arguments for a stack from which work-items take parts in any order
RUSTICL = {"RUSTICL_ENABLE": "llvmpipe", "PYIBR_DEVICE": "rusticl", "PYIBR_BUILD_OPTIONS": "-DINLINED=static"}
"""Rusticl's compiler loses some copies of structs in loops (`pyibr.opencl.selftest`); with less inlining, fewer."""


class Launches(Watch):
    """Keeps the results of each launch, then replaces them by another device's results if `first` has them."""

    def __init__(self, first: Mapping[str, NDArray[Any]]) -> None:
        self.call = ""
        self.kept: dict[str, NDArray[Any]] = {}
        self._first = first
        self._count: dict[str, int] = defaultdict(int)

    def launch(self, kernel: Any, grid: tuple[int, ...], arguments: Mapping[str, Any], enqueue: Any) -> None:
        """Make a launch, and keep the arrays that it writes."""
        enqueue(**arguments)
        launch = f"{self.call}/{kernel.name}"
        self._count[launch] += 1
        written = {one.name for one in kernel.arguments if one.kind == "pointer" and not one.constant}
        for name in sorted(written - SCRATCH):
            key = f"{launch}/{self._count[launch]}/{name}"
            self.kept[key] = arguments[name].to_host().copy()
            if key in self._first:
                memory.copy(memory.upload(self._first[key]), arguments[name])


def draw(out: Path, in_gpu_form: bool, first: Path | None) -> None:
    """Make all calls on the current device, with memory that starts as zeros, and keep the results of launches.

    `first` is a file of another device's results; after each launch, they replace this device's results.
    """
    take = memory._take

    def take_empty(session: device.Session, size: int) -> Any:
        import pyopencl as cl

        block = take(session, size)
        cl.enqueue_fill_buffer(session.queue, block.buffer, np.zeros(1, np.uint8), 0, block.size)
        session.wait()
        return block

    if in_gpu_form:  # the device's own tests are skipped: they only examine the CPU form
        device._examine = device._examine_broken_again = lambda *_: Outcome(True)
    launches = Launches({} if first is None else np.load(first))
    with one_lane() if in_gpu_form else nullcontext(), watching(launches):
        drawn = calls()
        memory._take = take_empty
        for launches.call, call in drawn.items():
            call()
        used = device.current().device
    told = {"device": used.name, "driver": used.driver, "version": used.version}
    np.savez(out, told=json.dumps(told), **launches.kept)  # pyright: ignore[reportArgumentType]


@dataclass
class Agreement:
    """Agreement of a kernel's launches with PoCL's launches on the same inputs.

    Attributes
    ----------
    launches, same : int
        Number of launches, and number of launches with the same bits.
    off, far : float
        Share of values that differ at all, and that differ by a relative `TOLERANCE` or more.
    most : float
        Largest relative difference within `TOLERANCE`.
    """

    launches: int = 0
    same: int = 0
    off: float = 0.0
    far: float = 0.0
    most: float = 0.0
    _values: int = field(default=0, repr=False)


def compare(base: Path, other: Path) -> dict[str, Agreement]:
    """Compare two files of results; returns the agreement of each kernel."""
    found: dict[str, Agreement] = defaultdict(Agreement)
    with np.load(base) as one, np.load(other) as two:
        differs: dict[tuple[str, str], bool] = defaultdict(bool)
        for key in one.files:
            if key.count("/") == 3:
                call, kernel, number, _ = key.split("/")
                differs[kernel, f"{call}/{number}"] |= _add(found[kernel], one[key], two[key])
    for (kernel, _), off in differs.items():
        found[kernel].launches += 1
        found[kernel].same += not off
    for agreement in found.values():
        agreement.off, agreement.far = (part / max(agreement._values, 1) for part in (agreement.off, agreement.far))
    return dict(sorted(found.items()))


def _add(agreement: Agreement, a: NDArray[Any], b: NDArray[Any]) -> bool:
    differs = a.view(f"u{a.itemsize}") != b.view(f"u{b.itemsize}")
    agreement._values += differs.size
    agreement.off += int(differs.sum())
    with np.errstate(all="ignore"):
        one, two = (values[differs].astype(np.float64) for values in (a, b))
        parts = abs(one - two) / np.maximum(abs(one), abs(two))
    near = parts <= TOLERANCE
    agreement.far += int((~near).sum())
    agreement.most = max(agreement.most, parts[near].max(initial=0))
    return bool(differs.any())


def table(found: Mapping[str, Mapping[str, Agreement]]) -> str:
    """Make a Markdown table: the number of kernels without differences, and a row for each kernel with some."""
    lines = [f"| kernel | {' | '.join(found)} |", f"|---|{'---|' * len(found)}"]
    whole = [[one.same == one.launches for one in each.values()] for each in found.values()]
    lines.append(f"| all launches the same | {' | '.join(f'{sum(each)} of {len(each)}' for each in whole)} |")
    for name in sorted(set().union(*found.values())):
        of_each = [each.get(name) for each in found.values()]
        if any(one is not None and one.same < one.launches for one in of_each):
            lines.append(f"| `{name}` | {' | '.join(map(_told, of_each))} |")
    return "\n".join(lines)


def _told(one: Agreement | None) -> str:
    if one is None or one.same == one.launches:
        return "" if one is None else "all"
    most = f", by up to {one.most:.0e}" if one.most else ""
    far = f", {100 * one.far:.2g} % far" if one.far else ""
    return f"{one.same} of {one.launches}; {100 * one.off:.2g} % of the values{most}{far}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draw", type=Path, help="only make the calls on this device, and write results to this file")
    parser.add_argument("--first", type=Path, help="another device's results, to replace each launch's")
    parser.add_argument("--gpu-form", action="store_true")
    parser.add_argument("--folder", type=Path, default=ROOT / "build/devices", help="folder for Debian and results")
    given = parser.parse_args()
    if given.draw:
        draw(given.draw, given.gpu_form, given.first)
        return
    folder = given.folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    runtimes = [one for one in ibr.devices() if one.works and one.kind == "cpu"]
    runtimes.sort(key=lambda one: "PoCL" not in one.version)
    base, in_gpu_form = (_drawn(folder, runtimes[0], *form) for form in ([], ["--gpu-form"]))
    found = {one.platform: compare(base, _drawn(folder, one, "--first", str(base))) for one in runtimes[1:]}
    if debian.is_possible():
        system = folder / "trixie"
        debian.make_system(system, "trixie", ["mesa-opencl-icd"])
        home = debian.install(system, ROOT, "pytest")
        for part in ("tests", "tools"):
            shutil.copytree(ROOT / part, home / part, dirs_exist_ok=True)
        shutil.copy(in_gpu_form, home / "first.npz")
        debian.within(
            system, "v/bin/python -m tools.devices --gpu-form --first first.npz --draw rusticl.npz", **RUSTICL
        )
        found["rusticl, one lane"] = compare(in_gpu_form, home / "rusticl.npz")
    print(table(found))
    kept = {name: {kernel: asdict(one) for kernel, one in each.items()} for name, each in found.items()}
    RECORD.write_text(json.dumps(kept, indent=1) + "\n")


def _drawn(folder: Path, device: ibr.Device, *options: str) -> Path:
    out = folder / f"{device.index}{''.join(options[:1])}.npz"
    command = [sys.executable, "-m", "tools.devices", "--draw", str(out), *options]
    subprocess.run(command, check=True, cwd=ROOT, env=os.environ | {"PYIBR_DEVICE": str(device.index)})
    return out


if __name__ == "__main__":
    main()
