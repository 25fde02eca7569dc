"""Exposures of several views of one scene, told from the colours of what they show together."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.core.checks import Float64

_OVERLAP_MIN = 200  # pixels of an overlap that tell anything
_DARKEST, _BRIGHTEST = 0.08, 0.98  # of a channel's range: beyond, sensors do not tell


@dataclass(frozen=True)
class Overlap:
    """Colours in [0, 1], (n, 3) each, that the views `first` and `second` give to the same points."""

    first: int
    second: int
    first_colors: NDArray[np.floating[Any]]
    second_colors: NDArray[np.floating[Any]]


def matching_gains(views: int, overlaps: Iterable[Overlap]) -> Float64:
    """(views, 3) what each view's colours are to be multiplied by, so that they agree where they overlap.

    Views that nothing is known of keep their colours, and so does the one in the middle: most cameras are right.
    """
    rows: list[Float64] = []
    ratios: list[Float64] = []
    for overlap in overlaps:
        both = np.stack([overlap.first_colors, overlap.second_colors])
        tells = ((both > _DARKEST) & (both < _BRIGHTEST)).all(axis=(0, 2))
        if (count := np.count_nonzero(tells)) >= _OVERLAP_MIN:
            row = np.zeros(views)
            row[overlap.first], row[overlap.second] = np.sqrt(count), -np.sqrt(count)
            rows.append(row)
            first, second = np.log(both[:, tells])
            ratios.append(-np.sqrt(count) * np.median(first - second, axis=0))
    gains = np.zeros((views, 3))
    if rows:
        gains = np.linalg.lstsq(np.array(rows), np.array(ratios), rcond=None)[0]
        gains -= np.median(gains, axis=0)
    return np.exp(gains)
