"""Markdown pieces of the report."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from benchmarks.results import Record, Skip
from benchmarks.statistics import median


def table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Format a table; an empty text without rows."""
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n" if len(lines) > 2 else ""


def verdict(met: bool) -> str:
    """Tell whether a bar is met."""
    return "met" if met else "**not met**"


def skipped(skips: Iterable[Skip]) -> list[str]:
    """Say which subjects were left out, and why."""
    return [f"Left out: {skip.subject}, because {skip.reason}.\n" for skip in skips]


def origin(environment: dict[str, Any]) -> str:
    """Device and circumstances of a measurement, in one paragraph."""
    device = ", ".join(environment[key] for key in ("device", "platform", "device_version", "driver"))
    versions = ", ".join(f"{name} {version}" for name, version in environment["versions"].items() if version)
    load = environment["load_average"]
    busy = f"load average before {load[0]:.2f}" if load else "load unknown"
    parts = [
        device,
        f"{environment['cpu']}, {environment['cores']} cores",
        f"Python {environment['python']}, {versions}",
        f"commit {environment['commit'] or 'unknown'}",
        f"{environment['time']}, {environment.get('seconds', 0) or 'unknown'} s, {busy}",
    ]
    return f"*{'; '.join(parts)}*\n"


def totals(records: Iterable[Record]) -> dict[int, float]:
    """Add up the medians of all positions, for each size."""
    sums: dict[int, float] = {}
    for record in records:
        n = int(record.parameters["size"])
        sums[n] = sums.get(n, 0.0) + median(record.values)
    return dict(sorted(sums.items()))


def sizes_of(records: Iterable[Record]) -> list[int]:
    """The sizes in records, in order."""
    return sorted({int(record.parameters["size"]) for record in records if "size" in record.parameters})


def position(record: Record) -> tuple[str, str]:
    """Region and motion of a record."""
    return str(record.parameters["region"]), str(record.parameters["motion"])


def only(records: Iterable[Record]) -> list[float]:
    """The values of the one record."""
    (record,) = records
    return record.values
