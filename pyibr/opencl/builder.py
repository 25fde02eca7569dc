"""The process that tested a device, which goes on to build programs while this one draws its first picture.

PoCL's compiler takes half a second to start, and a lock keeps threads of one process from compiling side by side. The
process of the test has it started. What that one builds, PoCL keeps on disk, so this process never starts its own, and
kernels that are launched last are compiled while this one compiles and launches those before them. Where that process
is missing, late or broken, this one builds as if there had been none.
"""

from __future__ import annotations

import atexit
import json
import os
from collections.abc import Mapping
from pathlib import Path

from pyibr.opencl.apart import Apart

BUILT = "built"
"""Begins the lines by which it tells that something is done."""


class Builder:
    """Such a process, as this one knows it.

    Attributes
    ----------
    key : str
        Of the device that it builds for.
    """

    def __init__(self, process: Apart, key: str) -> None:
        self.key = key
        self._process = process
        self._lines: dict[tuple[str, str], str] = {}  # that tell that a program is done, and a kernel of it
        self._of_program: dict[str, set[str]] = {}

    def ask(self, file: str | Path, name: str, defines: Mapping[str, int], *, compiled: bool = False) -> str:
        """Have a kernel's program built; the kernel compiled for launches, too, if that is said.

        What it will print once that is done is returned.
        """
        program = _program(file, defines)
        request = (program, name if compiled else "")
        if request not in self._lines:
            line = self._lines[request] = f"{BUILT} {len(self._lines)}"
            self._of_program.setdefault(program, set()).add(line)
            self._process.send(json.dumps([line, str(file), name, dict(defines), compiled]))
        return self._lines[request]

    def wait(self, file: str | Path, name: str, defines: Mapping[str, int]) -> None:
        """Wait until a kernel's program is built, and whatever else was asked for of it is done."""
        wanted = self._of_program.get(_program(file, defines)) or {self.ask(file, name, defines)}
        self._process.wait(lambda: wanted.issubset(self._process.lines))

    @property
    def has_ended(self) -> bool:
        """Tell whether it builds no more."""
        return self._process.has_ended

    def end(self) -> None:
        """End the process."""
        self._process.kill()


def _program(file: str | Path, defines: Mapping[str, int]) -> str:
    """Name of a program."""
    return json.dumps([str(file), sorted(defines.items())])


builders: list[Builder] = []
"""The builder of this process, if it has one."""


def keep_builder(process: Apart, key: str) -> None:
    """Have the process that tested the device with that key build from now on."""
    end_builder()
    builders.append(Builder(process, key))


def builder_of(key: str) -> Builder | None:
    """The builder for the device with that key, if there is one, and it has not ended."""
    if builders and builders[0].has_ended:
        builders.clear()
    return next((one for one in builders if one.key == key), None)


@atexit.register
def end_builder() -> None:
    """End the process, if there is one."""
    while builders:
        builders.pop().end()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=builders.clear)  # it is the parent's
