"""Installs a Debian into a folder, for this machine's processor or for one that qemu emulates. Needs root."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

_MIRROR = re.compile(r"https?://\S+/debian/?(?=\s|$)")
_PACKAGES = ("python3", "python3-venv", "ca-certificates")
_HOME = "root/pyibr"


def is_possible() -> bool:
    """Tell whether this process is root on Debian or Ubuntu."""
    return os.name == "posix" and os.geteuid() == 0 and bool(shutil.which("apt-get"))


def make_system(system: Path, suite: str, packages: Sequence[str], architecture: str = "") -> None:
    """Install Debian into a folder, unless it is there already; a named `architecture` is emulated."""
    needed = ["debootstrap", *(["qemu-user-static", "binfmt-support"] if architecture else [])]
    if missing := [name for name in needed if not _installed(name)]:
        subprocess.run(["apt-get", "update", "-qq"], check=True)
        subprocess.run(["apt-get", "install", "-y", "-qq", "--no-install-recommends", *missing], check=True)
    table = Path("/proc/sys/fs/binfmt_misc")
    if architecture and not (table / "register").exists():
        subprocess.run(["mount", "-t", "binfmt_misc", "none", str(table)], check=True)
    if architecture:
        subprocess.run(["update-binfmts", "--enable", "qemu-aarch64"], check=True)
    if (system / ".ready").exists():
        return
    print("Putting Debian into", system, "- some minutes", flush=True)
    shutil.rmtree(system, ignore_errors=True)
    system.parent.mkdir(parents=True, exist_ok=True)
    options = ["--variant=minbase", f"--include={','.join([*_PACKAGES, *packages])}"]
    options += [f"--arch={architecture}"] if architecture else []
    subprocess.run(["debootstrap", *options, suite, str(system), *_mirror()], check=True)
    for file in ("/etc/resolv.conf", "/etc/hosts", "/etc/pip.conf", "/etc/ssl/certs/ca-certificates.crt"):
        if Path(file).exists():
            shutil.copy(file, system / file.lstrip("/"))
    (system / ".ready").touch()


def _installed(package: str) -> bool:
    done = subprocess.run(["dpkg", "-s", package], capture_output=True, text=True)
    return "Status: install ok installed" in done.stdout


def _mirror() -> list[str]:
    """Find the mirror from which this machine's packages come."""
    lists = [Path("/etc/apt/sources.list"), *Path("/etc/apt/sources.list.d").glob("*")]
    found = [one for file in lists if file.is_file() for one in _MIRROR.findall(file.read_text(errors="replace"))]
    return found[:1]


def install(system: Path, root: Path, *packages: str) -> Path:
    """Install the wheel of the project in `root`, and further packages; returns the folder in which `within` works."""
    home, built = system / _HOME, system.parent / "wheel"
    shutil.rmtree(built, ignore_errors=True)
    command = [sys.executable, "-m", "build", "--wheel", "--outdir", str(built), str(root)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    (wheel,) = built.glob("*.whl")
    home.mkdir(exist_ok=True)
    shutil.copy(wheel, home)
    pip = "v/bin/pip install -q --disable-pip-version-check"
    within(system, "test -d v || python3 -m venv v")
    within(system, f"{pip} --force-reinstall --no-deps ./{wheel.name}")
    within(system, f"{pip} ./{wheel.name} {' '.join(packages)}")
    return home


def within(system: Path, line: str, **variables: str) -> None:
    """Run a shell command inside the installed Debian, which sees this machine's processes and devices."""
    mounts = "".join(f'mount --bind /{name} "{system}/{name}"; ' for name in ("proc", "dev", "sys"))
    known = {"HOME": "/root", "PATH": "/usr/local/bin:/usr/bin:/bin:/usr/sbin:/sbin", "LANG": "C.UTF-8", **variables}
    words = " ".join(f"{name}={value}" for name, value in known.items())
    entered = f"{mounts}exec chroot {system} env -i {words} bash -c 'cd /{_HOME} && {line}'"
    print(f"{system.name}: {line}", flush=True)
    subprocess.run(["unshare", "--mount", "bash", "-ec", entered], check=True)
