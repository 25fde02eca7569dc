"""Style of a page's pictures: all settings of its controls except the camera."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from pyibr.app.view.parameters import Value
from pyibr.picture.light import Light

Layout = Literal["one", "swipe", "side by side", "difference"]
Show = Literal["color", "depth", "classes", "view"]


@dataclass(frozen=True)
class Style:
    """Settings for drawing and showing pictures.

    Attributes
    ----------
    method : str
        Name of the drawing method; see `pyibr.app.view.methods`.
    other : str or None
        Name of the method to compare with.
    layout : {"one", "swipe", "side by side", "difference"}
        Comparison of two methods: `other` right of a line; both and their difference side by side, each showing the
        middle of its picture; or only the difference.
    swipe : float
        Position of the line, 0 to 1.
    gain : float
        Factor of the differences.
    show : {"color", "depth", "classes", "view"}
        Colours; depth; colours with the class of each hole (`pyibr.PixelClass`); or the source view of each pixel.
    light : Light or None
    background : (r, g, b)
        0 to 255.
    parameters : tuple of (name, value)
        Changed parameters of the things; see `pyibr.app.view.parameters`.
    samples, anisotropy : int
        As for `pyibr.render`.
    """

    method: str
    other: str | None = None
    layout: Layout = "one"
    swipe: float = 0.5
    gain: float = 4.0
    show: Show = "color"
    light: Light | None = None
    background: tuple[int, int, int] = (0, 0, 0)
    parameters: tuple[tuple[str, Value], ...] = ()
    samples: int = 1
    anisotropy: int = 1
