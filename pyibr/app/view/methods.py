"""The methods for drawing a scene, by name: the only part of the page that depends on the rendering systems.

`render` draws everything that fulfils the contract of `pyibr.Drawable`. Depth images can also be drawn by the warp, and
by the systems that combine several of them to an object.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal, cast

import numpy as np

from pyibr.app.view.moving import LastPictures
from pyibr.app.view.parameters import Parameter, Value, parameters_of, with_parameters
from pyibr.core.camera import Camera
from pyibr.core.checks import describe
from pyibr.core.errors import ArgumentError
from pyibr.depthmesh import DepthMeshObject
from pyibr.gaussians import Gaussians
from pyibr.images import DepthImage, Frame
from pyibr.picture.drawable import as_drawable, color_dtype_of
from pyibr.picture.light import Light
from pyibr.picture.render import Thing, render
from pyibr.slicing import DepthObject, VisualHull
from pyibr.warp.view import Method, WarpedView
from pyibr.warp.warp import warp

Layout = Literal["one", "swipe", "side by side", "difference"]
Show = Literal["color", "depth", "classes", "view"]

_COARSEST = 0.5  # scale below which a warp takes little less time, and shows little
_CACHED_MAX = 4  # sets of parameter values whose things stay on the device


@dataclass(frozen=True)
class Style:
    """Settings of a page's controls, except its camera, for drawing and showing pictures."""

    method: str  # name of a `RenderMethod`
    other: str | None = None  # name of the method to compare with
    layout: Layout = "one"  # swipe: `other` right of a line; side by side: the middles of both, and their difference
    swipe: float = 0.5  # position of the line, 0 to 1
    gain: float = 4.0  # factor of the differences
    show: Show = "color"  # classes: of holes (`pyibr.PixelClass`); view: the source view of each pixel
    light: Light | None = None
    background: tuple[int, int, int] = (0, 0, 0)  # 0 to 255
    parameters: tuple[tuple[str, Value], ...] = ()  # values to set in the things, by name
    samples: int = 1  # and anisotropy: as for `pyibr.render`
    anisotropy: int = 1
    moving: bool = False  # whether the camera moves: pictures may be warped from exact ones

    @property
    def look(self) -> Style:
        """The settings on which a method's frame depends, others at their defaults."""
        return replace(self, method="", other=None, layout="one", swipe=0.5, gain=4.0, show="color", moving=False)


Draw = Callable[[Sequence[Any], Camera, Style], Frame]


@dataclass(frozen=True)
class RenderMethod:
    """A method for drawing a scene."""

    make: Callable[[], Sequence[Any]]  # makes the things to draw, on first use
    how: Draw
    explains: bool = False  # whether its frames hold the class and the source view of each pixel
    coarsest: float = 0.0  # least scale of its pictures while the camera moves
    fixed: tuple[str, ...] = ()  # options of the things that define this method and are therefore not parameters

    @cached_property
    def things(self) -> Sequence[Any]:
        """The things to draw, with all parameters as given."""
        return self.make()

    @property
    def parameters(self) -> dict[str, Parameter]:
        """Parameters of the things that a page can change, by name."""
        return {name: parameter for name, parameter in parameters_of(self.things).items() if name not in self.fixed}

    def draw(self, camera: Camera, style: Style) -> Frame:
        """A frame of the things, with the style's parameters."""
        things = self._with_parameters.get(style.parameters)
        if things is None:
            values = {name: value for name, value in style.parameters if name not in self.fixed}
            things = [with_parameters(thing, values) for thing in self.things]
            while len(self._with_parameters) >= _CACHED_MAX:
                del self._with_parameters[next(iter(self._with_parameters))]
            self._with_parameters[style.parameters] = things
        return self.how(things, camera, style)

    @cached_property
    def _with_parameters(self) -> dict[object, Sequence[Any]]:
        return {}


def methods_of(things: object) -> dict[str, RenderMethod]:
    """The methods for drawing a thing, a sequence of things, or a mapping of named things to select from.

    Raises
    ------
    ArgumentError
        If `things` has another type, or holds objects that cannot be drawn.
    """
    if isinstance(things, Mapping):
        named = cast("Mapping[object, object]", things)
        if not named or not all(isinstance(name, str) for name in named):
            raise ArgumentError("things", "at least one thing by name", describe(cast("object", things)))
        return {str(name): _rendered(_checked(some)) for name, some in named.items()}
    given = _checked(things)
    if not all(isinstance(thing, DepthImage) for thing in given):
        return {"render": _rendered(given)}
    return _methods_of_views(_alike([cast("DepthImage", thing) for thing in given]))


def _methods_of_views(views: Sequence[DepthImage]) -> dict[str, RenderMethod]:
    methods = {"warp": _warped(views, "epipolar")}
    methods["render"] = RenderMethod(lambda: [WarpedView(view) for view in views], _render, fixed=("blend",))
    methods |= {"search": _warped(views, "search"), "forward": _warped(views, "forward")}
    methods["depth mesh"] = RenderMethod(lambda: [DepthMeshObject(views)], _render)
    methods["depth object"] = RenderMethod(lambda: [DepthObject(views)], _render)
    methods["visual hull"] = RenderMethod(lambda: [VisualHull(views)], _render)
    return methods


def _rendered(things: Sequence[Thing]) -> RenderMethod:
    if not any(isinstance(thing, Gaussians) for thing in things):
        return RenderMethod(lambda: things, _render)
    last = LastPictures()

    def draw(things: Sequence[Thing], camera: Camera, style: Style) -> Frame:
        exact = last.draw_moving if style.moving else last.draw
        return exact(lambda camera: _render(things, camera, style), camera, style.look)

    return RenderMethod(lambda: things, draw, coarsest=_COARSEST)


def _warped(views: Sequence[DepthImage], method: Method) -> RenderMethod:
    def draw(things: Sequence[WarpedView], camera: Camera, style: Style) -> Frame:
        if style.show not in ("classes", "view") or method == "forward":
            return _render(things, camera, style)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # the user sees that a picture is empty
            frame = warp(things[0], camera, origins=True, classes=style.show == "classes")
        frame.color[np.isnan(frame.depth)] = _background(style, frame.color.dtype)
        return frame

    return RenderMethod(lambda: [WarpedView(views, method=method)], draw, method != "forward", fixed=("method",))


def _render(things: Sequence[Thing], camera: Camera, style: Style) -> Frame:
    dtype = color_dtype_of(map(as_drawable, things))
    background = _background(style, dtype)
    return render(things, camera, style.light, background, samples=style.samples, anisotropy=style.anisotropy)


def _background(style: Style, dtype: np.dtype[Any]) -> Any:
    return np.array(style.background) / (255 if dtype == np.float32 else 1)


def _checked(things: object) -> list[Any]:
    several = list(cast("Sequence[object]", things)) if isinstance(things, Sequence) else [things]
    if not several:
        raise ArgumentError("things", "at least one thing", "an empty sequence")
    for thing in several:
        as_drawable(thing)
    return several


def _alike(views: Sequence[DepthImage]) -> list[DepthImage]:
    """Convert the views to colours of one kind, as the warp requires."""
    shown = [view.in_color for view in views]
    return shown if len({view.color.dtype for view in shown}) == 1 else [view.in_float for view in shown]
