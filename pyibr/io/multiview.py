"""Parameters of Middlebury's multi-view sets: a line for each picture with name, K, R, t; x_camera = R x_world + t."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pyibr.core.camera import Camera
from pyibr.core.checks import checked_size
from pyibr.core.files import read_text, reading

_NUMBERS = 21


def are_parameters(path: Path) -> bool:
    """Tell whether a text file begins with a count, and a line of a name and 21 numbers."""
    try:
        first, second = (line.split() for line in read_text(path).splitlines()[:2])
    except (OSError, ValueError):
        return False
    return len(first) == 1 and first[0].isdigit() and len(second) == 1 + _NUMBERS


def read_parameters(path: Path, size: tuple[int, int] | None) -> dict[str, Camera]:
    """The cameras by picture name, for pictures of this size."""
    shown = checked_size(size)
    with reading(path, "multi-view parameters") as source:
        lines = [line.split() for line in read_text(source).splitlines()[1:] if line.strip()]
        rows = {line[0]: np.array([float(word) for word in line[1:]]) for line in lines}
        if any(len(row) != _NUMBERS for row in rows.values()):
            raise ValueError("expected 9 numbers of K, 9 of R, 3 of t for each picture")
        return {
            name: Camera.from_opencv(row[:9].reshape(3, 3), row[9:18].reshape(3, 3), row[18:], shown)
            for name, row in rows.items()
        }
