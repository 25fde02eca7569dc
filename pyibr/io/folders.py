"""Files of a folder in the order of their numbers, pairs of files by their times, and images in a file by name."""

from __future__ import annotations

import re
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Literal

import numpy as np

from pyibr.core.errors import FileFormatError

_TIME_DIFFERENCE_MAX = 0.02
"""Largest difference between times of one frame, in seconds, as in the tools of the TUM data sets."""


_A_SECOND = {13: 1_000, 16: 1_000_000, 19: 1_000_000_000}
"""Units per second by the number of digits of a time since 1970, for the years 2001 to 2286."""


_KINDS = re.compile(
    r"(?P<depth>depth)|(?P<color>colou?r|rgb|bgr)|(?P<other>infra|(?<![a-z])n?ir(?![a-z])|therm|confiden|amplitud"
    r"|intensit|disparit|normal|mask|label|segment)"
)


def kind_of(name: str) -> str:
    """The kind of images by the last word of a name: "depth", "color", "other" or ""; depth_to_rgb is depth."""
    found = list(_KINDS.finditer(re.sub(r"_to_[^/]+", "", name.lower())))
    return (found[-1].lastgroup or "") if found else ""


def choose(path: Path, kind: Literal["depth", "color"], misfits: Mapping[str, int], wanted: object = None) -> str:
    """Choose the wanted topic or track, or else one of this kind by name and form; report a choice among several.

    misfits: 0 for names whose images have the kind's form, 1 if they may have the kind, 2 if not.
    """
    names, remedy = ", ".join(misfits) or "none", " (channel=; --depth-channel)" if kind == "depth" else ""
    if wanted is not None:
        word = str(wanted).strip("/").lower()
        found = [one for one in misfits if word in [name.strip("/").lower() for name in (one, *one.split(" ", 1))]]
        if not found:
            raise FileFormatError(f"{path}: expected one of {names}, got {wanted!r}{remedy}")
        return found[0]
    ranks = {one: (misfits[one] > 1, {kind: 0, "": 1}.get(kind_of(one), 2), misfits[one]) for one in misfits}
    best = min(misfits, key=lambda one: ranks[one], default="")
    if not best or (len(misfits) > 1 and (misfits[best] > 1 or (kind == "depth" and ranks[best][1] > 1))):
        raise FileFormatError(f"{path}: expected images of {kind}, got {names}{remedy and f'; name one{remedy}'}")
    others = [one for one in misfits if one != best and misfits[one] < 2]
    if others or (len(misfits) > 1 and sum(ranks[best][1:]) > 1):
        chosen = f"{best} is read as {kind}, not {', '.join(others) or 'one with such a name'}"
        warnings.warn(f"{path}: {chosen}{remedy}", stacklevel=2)
    return best


def files_in(folder: Path, suffixes: Sequence[str], word: str = "") -> list[Path]:
    """A folder's files with one of the suffixes and a word in their names, in the order of the numbers in the names."""
    try:
        found = [file for file in folder.iterdir() if file.suffix.lower() in suffixes and file.is_file()]
    except OSError as error:
        raise FileFormatError(f"{folder}: cannot be read: {error.strerror}") from error
    return sorted((f for f in found if word in f.name.lower() and not f.name.startswith(".")), key=in_order)


def in_order(path: Path) -> list[tuple[int, str]]:
    """A sort key for names, in which 9 precedes 10."""
    return [(int(part) if part.isdecimal() else -1, part) for part in re.split(r"(\d+)", path.name)]


def time_of(path: Path) -> float | None:
    """The time in seconds in a file's name; None if there is none.

    Either the name is a time, such as 1305031232.593722.png; or its only number counts milli-, micro- or nanoseconds
    since 1970, as in robots' recordings.
    """
    if re.fullmatch(r"\d+\.\d+", path.stem):
        return float(path.stem)
    numbers = re.findall(r"\d+", path.stem)
    units = units_of(int(numbers[0])) if len(numbers) == 1 else None
    return None if units is None else int(numbers[0]) / units


def units_of(time: float) -> int | None:
    """Units per second if a number counts milli-, micro- or nanoseconds since 1970, else None."""
    return _A_SECOND.get(len(str(int(time)))) if time == int(time) else None


def number_of(path: Path) -> int | None:
    """The last integer in a file's name without its suffix; None if there is none."""
    numbers = re.findall(r"\d+", path.stem)
    return int(numbers[-1]) if numbers else None


def at_one_time(first: Sequence[float], second: Sequence[float]) -> list[tuple[int, int]]:
    """Pairs of indices into two lists of times that are mutually nearest, and at most 0.02 s apart."""
    if not first or not second:
        return []
    to_second, to_first = _nearest(first, second), _nearest(second, first)
    near = [abs(first[i] - second[j]) <= _TIME_DIFFERENCE_MAX for i, j in enumerate(to_second)]
    return [(i, j) for i, j in enumerate(to_second) if near[i] and to_first[j] == i]


def least_apart(first: Sequence[float], second: Sequence[float]) -> float:
    """The smallest difference between two lists of times."""
    return min(abs(time - second[place]) for time, place in zip(first, _nearest(first, second), strict=True))


def _nearest(times: Sequence[float], others: Sequence[float]) -> list[int]:
    """For each time, the index of the nearest other time."""
    order = np.argsort(others, kind="stable")
    wanted, ordered = np.asarray(times, np.float64), np.asarray(others, np.float64)[order]
    after = np.minimum(np.searchsorted(ordered, wanted), len(ordered) - 1)
    before = np.maximum(after - 1, 0)
    found = np.where(wanted - ordered[before] <= ordered[after] - wanted, before, after)
    return order[found].tolist()
