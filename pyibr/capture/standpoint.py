"""A place to look at things from, and what one turns about there."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike

from pyibr.core.camera import Camera
from pyibr.core.checks import Float64, numbers
from pyibr.core.errors import ArgumentError
from pyibr.images import DepthImage
from pyibr.images.pictures import camera_before
from pyibr.picture.drawable import as_drawable
from pyibr.warp.view import WarpedView

_DOWN = np.array([0.0, -1.0, 0.0])  # up, where nothing else is known: pyibr's y runs down
_SAMPLES = 4096  # of a view that tell where its scene is
_INNER = (2.0, 98.0)  # per cent of them: a few samples far out are no scene


class Standpoint(NamedTuple):
    """A place to begin.

    Attributes
    ----------
    camera : Camera
    pivot : (3,)
        In the world: what one turns about.
    up : (3,)
        In the world, of length 1.
    low, high : (3,)
        The box around most of what is there.
    """

    camera: Camera
    pivot: Float64
    up: Float64
    low: Float64
    high: Float64


def standpoint(things: Any, camera: Camera | None = None, up: ArrayLike | None = None) -> Standpoint:
    """The place to begin with.

    Parameters
    ----------
    things : thing or sequence of things
    camera : Camera, optional
        By default the first perspective depth image's, or one that sees all.
    up : (3,), optional
        By default what is up in the depth images, or -y.

    Raises
    ------
    ArgumentError
        If `up` is no direction, or the things have no extent.
    """
    whole = list(cast("Sequence[Any]", things)) if isinstance(things, Sequence) else [things]
    given = [one for thing in whole for one in (thing.views if isinstance(thing, WarpedView) else [thing])]
    sources = [thing for thing in given if isinstance(thing, DepthImage)]
    low, high = _bounds_of(given)
    radius = radius_of(low, high)
    direction = _up_of(sources) if up is None else numbers("up", up, (3,))
    length = float(np.linalg.norm(direction))
    if length == 0:
        raise ArgumentError("up", "a direction", "zeros")
    direction = direction / length
    views = [one.camera for one in sources if one.camera.projection == "perspective"]
    start = camera or (views[0] if views else camera_before(low, high, direction))
    ahead = float((0.5 * (low + high) - start.center) @ start.forward)
    return Standpoint(start, start.center + max(ahead, 0.1 * radius) * start.forward, direction, low, high)


def radius_of(low: Float64, high: Float64) -> float:
    """Half the diagonal of a box, or ArgumentError if that has no extent, or no end."""
    radius = 0.5 * float(np.linalg.norm(high - low))
    if not (np.isfinite(radius) and radius > 0):
        raise ArgumentError("things", "things of some extent", f"a box from {low} to {high}")
    return radius


def _bounds_of(things: Sequence[Any]) -> tuple[Float64, Float64]:
    """The box around most of what is there, (low, high) in the world."""
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
