"""Frames of equal bits, pixels of a warp with a wrong depth, and pixels where rounding decides which depth is right."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera
from pyibr.images import Frame
from tests.scenes import moved_aside

Array = NDArray[Any]

OFF = 0.01  # relative: with a larger depth error, a pixel shows another place of the surface
# Largest error of a stored depth, in units of its last place (ulp). Stored nearness is wrong by up to 4 ulp, since its
# last bits hold edges. That is up to 8 ulp of depth, and two inversions add 2.
KEPT_ULP = 10
HAIR = 0.002  # target pixels: kernels treat a ray that passes a sample within half of this as a ray through it


def same_bits(a: Frame, b: Frame) -> None:
    """Assert that two frames show the same pixels, with the same bits of depth, colour and alpha."""
    np.testing.assert_array_equal(a.valid, b.valid)
    np.testing.assert_array_equal(a.depth.view(np.uint32), b.depth.view(np.uint32))
    np.testing.assert_array_equal(a.color, b.color)
    np.testing.assert_array_equal(a.alpha, b.alpha)


def off(found: Array, expected: Array) -> Array:
    """(H, W) bool: pixels where the depths differ by more than `OFF`, or where just one is a hole, nan."""
    with np.errstate(invalid="ignore"):
        return (np.isfinite(found) != np.isfinite(expected)) | (np.abs(found / expected - 1) > OFF)


def ties(depth_seen_by: Callable[[Camera], Array], camera: Camera) -> Array:
    """(H, W) bool: pixels whose depth changes if the ray moves by `HAIR`, since it passes an end of the surface."""
    here = depth_seen_by(camera)
    beside = (moved_aside(camera, x, y) for x, y in ((HAIR, 0), (-HAIR, 0), (0, HAIR), (0, -HAIR)))
    return np.any([off(depth_seen_by(other), here) for other in beside], axis=0)


def slivers(depth_seen_by: Callable[[Camera], Array], camera: Camera) -> Array:
    """(H, W) bool: pixels that show a part less than a pixel wide: half a pixel to either side, the depth differs."""
    here = depth_seen_by(camera)
    a, b = 0.5, 0.5 / np.sqrt(2)
    found = np.zeros(here.shape, bool)
    for x, y in ((a, 0), (0, a), (b, b), (b, -b)):
        sides = [off(depth_seen_by(moved_aside(camera, s * x, s * y)), here) for s in (1, -1)]
        found |= sides[0] & sides[1]
    return found
