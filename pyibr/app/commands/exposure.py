"""Linear colours of OpenEXR files, converted for screens."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.app.options import print_note
from pyibr.core.checks import number_from
from pyibr.images.srgb import linear_from_srgb, srgb_from_linear
from pyibr.io import read_color
from pyibr.io.exr import is_light
from pyibr.io.video import SUFFIXES, first_frame


class Exposure:
    """Converts pictures for screens, and reports the fraction of clipped pixels at the end.

    stops : float
        Colours of OpenEXR files are multiplied by 2^stops.
    """

    def __init__(self, stops: float) -> None:
        self._factor = np.float32(2.0 ** number_from("--exposure", stops, -64, 64, "stops from -64 to 64"))
        self._clipped: list[float] = []

    def __enter__(self) -> Exposure:
        return self

    def __exit__(self, kind: object, *error: object) -> None:
        if kind is None:
            self.tell()

    def shown(self, color: NDArray[Any], path: Path | None) -> NDArray[Any]:
        """Convert the picture of this file."""
        if path is None or not is_light(path):
            return color
        light = color * self._factor
        self._clipped.append(float((light > 1).any(axis=-1).mean()))
        return srgb_from_linear(light)

    def read(self, path: Path) -> NDArray[Any]:
        """Read the picture of a file, or the first picture of a video."""
        return self.shown(first_frame(path) if path.suffix.lower() in SUFFIXES else read_color(path), path)

    def tell(self) -> None:
        """Print the fraction of clipped pixels."""
        share = float(np.mean(self._clipped or [0]))
        if share:
            print_note(f"{share:.2%} of all pixels are brighter than 1 and clipped; --exposure -1 halves their light")


def stored(color: NDArray[Any], path: Path) -> NDArray[Any]:
    """Convert colours from screens to the file's encoding."""
    if not is_light(path):
        return color
    shown = color / np.float32(255) if color.dtype == np.uint8 else color
    return linear_from_srgb(shown).astype(np.float32)
