"""Pixels of a warp that are off, and pixels that rounding may decide either way."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera

Array = NDArray[Any]

OFF = 0.01  # relative: a depth farther off belongs to another place of the surface
KEPT_ULP = 10
"""Largest difference of a depth from its stored form.

Nearness is kept within 4 ulp (its last bits store edges), up to 8 of depth, and is inverted twice.
"""
HAIR = 0.002  # target pixels: twice the distance at which kernels take a ray to run along samples


def off(found: Array, expected: Array) -> Array:
    """(H, W) bool: where depths, nan in holes, belong to different places of the surface, or only one is a hole."""
    with np.errstate(invalid="ignore"):
        return (np.isfinite(found) != np.isfinite(expected)) | (np.abs(found / expected - 1) > OFF)


def with_center_moved(camera: Camera, x: float, y: float) -> Camera:
    """Return the camera with its principal point moved this many pixels to the right and down."""
    K = np.add(camera.K, [[0, 0, x], [0, 0, y], [0, 0, 0]])
    return Camera(K, camera.size, camera.world_from_camera, projection=camera.projection)


def ties(depth_seen_by: Callable[[Camera], Array], camera: Camera) -> Array:
    """(H, W) bool: rays so close to an end of the surface that a hair beside them the depth differs."""
    here = depth_seen_by(camera)
    beside = (with_center_moved(camera, x, y) for x, y in ((HAIR, 0), (-HAIR, 0), (0, HAIR), (0, -HAIR)))
    return np.any([off(depth_seen_by(other), here) for other in beside], axis=0)


def slivers(depth_seen_by: Callable[[Camera], Array], camera: Camera) -> Array:
    """(H, W) bool: rays that hit something less than a pixel wide: half a pixel to either side, depths differ."""
    here = depth_seen_by(camera)
    a, b = 0.5, 0.5 / np.sqrt(2)
    found = np.zeros(here.shape, bool)
    for x, y in ((a, 0), (0, a), (b, b), (b, -b)):
        sides = [off(depth_seen_by(with_center_moved(camera, s * x, s * y)), here) for s in (1, -1)]
        found |= sides[0] & sides[1]
    return found
