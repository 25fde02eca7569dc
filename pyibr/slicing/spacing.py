"""Spacing of slices: a number of them that is given, or as many as a picture needs."""

from __future__ import annotations

import math
from typing import Literal

from pyibr.core.camera import Camera
from pyibr.core.checks import Float64, describe, integer_from, one_of
from pyibr.core.errors import ArgumentError
from pyibr.opencl.headers import constant

Slices = int | Literal["view"]

SLICES_MAX = 65536
SLICES_USUAL = 128  # that tell depths apart before there is a picture

_RAYS = "slicing/rays.h"


def checked_slices(slices: Slices) -> Slices:
    """Return a number of slices, or "view", or raise ArgumentError."""
    if isinstance(slices, str):
        one_of("slices", slices, Literal["view"], also=f" or a whole number from 1 to {SLICES_MAX}")
        return slices
    return integer_from("slices", slices, 1, SLICES_MAX, f'a whole number from 1 to {SLICES_MAX}, or "view"')


def slices_text(slices: Slices) -> str:
    """For a thing's description."""
    return "slices by view" if slices == "view" else f"{slices} slices"


def checked_halvings(halvings: int) -> int:
    """Return how often the way between two slices is halved or raise ArgumentError."""
    return integer_from("halvings", halvings, 0, int(constant(_RAYS, "HALVINGS_MAX")))


def checked_only(only: int | None, slices: Slices) -> int | None:
    """Return the number of the only slice, or None for all, or raise ArgumentError."""
    if only is None:
        return None
    if slices == "view":
        raise ArgumentError("only", 'None with slices="view", which has no numbers', describe(only))
    return integer_from("only", only, -SLICES_MAX, SLICES_MAX)


def spacing_min(extent: float) -> float:
    """Scene units between slices, over a thing of this extent, that no picture goes below by itself."""
    return extent / constant(_RAYS, "SLICES_MAX")


def nearest_pixel(camera: Camera, corners: Float64) -> float:
    """Scene units that a pixel takes at the nearest of some points, (n, 3); 0 where the camera is among them."""
    z = camera.camera_from_world[2, :3] @ corners.T + camera.camera_from_world[2, 3]
    nearest = max(float(z.min()), 0.0) if camera.projection == "perspective" else 1.0
    return nearest / float(min(camera.K[0, 0], camera.K[1, 1]))


def halvings_between(spacing: float, pixel: float) -> int:
    """Halvings of the step between two slices that meet the surface within a small part of a pixel."""
    parts = constant(_RAYS, "PIXEL_PARTS") * spacing / max(pixel, 1e-30)
    return min(math.ceil(math.log2(max(parts, 1.0))), int(constant(_RAYS, "HALVINGS_MAX")))
