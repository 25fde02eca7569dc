"""Choice of a device from a list, and the error if none works. This module does not access devices."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from pyibr.core.errors import ArgumentError, DeviceError
from pyibr.opencl.runtimes import Found, Kind, cpu_remedies, preference, problems, remedy_for
from pyibr.opencl.selftest import Outcome, Speed

_log = logging.getLogger("pyibr")

Examine = Callable[[Found], Outcome]


@dataclass(frozen=True)
class Device:
    """An OpenCL device and whether it works.

    Attributes
    ----------
    index : int
        Position in `devices`.
    platform, name : str
        Names from the runtime.
    version, driver : str
        The platform's version text and the driver's version.
    kind : {"cpu", "gpu", "accelerator"}
        Kind of device.
    works : bool
        Whether the device builds and runs a tiny kernel with the right result.
    reason, remedy : str
        Why the device does not work, and the command that fixes it; empty if it works.
    speed : Speed or None
        Measured speed, if any.
    """

    index: int
    platform: str
    name: str
    version: str
    driver: str
    kind: Kind
    works: bool
    reason: str
    remedy: str
    speed: Speed | None = field(compare=False)

    def __str__(self) -> str:
        return f"{self.platform}: {self.name} ({self.kind}, driver {self.driver})"


def describe(found: Found, outcome: Outcome) -> Device:
    """Return a `Device` from a listed device and the outcome of its test."""
    return Device(
        index=found.index,
        platform=found.platform,
        name=found.name,
        version=found.version,
        driver=found.driver,
        kind=found.kind,
        works=outcome.works,
        reason=outcome.reason,
        remedy="" if outcome.works else remedy_for(found),
        speed=outcome.speed,
    )


def choose(found: Sequence[Found], examine: Examine) -> Device:
    """Return the first GPU that works, else the fastest CPU runtime that works, else any device that works.

    Only as many devices are examined as necessary.

    Raises
    ------
    DeviceError
        No device works.
    """
    device, broken = _first_that_works(sorted(found, key=preference), examine)
    if device is None:
        raise DeviceError(_nothing_works(sorted(broken, key=lambda d: d.index)))
    return device


def _first_that_works(found: Sequence[Found], examine: Examine) -> tuple[Device | None, list[Device]]:
    """Return the first device that works, and the broken devices before it."""
    broken: list[Device] = []
    for entry in found:
        device = describe(entry, examine(entry))
        if device.works:
            return device, broken
        broken.append(device)
    return None, broken


def select(found: Sequence[Found], examine: Examine, selector: int | str, argument: str) -> Device:
    """Return the device that a user's selector names.

    selector : int or str
        An index or a part of a name. Platform names have priority, since "intel" also occurs in the processor's name on
        other runtimes. If several devices match, the first that works is used, and the logger "pyibr" reports it.
    argument : str
        Name of the argument or variable, for errors.

    Raises
    ------
    ArgumentError
        No device matches.
    DeviceError
        There are no devices, or no matching device works.
    """
    if not found:
        raise DeviceError(_nothing_works([]))
    text = str(selector).strip().lower()
    if text.isdecimal():
        matches = [f for f in found if f.index == int(text)]
    else:
        of_platforms = [f for f in found if text and text in f"{f.platform}\n{f.version}".lower()]
        matches = of_platforms or [f for f in found if text and text in f.words()]
    if not matches:
        names = "; ".join(f"{f.index} = {f.platform}: {f.name}" for f in found)
        raise ArgumentError(argument, f"an index or a part of the name of one of [{names}]", repr(selector))
    device, broken = _first_that_works(matches, examine)
    if device is None:
        raise DeviceError(f"the device requested by {argument}={selector!r} does not work.\n{explain_broken(broken)}")
    others = "; ".join(f"{f.index} = {f.platform}: {f.name}" for f in matches if f.index != device.index)
    if others:
        _log.info("%s=%r is %d = %s; it also matches %s", argument, selector, device.index, device, others)
    return device


def explain_broken(broken: Sequence[Device]) -> str:
    """Return a text with each broken device, the reason and the remedy."""
    return "\n".join(f"  {d}: {d.reason}\n    to mend it: {d.remedy}" for d in broken)


def _nothing_works(broken: Sequence[Device]) -> str:
    faults = problems()
    lines = ["no OpenCL device works." if broken else "no OpenCL device was found."]
    lines += [f"  {d}: {d.reason}" for d in broken]
    lines += [f"  {p.what}" for p in faults]
    commands = dict.fromkeys([*(p.remedy for p in faults), *cpu_remedies()])
    lines += ["To get one, run one of:", *(f"  {command}" for command in commands)]
    lines.append("`pyibr doctor` shows every device and its problems.")
    return "\n".join(lines)
