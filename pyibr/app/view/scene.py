"""The scene of a page: methods to draw it, its place, its up direction, and the cameras of its pictures."""

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
    """Things to look at.

    Attributes
    ----------
    ways : dict
        The ways to draw them, by name; see `pyibr.app.view.methods`.
    sources : list of DepthImage
        Those that are among the things.
    up : (3,)
        In the world, of length 1.
    start : Camera
        Where one begins; its size does not count.
    pivot : (3,)
        In the world: what one turns about.
    plain : bool
        There is a mesh without colours, which shows its form only in a light.
    page_space : PageSpace
    """

    methods: dict[str, RenderMethod]
    sources: list[DepthImage]
    up: Float64
    start: Camera
    pivot: Float64
    plain: bool
    page_space: PageSpace


def scene_of(things: object, camera: Camera | None = None, up: ArrayLike | None = None) -> Scene:
    """The scene of what a user has given; see `pyibr.view`.

    Raises
    ------
    ArgumentError
        If there is nothing that can be drawn, or an argument has a wrong type or value.
    """
    methods = methods_of(things)
    given = [thing for some in _groups(things) for thing in some]
    sources = [thing for thing in given if isinstance(thing, DepthImage)]
    at = standpoint(given, camera, up)
    page_space = page_space_around(at.low, at.high)
    plain = any(isinstance(one, Mesh) and one.colors is None and one.texture is None for one in given)
    return Scene(methods, sources, at.up, at.camera, at.pivot, plain, page_space)


def _groups(things: object) -> Sequence[Sequence[Any]]:
    groups = list(cast("Mapping[str, object]", things).values()) if isinstance(things, Mapping) else [things]
    return [list(cast("Sequence[object]", some)) if isinstance(some, Sequence) else [some] for some in groups]
