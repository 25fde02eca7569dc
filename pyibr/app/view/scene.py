"""The scene of a page: methods to draw it, its place, its up direction, and the cameras of its pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from pyibr.app.live.page_space import PageSpace, page_space_around
from pyibr.app.view.methods import RenderMethod, methods_of
from pyibr.core.camera import Camera
from pyibr.core.checks import Float64, numbers
from pyibr.core.errors import ArgumentError
from pyibr.images import DepthImage
from pyibr.images.pictures import camera_before
from pyibr.meshes.mesh import Mesh
from pyibr.picture.drawable import as_drawable

_DOWN = np.array([0.0, -1.0, 0.0])  # up, where nothing else is known: pyibr's y runs down
_SAMPLES = 4096  # of a view that tell where its scene is
_INNER = (2.0, 98.0)  # per cent of them: a few samples far out are no scene


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
    low, high = _bounds_of(given)
    page_space = page_space_around(low, high)
    middle, radius = 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low))
    direction = _up_of(sources) if up is None else numbers("up", up, (3,))
    length = float(np.linalg.norm(direction))
    if length == 0:
        raise ArgumentError("up", "a direction", "zeros")
    direction = direction / length
    views = [one.camera for one in sources if one.camera.projection == "perspective"]
    start = camera or (views[0] if views else camera_before(low, high, direction))
    ahead = float((middle - start.center) @ start.forward)
    pivot = start.center + max(ahead, 0.1 * radius) * start.forward
    plain = any(isinstance(one, Mesh) and one.colors is None and one.texture is None for one in given)
    return Scene(methods, sources, direction, start, pivot, plain, page_space)


def _groups(things: object) -> Sequence[Sequence[Any]]:
    groups = list(cast("Mapping[str, object]", things).values()) if isinstance(things, Mapping) else [things]
    return [list(cast("Sequence[object]", some)) if isinstance(some, Sequence) else [some] for some in groups]


def _bounds_of(things: Sequence[Any]) -> tuple[Float64, Float64]:
    """The box around most of what is there."""
    lows: list[Float64] = []
    highs: list[Float64] = []
    for thing in things:
        if isinstance(thing, DepthImage) and thing.valid.any():
            points = thing.points
            inner = np.percentile(points[:: max(len(points) // _SAMPLES, 1)], _INNER, axis=0)
            low, high = inner[0], inner[1]
        else:
            low, high = (np.asarray(corner, np.float64) for corner in as_drawable(thing).bounds)
        lows.append(low)
        highs.append(high)
    return np.min(lows, axis=0), np.max(highs, axis=0)


def _up_of(sources: Sequence[DepthImage]) -> Float64:
    """Estimate the up direction from most of the pictures."""
    total = np.sum([-one.camera.world_from_camera[:3, 1] for one in sources], axis=0) if sources else _DOWN
    return total if np.linalg.norm(total) > 0.1 * max(len(sources), 1) else _DOWN
