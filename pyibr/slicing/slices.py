"""Checks of the numbers of slices."""

from __future__ import annotations

import numpy as np

from pyibr.core.checks import describe
from pyibr.core.errors import ArgumentError

_SLICES_MOST = 65536
_HALVINGS_MOST = 24  # float32 holds no more


def checked_slices(slices: int) -> int:
    """Return `slices` as an int that is possible, or raise ArgumentError."""
    if isinstance(slices, bool) or not isinstance(slices, (int, np.integer)) or not 1 <= slices <= _SLICES_MOST:  # pyright: ignore[reportUnnecessaryIsInstance]
        raise ArgumentError("slices", f"a whole number from 1 to {_SLICES_MOST}", describe(slices))
    return int(slices)


def checked_halvings(halvings: int) -> int:
    """Return `halvings` as an int that is possible, or raise ArgumentError."""
    if isinstance(halvings, bool) or not isinstance(halvings, (int, np.integer)) or not 0 <= halvings <= _HALVINGS_MOST:  # pyright: ignore[reportUnnecessaryIsInstance]
        raise ArgumentError("halvings", f"a whole number from 0 to {_HALVINGS_MOST}", describe(halvings))
    return int(halvings)
