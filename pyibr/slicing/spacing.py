"""Spacing of slices: a fixed number of slices, or the number that a picture needs."""

from __future__ import annotations

import math
from typing import Literal

from pyibr.core.camera import Camera
from pyibr.core.checks import Float64, describe, integer_from, one_of
from pyibr.core.errors import ArgumentError
from pyibr.opencl.headers import constant

Slices = int | Literal["view"]

SLICES_MAX = 65536
SLICES_USUAL = 128  # slices for checking depths before a picture chooses their number

_RAYS = "slicing/rays.h"


def checked_slices(slices: Slices) -> Slices:
    """Return a number of slices, or "view", or raise ArgumentError."""
    if isinstance(slices, str):
        one_of("slices", slices, Literal["view"], also=f" or a whole number from 1 to {SLICES_MAX}")
        return slices
    return integer_from("slices", slices, 1, SLICES_MAX, f'a whole number from 1 to {SLICES_MAX}, or "view"')


def slices_text(slices: Slices) -> str:
    """Text for the `repr` of a surface or solid."""
    return "slices by view" if slices == "view" else f"{slices} slices"


def checked_halvings(halvings: int) -> int:
    """Return the number of halvings between two slices or raise ArgumentError."""
    return integer_from("halvings", halvings, 0, int(constant(_RAYS, "HALVINGS_MAX")))


def checked_only(only: int | None, slices: Slices) -> int | None:
    """Return the number of the only slice, or None for all, or raise ArgumentError."""
    if only is None:
        return None
    if slices == "view":
        raise ArgumentError("only", 'None with slices="view", whose slices have no numbers', describe(only))
    return integer_from("only", only, -SLICES_MAX, SLICES_MAX)


def spacing_min(extent: float) -> float:
    """Least spacing of slices, in scene units, that a picture chooses for an object of this extent."""
    return extent / constant(_RAYS, "SLICES_MAX")


def nearest_pixel(camera: Camera, corners: Float64) -> float:
    """Size of a pixel, in scene units, at the nearest of the points (n, 3); 0 if a point is not in front."""
    z = camera.camera_from_world[2, :3] @ corners.T + camera.camera_from_world[2, 3]
    nearest = max(float(z.min()), 0.0) if camera.projection == "perspective" else 1.0
    return nearest / float(min(camera.K[0, 0], camera.K[1, 1]))


def halvings_between(spacing: float, pixel: float) -> int:
    """Number of halvings of the interval between slices that locate the surface to a fraction of a pixel."""
    parts = constant(_RAYS, "PIXEL_PARTS") * spacing / max(pixel, 1e-30)
    return min(math.ceil(math.log2(max(parts, 1.0))), int(constant(_RAYS, "HALVINGS_MAX")))
