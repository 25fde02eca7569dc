"""Pixels of a warp that are off, and those of them that no rounding can decide."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera

Array = NDArray[Any]

OFF = 0.01  # relative: a depth that is farther off is of another place of the surface
KEPT_ULP = 10
"""By which a depth comes back: nearness is kept within 4 ulp (its last bits tell edges), up to 8 of depth, and inverted
twice."""
HAIR = 0.002  # pixels of the target: twice of what the kernels take for a ray that runs along samples


def off(found: Array, expected: Array) -> Array:
    """(H, W) bool: where depths, nan in holes, are of other places of the surface, or one of them is a hole."""
    with np.errstate(invalid="ignore"):
        return (np.isfinite(found) != np.isfinite(expected)) | (np.abs(found / expected - 1) > OFF)


def with_center_moved(camera: Camera, x: float, y: float) -> Camera:
    """The camera, but its principal point is so many pixels to the right and below."""
    K = np.add(camera.K, [[0, 0, x], [0, 0, y], [0, 0, 0]])
    return Camera(K, camera.size, camera.world_from_camera, projection=camera.projection)


def ties(depth_seen_by: Callable[[Camera], Array], camera: Camera) -> Array:
    """(H, W) bool: rays that pass an end of the surface so closely that a hair beside it all changes."""
    here = depth_seen_by(camera)
    beside = (with_center_moved(camera, x, y) for x, y in ((HAIR, 0), (-HAIR, 0), (0, HAIR), (0, -HAIR)))
    return np.any([off(depth_seen_by(other), here) for other in beside], axis=0)


def slivers(depth_seen_by: Callable[[Camera], Array], camera: Camera) -> Array:
    """(H, W) bool: rays that see something less than a pixel wide: half a pixel to either side is something else."""
    here = depth_seen_by(camera)
    a, b = 0.5, 0.5 / np.sqrt(2)
    found = np.zeros(here.shape, bool)
    for x, y in ((a, 0), (0, a), (b, b), (b, -b)):
        sides = [off(depth_seen_by(with_center_moved(camera, s * x, s * y)), here) for s in (1, -1)]
        found |= sides[0] & sides[1]
    return found
