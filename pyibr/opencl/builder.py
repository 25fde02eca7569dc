"""A process that builds programs while this process draws its first picture.

PoCL's compiler takes half a second to start, and a lock prevents threads of one process from compiling in parallel. The
process that tested the device has already started its compiler, so it builds programs for this process, which finds the
results in PoCL's folder on disk. Kernels that are launched last are compiled there while this process compiles and
launches earlier ones. If the builder is missing, late or broken, this process builds the programs itself.
"""

from __future__ import annotations

import atexit
import json
import os
from collections.abc import Mapping
from pathlib import Path

from pyibr.opencl.apart import Apart

BUILT = "built"
"""Start of the lines that report a finished request."""


class Builder:
    """Handle of a builder process."""

    def __init__(self, process: Apart, key: str) -> None:
        self.key = key  # the key of the device for which the process builds
        self._process = process
        self._lines: dict[tuple[str, str], str] = {}  # lines expected for finished programs and kernels
        self._of_program: dict[str, set[str]] = {}

    def ask(self, file: str | Path, name: str, defines: Mapping[str, int], *, compiled: bool = False) -> str:
        """Request the build of a kernel's program; with `compiled`, also compile the kernel for launches.

        Returns the line that the process prints when it is done.
        """
        program = _program(file, defines)
        request = (program, name if compiled else "")
        if request not in self._lines:
            line = self._lines[request] = f"{BUILT} {len(self._lines)}"
            self._of_program.setdefault(program, set()).add(line)
            self._process.send(json.dumps([line, str(file), name, dict(defines), compiled]))
        return self._lines[request]

    def wait(self, file: str | Path, name: str, defines: Mapping[str, int]) -> None:
        """Wait until a kernel's program is built and all other requests for this program are done."""
        wanted = self._of_program.get(_program(file, defines)) or {self.ask(file, name, defines)}
        self._process.wait(lambda: wanted.issubset(self._process.lines))

    @property
    def has_ended(self) -> bool:
        """Tell whether the process has ended."""
        return self._process.status is not None

    def end(self) -> None:
        """End the process."""
        self._process.kill()


def _program(file: str | Path, defines: Mapping[str, int]) -> str:
    """Key of a program."""
    return json.dumps([str(file), sorted(defines.items())])


builders: list[Builder] = []
"""The builder of this process, if it has one."""


def keep_builder(process: Apart, key: str) -> None:
    """Use the process that tested the device with this key as the builder from now on."""
    end_builder()
    builders.append(Builder(process, key))


def builder_of(key: str) -> Builder | None:
    """Return the builder for the device with this key; None if there is none or it has ended."""
    if builders and builders[0].has_ended:
        builders.clear()
    return next((one for one in builders if one.key == key), None)


@atexit.register
def end_builder() -> None:
    """End the builder process, if there is one."""
    while builders:
        builders.pop().end()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=builders.clear)  # the builder belongs to the parent
