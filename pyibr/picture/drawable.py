"""Protocols of things that `render` draws. They keep the picture independent of the systems."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Iterable, Sequence
from typing import Any, Protocol, cast, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from pyibr.core.checks import describe
from pyibr.core.errors import ArgumentError
from pyibr.picture.shadow import Lighting
from pyibr.picture.target import Target


@runtime_checkable
class Drawable(Protocol):
    """A thing that draws itself.

    `pyibr.render` draws any object with these two members together with other things, and the things cast shadows on
    each other. A class of your own needs no base class and no registration. It may have more members:
    `Guessing.guess`, `Finishing.finish`, `Blending.blend_together`, and `color_dtype`, the dtype of its colours; if
    that is float32, so is the picture. Objects manage their own data on the device;
    `pyibr.opencl.device_cache.cached_on_device` creates it once per device.

    Examples
    --------
    >>> import pyibr as ibr
    >>> isinstance(ibr.ReliefSurface, type) and hasattr(ibr.ReliefSurface, "draw")
    True
    """

    @property
    def bounds(self) -> tuple[NDArray[Any], NDArray[Any]]:
        """(low, high), each (3,), finite, in the world: a box around the thing, which shadow maps cover."""
        ...

    def draw(self, target: Target, lighting: Lighting | None) -> None:
        """Draw into a target, whose device is the current one and whose session is held.

        Parameters
        ----------
        target : Target
            If the target is `blank`, write every pixel (empty ones get depth NaN, colour 0 and valid 0), or call
            `Target.clear` first. Otherwise, replace only pixels that are farther; at equal depth, the earlier pixel
            stays. Compare depths, since converting to nearness and back rounds. Afterwards, set `blank` to False,
            unless nothing was written. If the target is `from_light`, only depths count: draw all surface that blocks
            light, from both sides.
        lighting : Lighting or None
            With None, show the thing's own colours. Otherwise, shade the thing: kernels with normals take
            `Lighting.arguments`; for colours that already contain light, call `pyibr.picture.deferred.entry_for`.
        """
        ...


@runtime_checkable
class Guessing(Protocol):
    """A thing with guesses of surface that no view has seen. They are drawn after all things, only in holes."""

    def guess(self, target: Target, lighting: Lighting | None) -> None:
        """Draw guesses into holes only, and set `Target.guessed`. They count as surface until all things finish."""
        ...


@runtime_checkable
class Finishing(Protocol):
    """A thing with a second step, after all things are drawn."""

    def finish(self, target: Target) -> None:
        """Add results that depend on all things, such as colours for holes. Never overwrite seen surface.

        Things finish in their order.
        """
        ...


@runtime_checkable
class Blending(Protocol):
    """A thing that is not opaque, and casts no shadow. It is blended after all other things are drawn and finished."""

    @staticmethod
    def blend_together(things: Sequence[Any], target: Target, lighting: Lighting | None) -> None:
        """Blend all of a picture's things with this same function, in front of the surface in the target.

        Multiply the target's colours by the light that passes, and add the things' own. Update `Target.alpha`, the
        picture's opacity, which begins as 1 where the picture is valid, else 0. Where half of the light is stopped, set
        the depth, and `valid` to 1. The picture should not depend on the things' order. Things of several functions are
        blended function by function, in the order of their first things.
        """
        ...


def blend_things(drawables: Iterable[Drawable], target: Target, lighting: Lighting | None) -> None:
    """Blend things that are `Blending`: all things of one function together."""
    together: dict[Callable[..., None], list[Drawable]] = {}
    for drawable in drawables:
        kind = cast("Any", type(drawable))
        if not isinstance(inspect.getattr_static(kind, "blend_together", None), staticmethod):
            raise ArgumentError("things", "classes with a static method `blend_together`", kind.__qualname__)
        together.setdefault(kind.blend_together, []).append(drawable)
        target.made_alpha()
    for blend, things in together.items():
        blend(things, target, lighting)


def color_dtype_of(drawables: Iterable[Drawable]) -> np.dtype[Any]:
    """Return the dtype of a picture's colours: float32 if a thing has this `color_dtype`, else uint8."""
    found = (getattr(drawable, "color_dtype", np.uint8) for drawable in drawables)
    return np.dtype(np.float32 if any(dtype == np.float32 for dtype in found) else np.uint8)


@functools.singledispatch
def as_drawable(thing: object) -> Drawable:
    """Return the `Drawable` for a thing: the thing itself if it is one.

    Systems register drawables (`as_drawable.register`) for classes without OpenCL, such as images and meshes.

    Raises
    ------
    ArgumentError
        If no drawable is registered for the thing.
    """
    # A class itself has these members, too. Before Python 3.12, `isinstance` of a protocol computes properties.
    if not isinstance(thing, type) and _has(thing, "bounds") and _has(thing, "draw"):
        return cast("Drawable", thing)
    known = ", ".join(sorted(kind.__name__ for kind in as_drawable.registry if kind is not object))
    raise ArgumentError("things", f"things that draw themselves (`pyibr.Drawable`), or {known}", describe(thing))


def _has(thing: object, name: str) -> bool:
    return inspect.getattr_static(thing, name, _has) is not _has
