"""Pictures of cameras with lenses, and with several samples per pixel: drawn in parts, then joined and averaged.

Drawing code sees neither lenses nor samples: its targets have pinhole cameras, and their pixels are the samples.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from pyibr.core.camera import Camera
from pyibr.core.checks import check_pixels, integer_from
from pyibr.core.errors import ArgumentError
from pyibr.images.frame import Frame
from pyibr.opencl.device import current
from pyibr.opencl.launch import launch
from pyibr.opencl.memory import DeviceArray, empty
from pyibr.opencl.memory_pool import telling_shortage
from pyibr.opencl.program import kernel
from pyibr.picture.cube_faces import cube_face_cameras, joined_faces
from pyibr.picture.target import Target

_SIDES = {side * side: side for side in range(1, 9)}  # samples along each side, by the number of samples in a pixel


class PictureParts:
    """The pinhole pictures that make up a camera's picture.

    Parameters
    ----------
    camera : Camera
        With or without a lens.
    samples : int
        Samples per pixel.

    Raises
    ------
    ArgumentError
        If `samples` is not a square number from 1 to 64, or a part has too many pixels.
    OutOfMemoryError
        If the rays of a lens do not fit in the machine's memory.
    """

    def __init__(self, camera: Camera, samples: int) -> None:
        self._camera, self._side = camera, _checked_side(samples)
        check_pixels("camera", camera.size)
        self._fine = camera
        if self._side > 1:  # a camera whose pixels are the samples
            size = self._side * camera.width, self._side * camera.height
            check_pixels("samples", size)
            self._fine = camera.resized(size)
        with telling_shortage("this machine"):
            self._cameras = cube_face_cameras(self._fine)
        for part in self._cameras:
            check_pixels("camera", part.size)

    def drawn(self, draw: Callable[[Target], None], *, out: Frame | None = None, **kind: Any) -> Target:
        """Draw each part by a call of `draw`, and combine the parts to the camera's picture.

        out: a frame whose arrays are written, instead of new ones. kind: further arguments of `Target`.
        """
        whole = out if self._side == 1 else None
        own = whole if self._fine.lens is None else None
        parts: list[Target] = []
        for camera in self._cameras:
            parts.append(Target(camera, out=own, side=self._side, **kind))
            draw(parts[-1])
        joined = joined_faces(parts, self._fine, whole)
        return joined if self._side == 1 else _averaged(joined, self._camera, self._side, out)


def _checked_side(samples: int) -> int:
    """Return the number of samples along each side of a pixel, or raise ArgumentError."""
    if samples.__class__ is int and samples in _SIDES:
        return _SIDES[samples]
    expected = f"{', '.join(map(str, _SIDES))} samples per pixel"
    count = integer_from("samples", samples, 1, max(_SIDES), expected)
    if count not in _SIDES:
        raise ArgumentError("samples", expected, str(count))
    return _SIDES[count]


def _averaged(fine: Target, camera: Camera, side: int, out: Frame | None) -> Target:
    """Return the camera's picture: each pixel is averaged from its `side` x `side` samples in the picture `fine`."""
    target = Target(camera, fine.color.dtype, out=out, channels=fine.color.shape[-1])
    target.alpha = empty((camera.height, camera.width), np.float32)
    told: dict[str, DeviceArray] = {}
    if fine.guesses is not None:
        target.guesses = empty(target.depth.shape, np.float32)
        told = {"sample_guesses": fine.guesses, "guesses": target.guesses}
    defines = {"GUESSES": int(bool(told)), "ALPHA": int(fine.alpha is not None)}
    if fine.alpha is not None:
        told["sample_alpha"] = fine.alpha
    profile = current().profile
    launch(
        kernel("picture/average.cl", "average", **defines, **fine.color_defines),
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
