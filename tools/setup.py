"""Make this clone ready: install system libraries through apt, a virtual environment, and Python packages.

``make`` runs this file, which needs only the standard library. It installs missing parts; with ``--demo``, only parts
that the demo needs. If it may not install system packages, it prints their names and the command.
"""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
VENV = ROOT / ".venv"
DEMO, EVERYTHING = "plot", "opencv,open3d,exr,hdf5,ros,r3d,plot,video,metrics,gaussians,view,batch,dev"  # extras
OLDEST, NEWEST = (3, 10), (3, 13)  # NEWEST: the last Python for which Open3D, which the tests need, has wheels

LIBRARIES = {  # libraries that `import open3d` loads, and their Debian or Ubuntu packages
    "libEGL.so.1": "libegl1",
    "libGL.so.1": "libgl1",
    "libgomp.so.1": "libgomp1",
    "libusb-1.0.so.0": "libusb-1.0-0",
    "libX11.so.6": "libx11-6",
}


def main() -> None:
    for_demo = "--demo" in sys.argv[1:]
    check_python(for_demo)
    install_system_packages(missing_packages({} if for_demo else LIBRARIES))
    install_python_packages(for_demo)


def check_python(for_demo: bool) -> None:
    version = sys.version_info[:2]
    if version < OLDEST:
        fail(f"this is Python {version[0]}.{version[1]}; pyibr needs {OLDEST[0]}.{OLDEST[1]} or later.")
    if version > NEWEST and not for_demo:
        fail(
            f"this is Python {version[0]}.{version[1]}; the tests need Open3D, which has wheels "
            f"for Python {OLDEST[0]}.{OLDEST[1]} to {NEWEST[0]}.{NEWEST[1]}.\n"
            f"Name one of those: make PYTHON=python{NEWEST[0]}.{NEWEST[1]} ..."
        )


def missing_packages(libraries: dict[str, str]) -> list[str]:
    """List missing packages by their Debian names; `libraries` are checked, too."""
    missing: list[str] = []
    if subprocess.run([sys.executable, "-c", "import ensurepip, venv"], capture_output=True).returncode:
        missing.append("python3-venv")
    if not any(Path("/etc/OpenCL/vendors").glob("*.icd")):
        missing.append("pocl-opencl-icd")
    missing += [package for library, package in libraries.items() if not can_load(library)]
    return missing


def can_load(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def install_system_packages(packages: list[str]) -> None:
    if not packages:
        return
    names = " ".join(packages)
    if not shutil.which("apt-get"):
        fail(f"these are missing, by their Debian names: {names}\nInstall them with this system's own tool.")
    say(f"installing {names}")
    install = ["install", "-y", "-qq", "-o", "Dpkg::Use-Pty=0", "--no-install-recommends", *packages]
    for arguments in (["update", "-qq"], install):
        if not apt_get(arguments):
            fail(
                f"these packages are missing and could not be installed from here: {names}\n"
                f"Run: sudo apt-get update && sudo apt-get install -y {names}"
            )


def apt_get(arguments: list[str]) -> bool:
    sudo: list[str] = []
    if os.geteuid() != 0:
        if not shutil.which("sudo"):
            return False
        # Without a terminal nobody can type a password.
        sudo = ["sudo"] if sys.stdin.isatty() else ["sudo", "-n"]
    command = [*sudo, "env", "DEBIAN_FRONTEND=noninteractive", "apt-get", *arguments]
    return subprocess.run(command, stdout=subprocess.DEVNULL).returncode == 0


def install_python_packages(for_demo: bool) -> None:
    if not (VENV / "bin/pip").exists():
        say(f"creating {VENV.name}")
        run([sys.executable, "-m", "venv", "--clear", str(VENV)])
    large = "" if for_demo else " (Open3D alone is 0.5 GB: this takes some minutes)"
    say(f"installing the Python packages{large}")
    wanted = f"{ROOT}[{DEMO if for_demo else EVERYTHING}]"
    # Python compiles the modules that are imported; pip would compile all of them.
    run([str(VENV / "bin/python"), "-m", "pip", "install", "-q", "--no-compile", "-e", wanted])
    (VENV / ".demo").touch()
    if not for_demo:
        (VENV / ".ready").touch()


def run(command: list[str]) -> None:
    status = subprocess.run(command, cwd=ROOT).returncode
    if status:
        fail(f"this command failed: {' '.join(command)}", status)


def say(text: str) -> None:
    print(f"setup: {text}", flush=True)


def fail(text: str, status: int = 1) -> None:
    print(f"setup: {text}", file=sys.stderr)
    sys.exit(status)


if __name__ == "__main__":
    main()
