"""Install the wheel on a Debian for ARM, draw a picture of each kind there, and compare them with this machine's.

    make test-arm

Debian's 64-bit ARM lies in a folder and runs by qemu's emulation. Needs root on Debian or Ubuntu; what is missing of
qemu and debootstrap is installed. The outcome is written to benchmarks/results/arm.json.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

from tools import pictures

ROOT = Path(__file__).resolve().parents[1]
RECORD = ROOT / "benchmarks/results/arm.json"
MIRROR = re.compile(r"https?://\S+/debian/?(?=\s|$)")
PACKAGES = ("python3", "python3-venv", "ca-certificates", "pocl-opencl-icd")
NEEDS = ("debootstrap", "qemu-user-static", "binfmt-support")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--folder", type=Path, default=ROOT / "build/arm", help="where Debian is put; kept for the next run"
    )
    parser.add_argument(
        "--suite", default="bookworm", help="of Debian; the default's PoCL is compared with this machine's"
    )
    arguments = parser.parse_args()
    if os.geteuid() or not shutil.which("apt-get"):
        sys.exit("test-arm: needs root, on Debian or Ubuntu")
    system, start = arguments.folder.resolve() / arguments.suite, time.monotonic()
    make_system(system, arguments.suite)
    (wheel,) = build_wheel(arguments.folder.resolve() / "wheel")
    shared = system / "root/pyibr"
    shared.mkdir(exist_ok=True)
    for file in (wheel, ROOT / "tools/pictures.py"):
        shutil.copy(file, shared)
    for line in (
        "test -d v || python3 -m venv v",
        f"v/bin/pip install -q --disable-pip-version-check --force-reinstall --no-deps ./{wheel.name}",
        f"v/bin/pip install -q --disable-pip-version-check ./{wheel.name}",
        "v/bin/pyibr doctor",
        "v/bin/python pictures.py there.npz",
    ):
        within(system, line)
    here = arguments.folder.resolve() / "here.npz"
    subprocess.run([sys.executable, str(ROOT / "tools/pictures.py"), str(here)], check=True)
    record(here, shared / "there.npz", time.monotonic() - start)


def make_system(system: Path, suite: str) -> None:
    """Put Debian for ARM into a folder, unless it is there."""
    if missing := [name for name in NEEDS if not installed(name)]:
        subprocess.run(["apt-get", "update", "-qq"], check=True)
        subprocess.run(["apt-get", "install", "-y", "-qq", "--no-install-recommends", *missing], check=True)
    table = Path("/proc/sys/fs/binfmt_misc")
    if not (table / "register").exists():
        subprocess.run(["mount", "-t", "binfmt_misc", "none", str(table)], check=True)
    subprocess.run(["update-binfmts", "--enable", "qemu-aarch64"], check=True)
    if (system / ".ready").exists():
        return
    print("test-arm: Debian is put into", system, "- some minutes", flush=True)
    shutil.rmtree(system, ignore_errors=True)
    system.parent.mkdir(parents=True, exist_ok=True)
    included = f"--include={','.join(PACKAGES)}"
    subprocess.run(
        ["debootstrap", "--arch=arm64", "--variant=minbase", included, suite, str(system), *mirror()], check=True
    )
    for file in ("/etc/resolv.conf", "/etc/hosts", "/etc/pip.conf", "/etc/ssl/certs/ca-certificates.crt"):
        if Path(file).exists():
            shutil.copy(file, system / file.lstrip("/"))
    (system / ".ready").touch()


def installed(package: str) -> bool:
    done = subprocess.run(["dpkg", "-s", package], capture_output=True, text=True)
    return "Status: install ok installed" in done.stdout


def mirror() -> list[str]:
    """The one that this machine's packages come from."""
    lists = [Path("/etc/apt/sources.list"), *Path("/etc/apt/sources.list.d").glob("*")]
    found = [one for file in lists if file.is_file() for one in MIRROR.findall(file.read_text(errors="replace"))]
    return found[:1]


def build_wheel(folder: Path) -> list[Path]:
    shutil.rmtree(folder, ignore_errors=True)
    command = [sys.executable, "-m", "build", "--wheel", "--outdir", str(folder), str(ROOT)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return list(folder.glob("*.whl"))


def within(system: Path, line: str) -> None:
    """Run a line of shell in the emulated system, with the processes and devices of this one."""
    mounts = "".join(f'mount --bind /{name} "{system}/{name}"; ' for name in ("proc", "dev", "sys"))
    path = "PATH=/usr/local/bin:/usr/bin:/bin:/usr/sbin:/sbin"
    # Emulated, all takes some twenty times as long.
    variables = f"env -i HOME=/root {path} LANG=C.UTF-8 PYIBR_TIMEOUT=1800 POCL_WORK_GROUP_SPECIALIZATION=0"
    entered = f"{mounts}exec chroot {system} {variables} bash -c 'cd /root/pyibr && {line}'"
    print("test-arm:", line, flush=True)
    subprocess.run(["unshare", "--mount", "bash", "-ec", entered], check=True)


def record(here: Path, there: Path, seconds: float) -> None:
    """Compare, and keep the outcome."""
    rows = pictures.compare(here, there)
    told = {"here": pictures.told(here), "there": pictures.told(there), "machine here": platform.machine()}
    RECORD.write_text(json.dumps({**told, "seconds": round(seconds), "pictures": rows}, indent=1) + "\n")
    same = sum(not any(value for name, value in row.items() if name != "pixels") for row in rows.values())
    print(
        f"test-arm: {same} of {len(rows)} pictures are the same to the bit; {RECORD.relative_to(ROOT)} has the others"
    )


if __name__ == "__main__":
    main()
