"""What `render` draws: the contract between a picture and the systems, which it knows nothing of."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any, Literal, Protocol, runtime_checkable

from numpy.typing import NDArray

from pyibr.core.checks import cut_ratio_from, describe, one_of, true_or_false
from pyibr.core.errors import ArgumentError
from pyibr.core.optional import opencv
from pyibr.picture.shadow import Lighting
from pyibr.picture.target import Target

Sample = Literal["linear", "nearest"]
Edges = Literal["connect", "cut"]
Side = Literal["front", "back", "both"]
Fill = Literal["background", "smooth", "inpaint"]


@dataclass(frozen=True)
class Look:
    """How depth images are looked at; what the words mean `pyibr.warp` says.

    Raises
    ------
    ArgumentError
        If one of them is none of its choices.
    MissingPackageError
        If OpenCV fills holes, and is not installed.
    """

    sample: Sample = "linear"
    edges: Edges = "cut"
    cut_ratio: float = 1.05
    side: Side = "front"
    fill: Fill | None = None
    thin: bool = False

    def __post_init__(self) -> None:
        one_of("sample", self.sample, Sample)
        one_of("edges", self.edges, Edges)
        one_of("side", self.side, Side)
        if self.fill is not None:
            one_of("fill", self.fill, Fill, " or None")
        if self.fill == "inpaint":
            opencv('fill="inpaint"', "inpaint")  # before anything is drawn
        true_or_false("thin", self.thin)
        cut_ratio_from(self.cut_ratio)


@runtime_checkable
class Drawable(Protocol):
    """A thing that draws itself.

    Whatever has these two is drawn by `pyibr.render` beside all others, and casts shadows on them. What it keeps on
    the device is its own affair; `pyibr.opencl.kept.kept` makes it once a device. A class of your own needs no more
    than that: no base, no registration.

    Examples
    --------
    >>> import pyibr as ibr
    >>> isinstance(ibr.ReliefSurface, type) and hasattr(ibr.ReliefSurface, "draw")
    True
    """

    @property
    def bounds(self) -> tuple[NDArray[Any], NDArray[Any]]:
        """(low, high), each (3,), finite, in the world: a box around all that it draws, for lights to aim at."""
        ...

    def draw(self, target: Target, lighting: Lighting | None) -> None:
        """Draw into a target, whose device is the current one and whose session is held.

        Parameters
        ----------
        target : Target
            If it is `blank`, every pixel is written: where there is nothing, depth NaN, colour 0, valid 0; or
            `Target.clear` does that first. Else what is drawn replaces what is farther. Of two that are equally far
            the one that was there stays: compare depths, as nearness is rounded there and back. Afterwards it is not
            blank, unless nothing was written at all. If it is `from_light`, its depths alone count: draw what hides
            light, from both its sides.
        lighting : Lighting or None
            None: show the thing's own colours. Else shade it: kernels with normals of their own take
            `Lighting.arguments`; `pyibr.picture.shadow.shadowed` darkens what has none.
        """
        ...


@functools.singledispatch
def as_drawable(thing: object, look: Look) -> Drawable:
    """The `Drawable` that stands for a thing: itself if it is one.

    Systems register what draws a class that knows no OpenCL (`as_drawable.register`), as images and meshes.

    Raises
    ------
    ArgumentError
        If nothing draws it.
    """
    if isinstance(thing, Drawable) and not isinstance(thing, type):  # a class has them, too
        return thing
    known = ", ".join(sorted(kind.__name__ for kind in as_drawable.registry if kind is not object))
    raise ArgumentError("things", f"things that draw themselves (`pyibr.Drawable`), or {known}", describe(thing))
