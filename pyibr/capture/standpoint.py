"""A viewpoint to start from, and the pivot to turn about."""

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

_DOWN = np.array([0.0, -1.0, 0.0])  # default direction of up: pyibr's y points down
_SAMPLES = 4096  # samples of a view that locate its scene
_INNER = (2.0, 98.0)  # percentiles of these samples: a few far outliers are ignored


class Standpoint(NamedTuple):
    """A viewpoint to start from."""

    camera: Camera
    pivot: Float64  # (3,), centre of rotation, in the world
    up: Float64  # (3,), unit vector in the world
    low: Float64  # (3,), corner of a box around most of the scene, in the world
    high: Float64


def standpoint(things: Any, camera: Camera | None = None, up: ArrayLike | None = None) -> Standpoint:
    """Choose a viewpoint to start from.

    Parameters
    ----------
    things : thing or sequence of things
    camera : Camera, optional
        By default the camera of the first perspective depth image, or one that sees the whole scene.
    up : (3,), optional
        By default the up direction of the depth images, or -y.

    Raises
    ------
    ArgumentError
        If `up` is not a direction, or the things have no extent.
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
    """Half the diagonal of a box; raises ArgumentError if it is zero or not finite."""
    radius = 0.5 * float(np.linalg.norm(high - low))
    if not (np.isfinite(radius) and radius > 0):
        raise ArgumentError("things", "things of some extent", f"a box from {low} to {high}")
    return radius


def _bounds_of(things: Sequence[Any]) -> tuple[Float64, Float64]:
    """Box around most of the scene, (low, high) in the world."""
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
    """Estimate the up direction: the sum of the cameras' up axes, or -y if they cancel."""
    total = np.sum([-one.camera.world_from_camera[:3, 1] for one in sources], axis=0) if sources else _DOWN
    return total if np.linalg.norm(total) > 0.1 * max(len(sources), 1) else _DOWN
