"""The ways to draw a scene, by name: the only part of the page that knows systems.

Whatever keeps the contract of `pyibr.Drawable` is drawn by `render`. Depth images are drawn by the warp, too, and by
the systems that make an object of several.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, cast

import numpy as np

from pyibr.app.view.knobs import turned
from pyibr.app.view.style import Style
from pyibr.core.camera import Camera
from pyibr.core.checks import describe
from pyibr.core.errors import ArgumentError
from pyibr.depthmesh import DepthMeshObject
from pyibr.images import DepthImage, Frame
from pyibr.picture.drawable import Look, as_drawable
from pyibr.picture.render import Thing, render
from pyibr.slicing import DepthObject, VisualHull
from pyibr.warp.warp import Method, warp

Draw = Callable[[Sequence[Any], Camera, Style], Frame]

_KEPT = 4  # states of the knobs whose things stay on the device


@dataclass(frozen=True)
class Way:
    """A way to draw a scene.

    Attributes
    ----------
    make : callable -> sequence of things
        What is drawn, made on first use.
    how : callable (things, camera, style) -> Frame
    explains : bool
        Its frames tell what each pixel is and which view it comes from.
    lit : bool
        A light shines.
    """

    make: Callable[[], Sequence[Any]]
    how: Draw
    explains: bool = False
    lit: bool = True

    @cached_property
    def things(self) -> Sequence[Any]:
        """What is drawn, with all knobs as they were given."""
        return self.make()

    def draw(self, camera: Camera, style: Style) -> Frame:
        """A frame of the things, with the knobs turned as the style says."""
        things = self._turned.get(style.knobs)
        if things is None:
            things = [turned(thing, dict(style.knobs)) for thing in self.things]
            while len(self._turned) >= _KEPT:
                del self._turned[next(iter(self._turned))]
            self._turned[style.knobs] = things
        return self.how(things, camera, style)

    @cached_property
    def _turned(self) -> dict[object, Sequence[Any]]:
        return {}


def ways_of(things: object) -> dict[str, Way]:
    """The ways to draw what a user has given: a thing, a sequence of things, or named ones to choose from.

    Raises
    ------
    ArgumentError
        If it is none of that, or something in it is nothing that can be drawn.
    """
    if isinstance(things, Mapping):
        named = cast("Mapping[object, object]", things)
        if not named or not all(isinstance(name, str) for name in named):
            raise ArgumentError("things", "things by their names, at least one", describe(cast("object", things)))
        return {str(name): _rendered(_checked(some)) for name, some in named.items()}
    given = _checked(things)
    if not all(isinstance(thing, DepthImage) for thing in given):
        return {"render": _rendered(given)}
    return _ways_of_views(_alike([cast("DepthImage", thing) for thing in given]))


def _ways_of_views(views: Sequence[DepthImage]) -> dict[str, Way]:
    ways = {"warp": _warped(views, "epipolar"), "render": _rendered(views)}
    ways |= {"search": _warped(views, "search"), "forward": _warped(views, "forward")}
    ways["depth mesh"] = Way(lambda: [DepthMeshObject(views)], _render)
    ways["depth object"] = Way(lambda: [DepthObject(views)], _render)
    ways["visual hull"] = Way(lambda: [VisualHull(views)], _render)
    return ways


def _rendered(things: Sequence[Thing]) -> Way:
    return Way(lambda: things, _render)


def _warped(views: Sequence[DepthImage], method: Method) -> Way:
    def draw(things: Sequence[DepthImage], camera: Camera, style: Style) -> Frame:
        look, classes = style.look, style.show in ("classes", "view") and method != "forward"
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # an empty picture is seen to be empty
            frame = warp(
                list(things),
                camera,
                method,
                look.sample,
                look.edges,
                look.fill,
                cut_ratio=look.cut_ratio,
                side=look.side,
                blend=style.blend,
                classes=classes,
            )
        frame.color[np.isnan(frame.depth)] = _background(style, frame)
        return frame

    return Way(lambda: views, draw, explains=method != "forward", lit=False)


def _render(things: Sequence[Thing], camera: Camera, style: Style) -> Frame:
    look, in_float = style.look, any(isinstance(one, DepthImage) and one.color.dtype == np.float32 for one in things)
    return render(
        things,
        camera,
        style.light,
        np.array(style.background) / (255 if in_float else 1),
        edges=look.edges,
        cut_ratio=look.cut_ratio,
        side=look.side,
        sample=look.sample,
        fill=look.fill,
    )


def _background(style: Style, frame: Frame) -> Any:
    return np.array(style.background) / (255 if frame.color.dtype == np.float32 else 1)


def _checked(things: object) -> list[Any]:
    several = list(cast("Sequence[object]", things)) if isinstance(things, Sequence) else [things]
    if not several:
        raise ArgumentError("things", "at least one thing", "an empty sequence")
    for thing in several:
        as_drawable(thing, Look())
    return several


def _alike(views: Sequence[DepthImage]) -> list[DepthImage]:
    """The views with colours of one kind, as the warp wants them."""
    shown = [view.in_color for view in views]
    return shown if len({view.color.dtype for view in shown}) == 1 else [view.in_float for view in shown]
