"""Every kernel by several OpenCL implementations, launch by launch, beside PoCL: what is the same to the bit.

    make test-devices

Calls of all systems are made by PoCL and by each other CPU runtime that is here, in the CPUs' form, and in the GPUs'
form by PoCL and by Mesa's rusticl on llvmpipe, of a Debian 13 that is put into a folder (as root on Debian or Ubuntu).
The outcome is written to benchmarks/results/devices.json, and printed as the table of docs/machines.md.
"""

from __future__ import annotations

import argparse
import hashlib
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
from pyibr.opencl.launch import Struct
from pyibr.opencl.memory import DeviceArray
from pyibr.opencl.outcome import Outcome
from pyibr.opencl.watch import Watch, watching
from tests.one_lane import one_lane
from tests.opencl.everything import calls
from tools import debian

ROOT = Path(__file__).resolve().parents[1]
RECORD = ROOT / "benchmarks/results/devices.json"
TOLERANCE = 1e-5  # of a value: what other compilers' rounding comes to, as the tests of one lane allow it
SCRATCH = {"pool", "used"}  # parts of a stack, which work-items take in any order
RUSTICL = {"RUSTICL_ENABLE": "llvmpipe", "PYIBR_DEVICE": "rusticl"}


class Launches(Watch):
    """Keeps what each launch is given, as a checksum, and what it makes."""

    def __init__(self) -> None:
        self.call = ""
        self.kept: dict[str, NDArray[Any]] = {}
        self._count: dict[str, int] = defaultdict(int)

    def launch(self, kernel: Any, grid: tuple[int, ...], arguments: Mapping[str, Any], enqueue: Any) -> None:
        """Make a launch between two looks at its arrays."""
        key = f"{self.call}/{kernel.name}"
        self._count[key] += 1
        key += f"/{self._count[key]}"
        given = hashlib.sha256(repr(grid).encode())
        for name in sorted(arguments):
            given.update(_bytes_of(arguments[name]))
        self.kept[f"{key}/"] = np.frombuffer(given.digest(), np.uint8)
        enqueue(**arguments)
        written = {one.name for one in kernel.arguments if one.kind == "pointer" and not one.constant}
        written -= SCRATCH
        for name in sorted(written):
            self.kept[f"{key}/{name}"] = arguments[name].to_host().copy()


def _bytes_of(value: Any) -> bytes:
    if isinstance(value, DeviceArray):
        return value.to_host().tobytes()
    return value.values.tobytes() if isinstance(value, Struct) else repr(float(value)).encode()


def draw(out: Path, in_gpu_form: bool) -> None:
    """Draw all calls on the device in use, all of whose memory begins with zeros, and keep the launches."""
    take = memory._take

    def take_empty(session: device.Session, size: int) -> Any:
        import pyopencl as cl

        block = take(session, size)
        cl.enqueue_fill_buffer(session.queue, block.buffer, np.zeros(1, np.uint8), 0, block.size)
        session.wait()
        return block

    if in_gpu_form:  # which a CPU's test, of what the CPUs' form needs, says nothing of
        device._examine = device._examine_broken_again = lambda *_: Outcome(True)
    with one_lane() if in_gpu_form else nullcontext(), watching(Launches()) as launches:
        drawn = calls()
        memory._take = take_empty
        for launches.call, call in drawn.items():
            call()
        used = device.current().device
    told = {"device": used.name, "driver": used.driver, "version": used.version}
    np.savez(out, told=json.dumps(told), **launches.kept)  # pyright: ignore[reportArgumentType]


@dataclass
class Agreement:
    """Agreement of a kernel's launches with PoCL's.

    Attributes
    ----------
    launches, same, given_same : int
        How many there are, make the same bits, and are given the same.
    off, far : float
        Of the latter: the share of values that differ, and of those that do by more than `TOLERANCE` of themselves.
    """

    launches: int = 0
    same: int = 0
    given_same: int = 0
    off: float = 0.0
    far: float = 0.0
    _values: int = field(default=0, repr=False)


def compare(base: Path, other: Path) -> dict[str, Agreement]:
    """Agreements by kernels' names."""
    found: dict[str, Agreement] = defaultdict(Agreement)
    with np.load(base) as one, np.load(other) as two:
        launches: dict[str, list[str]] = defaultdict(list)
        for key in one.files:
            if key.count("/") == 3:
                launch, name = key.rsplit("/", 1)
                launches[launch] += [name] if name else []
        for launch, names in launches.items():
            agreement = found[launch.split("/")[1]]
            agreement.launches += 1
            pairs = [(one[key], two[key]) for name in names if (key := f"{launch}/{name}") in two.files]
            if len(pairs) < len(names) or any(a.shape != b.shape for a, b in pairs):
                continue
            agreement.same += all(a.tobytes() == b.tobytes() for a, b in pairs)
            if (one[f"{launch}/"] == two[f"{launch}/"]).all():
                agreement.given_same += 1
                for a, b in pairs:
                    _add(agreement, a, b)
    for agreement in found.values():
        agreement.off, agreement.far = (part / max(agreement._values, 1) for part in (agreement.off, agreement.far))
    return dict(sorted(found.items()))


def _add(agreement: Agreement, a: NDArray[Any], b: NDArray[Any]) -> None:
    differs = a.view(f"u{a.itemsize}") != b.view(f"u{b.itemsize}")
    agreement._values += differs.size
    agreement.off += int(differs.sum())
    with np.errstate(all="ignore"):
        one, two = (values[differs].astype(np.float64) for values in (a, b))
        agreement.far += int((abs(one - two) > TOLERANCE * np.maximum(abs(one), abs(two))).sum())


def table(found: Mapping[str, Mapping[str, Agreement]]) -> str:
    """Kernels that make the same bits in number, and a row for each other: what differs of what was given the same."""
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
    rest = f"{100 * one.off:.2g} % of the values, {100 * one.far:.2g} % far" if one.off else "given other values"
    return f"{one.same} of {one.launches}; {rest}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draw", type=Path, help="only keep the launches of the device in use, in this file")
    parser.add_argument("--gpu-form", action="store_true")
    parser.add_argument("--folder", type=Path, default=ROOT / "build/devices", help="where Debian and files are put")
    given = parser.parse_args()
    if given.draw:
        draw(given.draw, given.gpu_form)
        return
    folder = given.folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    runtimes = [one for one in ibr.devices() if one.works and one.kind == "cpu"]
    runtimes.sort(key=lambda one: "PoCL" not in one.version)
    base, in_gpu_form = (_drawn(folder, form, str(runtimes[0].index)) for form in ("", "--gpu-form"))
    found = {one.platform: compare(base, _drawn(folder, "", str(one.index))) for one in runtimes[1:]}
    if debian.is_possible():
        system = folder / "trixie"
        debian.make_system(system, "trixie", ["mesa-opencl-icd"])
        home = debian.install(system, ROOT, "pytest")
        for part in ("tests", "tools"):
            shutil.copytree(ROOT / part, home / part, dirs_exist_ok=True)
        debian.within(system, "v/bin/python -m tools.devices --gpu-form --draw rusticl.npz", **RUSTICL)
        found["rusticl, one lane"] = compare(in_gpu_form, home / "rusticl.npz")
    print(table(found))
    kept = {name: {kernel: asdict(one) for kernel, one in each.items()} for name, each in found.items()}
    RECORD.write_text(json.dumps(kept, indent=1) + "\n")


def _drawn(folder: Path, form: str, index: str) -> Path:
    out = folder / f"{index}{form}.npz"
    command = [sys.executable, "-m", "tools.devices", "--draw", str(out), *form.split()]
    subprocess.run(command, check=True, cwd=ROOT, env=os.environ | {"PYIBR_DEVICE": index})
    return out


if __name__ == "__main__":
    main()
