"""Runs one CPU runtime in a separate process, which makes a call of `rows.py` on request.

The process's Python may belong to another environment, or to a Debian that debootstrap has put into a folder. That
folder then becomes the process's root directory (which needs the root user), and the project is mounted at its `/mnt`.
"""

from __future__ import annotations

import gc
import json
import os
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import pyibr as ibr
from benchmarks.cases import Size
from benchmarks.results import Skip
from benchmarks.runtimes.rows import ROWS

_PROJECT = Path(__file__).parents[2]
_ENTER = """
set -e
for folder in proc dev sys; do mount --rbind "/$folder" "$0/$folder"; done
mount --bind "$1" "$0/mnt"
shift
exec chroot "$0" env -i HOME=/root PATH="$PATH" LANG=C.UTF-8 sh -c 'cd /mnt && exec "$@"' sh "$@"
"""


@dataclass(frozen=True)
class Runtime:
    """A CPU device that works.

    Attributes
    ----------
    name : str
        Name of the runtime, with its version.
    python : Path
        The Python whose pyopencl lists it.
    index : int
        Index of the device in that list.
    """

    name: str
    python: Path
    index: int


class Drawing:
    """A call of `rows.py` on a runtime, made once already.

    Attributes
    ----------
    fault : str
        Reason why the call fails; empty if it works.
    """

    def __init__(self, runtime: Runtime, row: str, size: Size) -> None:
        pipe = subprocess.PIPE
        command = _command(runtime.python, json.dumps([runtime.index, row, *size]))
        self._process = subprocess.Popen(command, cwd=_PROJECT, stdin=pipe, stdout=pipe, text=True)
        self.fault = str(self._answer())

    def draw(self) -> float:
        """Make the call; return its milliseconds, from NumPy arrays to NumPy arrays."""
        assert self._process.stdin
        self._process.stdin.write("\n")
        self._process.stdin.flush()
        return float(self._answer())

    def end(self) -> None:
        """End the process."""
        self._process.communicate()

    def _answer(self) -> str | float:
        assert self._process.stdout
        line = self._process.stdout.readline()
        if not line:
            raise RuntimeError(f"{self._process.args} ended with status {self._process.wait()}")
        return json.loads(line)


def first_time(runtime: Runtime) -> float:
    """Milliseconds of the first picture in a process with empty caches, including the building of kernels."""
    return float(_printed(runtime.python, json.dumps([runtime.index])))


def runtimes_of(python: Path) -> list[Runtime]:
    """List the runtimes that a Python finds."""
    return [Runtime(name, python, index) for name, index in json.loads(_printed(python))]


def _printed(python: Path, *arguments: str) -> str:
    """Run a process, and return the last line that it prints."""
    done = subprocess.run(_command(python, *arguments), cwd=_PROJECT, stdout=subprocess.PIPE, text=True, check=True)
    return done.stdout.splitlines()[-1]


def _command(python: Path, *arguments: str) -> list[str]:
    module = ["-m", "benchmarks.runtimes.process", *arguments]
    anchor, folders = Path(python.absolute().anchor), python.absolute().parents
    root = next((folder for folder in folders if (folder / "etc/os-release").exists()), anchor)
    if root == anchor:
        return [str(python), *module]
    inside = f"/{python.absolute().relative_to(root)}"
    return ["unshare", "--mount", "--fork", "sh", "-c", _ENTER, str(root), str(_PROJECT), inside, *module]


def _name(device: ibr.Device) -> str:
    """Name and version of a runtime, without the name of the processor."""
    words = device.version.split()
    return f"PoCL {words[words.index('PoCL') + 1]}" if "PoCL" in words else f"{device.platform}, {device.driver}"


def _list() -> None:
    found = [device for device in ibr.devices() if device.kind == "cpu" and device.works]
    print(json.dumps([[_name(device), device.index] for device in found]))


def _draw_first(index: int) -> None:
    with TemporaryDirectory() as folder:
        os.environ |= {"PYIBR_CACHE": f"{folder}/pyibr", "POCL_CACHE_DIR": f"{folder}/pocl"}
        with ibr.use_device(index):
            call = ROWS["warp, filled"]((640, 480))
            if isinstance(call, Skip):
                sys.exit(call.reason)
            start = time.perf_counter()
            call()
            print(1e3 * (time.perf_counter() - start))


def _serve(index: int, row: str, *size: int) -> None:
    with ibr.use_device(index):
        call = ROWS[row]((size[0], size[1]))
        if isinstance(call, Skip):
            print(json.dumps(call.reason), flush=True)
            return
        call()
        print(json.dumps(""), flush=True)
        gc.collect()
        gc.disable()
        for _ in sys.stdin:
            start = time.perf_counter()
            made = call()
            print(1e3 * (time.perf_counter() - start), flush=True)
            del made


if __name__ == "__main__":
    if len(sys.argv) == 1:
        _list()
    elif len(given := json.loads(sys.argv[1])) == 1:
        _draw_first(*given)
    else:
        _serve(*given)
