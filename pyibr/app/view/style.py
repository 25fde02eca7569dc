"""Style of a page's pictures: all that its controls say but the camera."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from pyibr.app.view.parameters import Value
from pyibr.picture.light import Light

Layout = Literal["one", "swipe", "side by side", "difference"]
Show = Literal["color", "depth", "classes", "view"]


@dataclass(frozen=True)
class Style:
    """Settings by which pictures are drawn and shown.

    Attributes
    ----------
    way : str
        Name of the way that draws; see `pyibr.app.view.methods`.
    other : str or None
        Of the way that it is compared with.
    layout : {"one", "swipe", "side by side", "difference"}
        How two ways are compared: the other one right of a line; both and their difference beside each other, each
        the middle of its picture; or the difference alone.
    swipe : float
        Where that line is, 0 to 1.
    gain : float
        By which differences are multiplied.
    show : {"color", "depth", "classes", "view"}
        The colours; the depth; the colours, and what each hole is (`pyibr.PixelClass`); the number of the view that
        each pixel comes from.
    light : Light or None
    background : (r, g, b)
        0 to 255.
    parameters : tuple of (name, value)
        What is turned at the things; see `pyibr.app.view.parameters`.
    samples, anisotropy : int
        As of `pyibr.render`.
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
