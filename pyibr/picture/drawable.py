"""Contract of what `render` draws, between a picture and the systems, which it knows nothing of."""

from __future__ import annotations

import functools
from collections.abc import Iterable
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from pyibr.core.checks import describe
from pyibr.core.errors import ArgumentError
from pyibr.picture.shadow import Lighting
from pyibr.picture.target import Target


@runtime_checkable
class Drawable(Protocol):
    """A thing that draws itself.

    Whatever has these two is drawn by `pyibr.render` beside all others, and casts shadows on them. What it keeps on
    the device is its own affair; `pyibr.opencl.device_cache.cached_on_device` makes it once a device. A class of
    your own needs no more than that: no base, no registration. It may have two more: `Finishing.finish`, and a
    `color_dtype`, the dtype of its colours: where that is float32, the picture is in floats.

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
            `Lighting.arguments`; what holds its light is entered by `pyibr.picture.deferred.entry_for`.
        """
        ...


@runtime_checkable
class Finishing(Protocol):
    """A thing with a second step, once all things have drawn."""

    def finish(self, target: Target) -> None:
        """Add what depends on all things, as colours for holes: in their order, never over what was seen."""
        ...


def color_dtype_of(drawables: Iterable[Drawable]) -> np.dtype[Any]:
    """The dtype of a picture's colours: float32 if those of a thing are (`color_dtype`), else uint8."""
    found = (getattr(drawable, "color_dtype", np.uint8) for drawable in drawables)
    return np.dtype(np.float32 if any(dtype == np.float32 for dtype in found) else np.uint8)


@functools.singledispatch
def as_drawable(thing: object) -> Drawable:
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
