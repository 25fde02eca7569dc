"""Colours of OpenEXR files, which are linear in light, as screens show them."""

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
    """Pictures that are read, as screens show them; how much of them is too bright is told in the end.

    stops : float
        How often the light of OpenEXR files is doubled.
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
        """A picture of this file."""
        if path is None or not is_light(path):
            return color
        light = color * self._factor
        self._clipped.append(float((light > 1).any(axis=-1).mean()))
        return srgb_from_linear(light)

    def read(self, path: Path) -> NDArray[Any]:
        """The picture of a file, or the first one of a video."""
        return self.shown(first_frame(path) if path.suffix.lower() in SUFFIXES else read_color(path), path)

    def tell(self) -> None:
        """Say how much is clipped."""
        share = float(np.mean(self._clipped or [0]))
        if share:
            print_note(f"{share:.2%} of the pixels are brighter than 1, and clipped; --exposure -1 halves their light")


def stored(color: NDArray[Any], path: Path) -> NDArray[Any]:
    """Return colours as screens show them as a file is to hold them."""
    if not is_light(path):
        return color
    shown = color / np.float32(255) if color.dtype == np.uint8 else color
    return linear_from_srgb(shown).astype(np.float32)
