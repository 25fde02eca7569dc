"""Antialiasing: a picture is drawn with several samples per pixel and averaged."""

from __future__ import annotations

import numpy as np

from pyibr.core.camera import Camera
from pyibr.core.checks import check_pixels, integer_from
from pyibr.core.errors import ArgumentError
from pyibr.images.frame import Frame
from pyibr.opencl.device import current
from pyibr.opencl.launch import launch
from pyibr.opencl.memory import DeviceArray, empty
from pyibr.opencl.program import kernel
from pyibr.picture.target import Target

_SIDES = {side * side: side for side in range(1, 9)}


def checked_side(samples: int) -> int:
    """Return the number of samples along each side of a pixel, or raise ArgumentError.

    Raises
    ------
    ArgumentError
        If `samples` is not a square number from 1 to 64.
    """
    if samples.__class__ is int and samples in _SIDES:
        return _SIDES[samples]
    expected = f"{', '.join(map(str, _SIDES))} samples per pixel"
    count = integer_from("samples", samples, 1, max(_SIDES), expected)
    if count not in _SIDES:
        raise ArgumentError("samples", expected, str(count))
    return _SIDES[count]


def finer(camera: Camera, side: int) -> Camera:
    """Return a camera of size (side * width, side * height), whose pixels are the given camera's samples.

    Raises
    ------
    ArgumentError
        If the finer picture has too many pixels.
    """
    if side == 1:
        return camera
    size = side * camera.width, side * camera.height
    check_pixels("samples", size)
    return camera.resized(size)


def averaged(fine: Target, camera: Camera, side: int, out: Frame | None = None) -> Target:
    """Return a camera's picture from the picture of its `finer` camera; `out`: a frame whose arrays are written."""
    if side == 1:
        return fine
    target = Target(camera, fine.color.dtype, out=out, channels=fine.color.shape[-1])
    target.alpha = empty((camera.height, camera.width), np.float32)
    told: dict[str, DeviceArray] = {}
    if fine.guesses is not None:
        target.guesses = empty(target.depth.shape, np.float32)
        told = {"sample_guesses": fine.guesses, "guesses": target.guesses}
    profile = current().profile
    launch(
        kernel("picture/average.cl", "average", GUESSES=int(bool(told)), **fine.color_defines),
        profile.packets(*camera.size, profile.strip),
        sample_depth=fine.depth,
        sample_color=fine.color,
        sample_valid=fine.valid,
        side=side,
        width=camera.width,
        height=camera.height,
        perspective=camera.projection == "perspective",
        **target.outputs(),
        alpha=target.alpha,
        **told,
    )
    target.blank, target.filled = False, fine.filled
    return target
