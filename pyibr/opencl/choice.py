"""Choice of a device among those found, and the error where none will do. Nothing here touches a device."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from pyibr.core.errors import ArgumentError, DeviceError
from pyibr.opencl.outcome import Outcome, Speed
from pyibr.opencl.runtimes import Found, Kind, cpu_remedies, problems, remedy_for

_log = logging.getLogger("pyibr")

Examine = Callable[[Found], Outcome]


@dataclass(frozen=True)
class Device:
    """An OpenCL device and whether it works.

    Attributes
    ----------
    index : int
        Its place in `devices`.
    platform, name : str
        As the runtime gives them.
    version, driver : str
        The platform's version text and the driver's version.
    kind : {"cpu", "gpu", "accelerator"}
        What it is.
    works : bool
        Whether it builds and runs a tiny kernel, with the right result.
    reason, remedy : str
        Why it does not work and the command that mends it; empty where it works.
    speed : Speed or None
        Figures of its speed, where they were measured.
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
    """Join a device that was found with the outcome of its test."""
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


def choose(found: Sequence[Found], examine: Examine, picture_time: Callable[[Found], float]) -> Device:
    """The first GPU that works, else the fastest CPU runtime that works, else anything that works.

    No more devices are examined than the choice needs, and no times are asked for where one CPU runtime works alone.

    Raises
    ------
    DeviceError
        None works.
    """
    broken: list[Device] = []
    for kind in ("gpu", "cpu", "accelerator"):
        working: list[Found] = []
        for entry in (f for f in found if f.kind == kind):
            device = describe(entry, examine(entry))
            if device.works and kind != "cpu":
                return device
            if device.works:
                working.append(entry)
            else:
                broken.append(device)
        if working:
            fastest = min(working, key=picture_time) if len(working) > 1 else working[0]
            return describe(fastest, examine(fastest))
    raise DeviceError(_nothing_works(sorted(broken, key=lambda d: d.index)))


def select(found: Sequence[Found], examine: Examine, selector: int | str, argument: str) -> Device:
    """The device that a user's words mean.

    Parameters
    ----------
    found : sequence of Found
        What there is.
    examine : callable
        Tells whether one of them works.
    selector : int or str
        An index or a part of a name. Platforms' names come first: processors are of Intel's, too, whose own runtime is
        another. Of several that match, the first that works is meant, which the logger "pyibr" tells.
    argument : str
        Where the words came from, for the error.

    Raises
    ------
    ArgumentError
        Nothing found matches.
    DeviceError
        Nothing is found, or what matches does not work.
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
    broken: list[Device] = []
    for match in matches:
        device = describe(match, examine(match))
        if device.works:
            others = "; ".join(f"{f.index} = {f.platform}: {f.name}" for f in matches if f is not match)
            if others:
                _log.info("%s=%r is %d = %s; it fits %s, too", argument, selector, device.index, device, others)
            return device
        broken.append(device)
    raise DeviceError(f"the device asked for by {argument}={selector!r} does not work.\n{explain_broken(broken)}")


def explain_broken(broken: Sequence[Device]) -> str:
    """Each device that does not work, why, and what mends it."""
    return "\n".join(f"  {d}: {d.reason}\n    to mend it: {d.remedy}" for d in broken)


def _nothing_works(broken: Sequence[Device]) -> str:
    faults = problems()
    lines = ["no OpenCL device works." if broken else "no OpenCL device was found."]
    lines += [f"  {d}: {d.reason}" for d in broken]
    lines += [f"  {p.what}" for p in faults]
    commands = dict.fromkeys([*(p.remedy for p in faults), *cpu_remedies()])
    lines += ["To get one, run one of:", *(f"  {command}" for command in commands)]
    lines.append("`pyibr doctor` shows every device and what it lacks.")
    return "\n".join(lines)
