"""Install the wheel on a Debian for ARM, draw a picture of each kind there, and compare it with this machine's.

    make test-arm

Debian for 64-bit ARM is installed into a folder, and qemu emulates its processor. This needs root on Debian or Ubuntu;
qemu and debootstrap are installed if they are missing. The outcome is written to benchmarks/results/arm.json.
"""

from __future__ import annotations

import argparse
import json
import platform
import shutil
import subprocess
import sys
import time
from pathlib import Path

from tools import debian, pictures

ROOT = Path(__file__).resolve().parents[1]
RECORD = ROOT / "benchmarks/results/arm.json"
SLOW = {"PYIBR_TIMEOUT": "1800", "POCL_WORK_GROUP_SPECIALIZATION": "0"}  # emulated, all takes twenty times as long


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--folder", type=Path, default=ROOT / "build/arm", help="folder for Debian, which later runs use again"
    )
    parser.add_argument(
        "--suite", default="bookworm", help="Debian's suite, whose PoCL is compared with this machine's PoCL"
    )
    arguments = parser.parse_args()
    if not debian.is_possible():
        sys.exit("test-arm: needs root, on Debian or Ubuntu")
    system, start = arguments.folder.resolve() / arguments.suite, time.monotonic()
    debian.make_system(system, arguments.suite, ["pocl-opencl-icd"], "arm64")
    home = debian.install(system, ROOT)
    shutil.copy(ROOT / "tools/pictures.py", home)
    for line in ("v/bin/pyibr doctor", "v/bin/python pictures.py there.npz"):
        debian.within(system, line, **SLOW)
    here = arguments.folder.resolve() / "here.npz"
    subprocess.run([sys.executable, str(ROOT / "tools/pictures.py"), str(here)], check=True)
    record(here, home / "there.npz", time.monotonic() - start)


def record(here: Path, there: Path, seconds: float) -> None:
    """Compare the pictures, and write the outcome."""
    rows = pictures.compare(here, there)
    told = {"here": pictures.told(here), "there": pictures.told(there), "machine here": platform.machine()}
    RECORD.write_text(json.dumps({**told, "seconds": round(seconds), "pictures": rows}, indent=1) + "\n")
    same = sum(not any(value for name, value in row.items() if name != "pixels") for row in rows.values())
    print(
        f"test-arm: {same} of {len(rows)} pictures have the same bits; {RECORD.relative_to(ROOT)} lists all differences"
    )


if __name__ == "__main__":
    main()
