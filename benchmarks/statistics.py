"""The few statistics that the reports need."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

Key = TypeVar("Key")


@dataclass(frozen=True)
class Quartiles:
    """Quartiles of raw samples."""

    low: float
    median: float
    high: float

    @classmethod
    def of(cls, values: Iterable[float]) -> Quartiles:
        return cls(*np.percentile(list(values), (25, 50, 75)).tolist())

    def __str__(self) -> str:
        return f"{number(self.median)} ({number(self.low)} to {number(self.high)})"


def median(values: Iterable[float]) -> float:
    """Median of raw samples."""
    return Quartiles.of(values).median


def exponent(sizes: Sequence[float], values: Sequence[float]) -> float:
    """Fit the power of the size with which values grow, by a least-squares line through their logarithms.

    Examples
    --------
    >>> round(exponent([1, 2, 4], [3, 12, 48]), 6)
    2.0
    """
    if len(set(sizes)) < 2:
        raise ValueError(f"sizes: expected at least two different ones, got {list(sizes)}")
    return float(np.polyfit(np.log(sizes), np.log(values), 1)[0])


def ratios(values: Mapping[Key, float], base: Mapping[Key, float]) -> list[float]:
    """Divide values by the base's values, for the keys that both have."""
    return [value / base[key] for key, value in values.items() if key in base]


def number(value: float) -> str:
    """Format with three significant digits."""
    if value == 0 or not math.isfinite(value):
        return f"{value:g}"
    digits = max(0, 2 - math.floor(math.log10(abs(value))))
    return f"{value:.{digits}f}"
