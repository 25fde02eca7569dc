"""The scene of a page: its methods, page space, up direction, and initial camera."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

from numpy.typing import ArrayLike

from pyibr.app.live.page_space import PageSpace, page_space_around
from pyibr.app.view.methods import RenderMethod, methods_of
from pyibr.capture.standpoint import standpoint
from pyibr.core.camera import Camera
from pyibr.core.checks import Float64
from pyibr.images import DepthImage
from pyibr.meshes.mesh import Mesh


@dataclass(frozen=True)
class Scene:
    """Things to look at."""

    methods: dict[str, RenderMethod]  # for drawing them, by name
    sources: list[DepthImage]  # the depth images among them
    up: Float64  # (3,), of length 1, in the world
    start: Camera  # its size is not used
    pivot: Float64  # (3,), in the world; the view turns about it
    plain: bool  # whether there is a mesh without colours, whose shape needs a light to be visible
    page_space: PageSpace


def scene_of(things: object, camera: Camera | None = None, up: ArrayLike | None = None) -> Scene:
    """The scene for the arguments of `pyibr.view`.

    Raises
    ------
    ArgumentError
        If nothing can be drawn, or an argument has a wrong type or value.
    """
    methods = methods_of(things)
    groups = list(cast("Mapping[str, Any]", things).values()) if isinstance(things, Mapping) else [things]
    given = list[Any]()
    for some in groups:
        given += cast("Sequence[Any]", some) if isinstance(some, Sequence) else [some]
    sources = [thing for thing in given if isinstance(thing, DepthImage)]
    at = standpoint(given, camera, up)
    page_space = page_space_around(at.low, at.high)
    plain = any(isinstance(one, Mesh) and one.colors is None and one.texture is None for one in given)
    return Scene(methods, sources, at.up, at.camera, at.pivot, plain, page_space)
