"""Install the wheel as users do, each time into a new environment, and use it from outside the clone.

    python .ci/installs.py dist/pyibr_opencl-0.1.0-py3-none-any.whl bare beside
    python .ci/installs.py dist/*.whl bare beside all --python python3.10 --python python3.13

- bare: only with pyibr's requirements
- beside: after opencv-python, whose files must not change
- all: with all extras

All environments use this machine's OpenCL runtimes.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
KINDS = ("bare", "beside", "all")


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("wheel", type=Path)
    parser.add_argument("kinds", nargs="+", choices=KINDS)
    parser.add_argument("--python", action="append", help="interpreters to use (default: this one)")
    arguments = parser.parse_args()
    for python in arguments.python or [sys.executable]:
        for kind in arguments.kinds:
            start = time.monotonic()
            with tempfile.TemporaryDirectory() as folder:
                size = try_install(python, kind, arguments.wheel.resolve(), Path(folder))
            print(f"installs: {python} {kind}: {size / 1e6:.0f} MB, {time.monotonic() - start:.0f} s", flush=True)


def try_install(python: str, kind: str, wheel: Path, place: Path) -> int:
    """Install the wheel into a new environment and use it; returns the environment's size in bytes."""
    environment = place / "venv"
    run([python, "-m", "venv", str(environment)], place)
    packages = next(environment.glob("lib/python*/site-packages"))
    pip = [str(environment / "bin/pip"), "install", "-q", "--disable-pip-version-check"]
    if kind == "beside":
        run([*pip, "opencv-python"], place)
    before = sums(packages / "cv2")
    run([*pip, f"{wheel}[all]" if kind == "all" else str(wheel)], place)
    if sums(packages / "cv2") != before and kind == "beside":
        sys.exit("installs: the files of opencv-python have changed")
    shutil.copy(HERE / "wheel.py", place)
    own_python, pyibr = str(environment / "bin/python"), str(environment / "bin/pyibr")
    run([own_python, "wheel.py", "make"], place)
    run([pyibr, "doctor"], place)
    cameras = ["--camera", "camera.json", "--to", "moved.json"]
    run([pyibr, "warp", "color.png", "depth.npy", *cameras, "-o", "out.png"], place)
    run([own_python, "wheel.py", "check"], place)
    run([own_python, "wheel.py", kind], place)
    return sum(file.stat().st_size for file in environment.rglob("*") if file.is_file() and not file.is_symlink())


def sums(folder: Path) -> dict[str, str]:
    """Checksums of a folder's files, except the bytecode that Python writes."""
    files = [file for file in sorted(folder.rglob("*")) if file.is_file() and file.suffix != ".pyc"]
    return {str(file): hashlib.sha256(file.read_bytes()).hexdigest() for file in files}


def run(command: list[str], place: Path) -> None:
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(command, cwd=place, env=environment, capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"installs: {' '.join(command)} failed:\n{done.stdout}{done.stderr}")


if __name__ == "__main__":
    main()
