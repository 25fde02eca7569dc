"""The report of ``pyibr doctor``: OpenCL devices, whether they work, and remedies for devices that do not."""

from __future__ import annotations

import platform
import sys
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from pyibr.core.errors import Error
from pyibr.core.optional import PYIBR, clashes, version_of
from pyibr.opencl.cache import cache_fault, cache_folder
from pyibr.opencl.choice import Device
from pyibr.opencl.device import devices, explain
from pyibr.opencl.runtimes import Problem, problems

if TYPE_CHECKING:
    from rich.console import Console


@dataclass(frozen=True)
class Report:
    """Result of `report`."""

    versions: dict[str, str]  # versions of pyibr, Python and the main packages
    cache: Path  # folder of test outcomes and program binaries
    devices: list[Device]  # all devices, freshly tested
    problems: list[Problem]  # runtimes that cannot be loaded, packages that overwrote each other, an unusable cache
    chosen: Device | None  # the device that a call would use
    why: str  # reason for the choice; without a device, instructions to get one


def report() -> Report:
    """Test every device again, measure its speed, and report which one pyibr would use.

    Examples
    --------
    >>> report().chosen is not None
    True
    """
    found: list[Device] = []
    chosen: Device | None = None
    try:
        found = devices(fresh=True)
        chosen, why = explain()
    except Error as error:
        why = str(error)
    faults = [*problems(), *(Problem(what, remedy) for what, remedy in clashes())]
    if fault := cache_fault():
        faults.append(Problem(*fault))
    packages = {name: version_of(name) or "(not installed)" for name in (PYIBR, "pyopencl", "numpy")}
    versions = {"Python": platform.python_version(), **packages}
    return Report(versions, cache_folder(), found, faults, chosen, why)


def print_report(console: Console | None = None) -> bool:
    """Print the report to a console, by default on standard output; return whether a device works."""
    from rich.console import Console
    from rich.text import Text

    if console is None:
        console = Console(highlight=False)
        with suppress(AttributeError):  # the output's encoding may lack the marks
            cast("Any", sys.stdout).reconfigure(errors="replace")
    with console.status("testing the OpenCL devices"):
        result = report()
    console.print(", ".join(f"{name} {version}" for name, version in result.versions.items()), style="dim")
    console.print(Text(f"cache {result.cache}", style="dim"))
    for device in result.devices:
        _print_device(console, device, device == result.chosen)
    for problem in result.problems:
        console.print(Text.assemble("\n", ("✗ ", "bold red"), problem.what), soft_wrap=True)
        console.print(Text(f"  to mend it: {problem.remedy}", style="yellow"), soft_wrap=True)
    console.print()
    if result.chosen is None:
        console.print(Text(result.why, style="bold red"), soft_wrap=True)
    else:
        console.print(Text.assemble("pyibr uses ", (str(result.chosen), "bold"), f", {result.why}."), soft_wrap=True)
    return result.chosen is not None


def _print_device(console: Console, device: Device, chosen: bool) -> None:
    from rich.text import Text

    mark = ("✓ ", "bold green") if device.works else ("✗ ", "bold red")
    head = Text.assemble("\n", mark, (f"{device.index}  {device.platform}: {device.name}", "bold" if chosen else ""))
    console.print(head, soft_wrap=True)
    lines = [f"{device.kind}, driver {device.driver}", device.version]
    if device.speed is not None:
        lines.append(f"copy {device.speed.copy:.0f} GB/s, mad {device.speed.mad:.0f} Gflop/s")
    for line in lines:
        console.print(Text(f"     {line}", style="dim"), soft_wrap=True)
    if not device.works:
        console.print(Text(f"     does not work: {device.reason}", style="red"), soft_wrap=True)
        console.print(Text(f"     to mend it: {device.remedy}", style="yellow"), soft_wrap=True)
