"""Pictures that exceed the device's memory: drawn one after the other, and large ones in bands of rows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera
from pyibr.core.errors import OutOfMemoryError
from pyibr.images.frame import Frame
from pyibr.opencl.device import Session

_PIXELS_MIN = 1 << 20  # least pixels per band: if such a band does not fit, the things take the memory, not the picture

_WRITTEN = ("color", "depth", "valid", "features")  # arrays of `out` frames

Begin = Callable[[Camera, Frame | None], Callable[[], Frame]]
"""Begins to draw a picture, into a frame's arrays if given. After a wait, the returned function returns the frame."""


def frames_in_memory(
    session: Session,
    cameras: Sequence[Camera],
    outs: Sequence[Frame | None],
    begin: Callable[[], Begin],
    in_bands: bool = True,
) -> list[Frame]:
    """Draw pictures for several cameras: together if they fit in memory, otherwise one by one.

    A picture that does not fit is halved into bands of rows until the bands fit, unless `in_bands` is False. `begin`
    is called once for each group of pictures that are drawn together.
    """

    def at_once() -> list[Frame]:
        one = begin()
        begun = [one(camera, out) for camera, out in zip(cameras, outs, strict=True)]
        session.wait()
        return [finished() for finished in begun]

    def alone(camera: Camera, out: Frame | None) -> Frame:
        return frames_in_memory(session, [camera], [out], begin, in_bands)[0]

    try:
        return at_once()
    except OutOfMemoryError:
        width, height = cameras[0].size
        if len(cameras) == 1 and not (in_bands and height > 1 and width * height >= 2 * _PIXELS_MIN):
            raise
        session.wait()  # commands in flight keep their memory
    if len(cameras) > 1:
        return [alone(camera, out) for camera, out in zip(cameras, outs, strict=True)]
    (camera,), (out,) = cameras, outs
    told: dict[str, Any] = {} if out is None else {name: getattr(out, name) for name in _WRITTEN}
    told = {name: array for name, array in told.items() if array is not None}
    for rows in (slice(height // 2), slice(height // 2, height)):
        band = _rows_of(camera, rows)
        own = None if out is None else Frame(camera=band, **{name: array[rows] for name, array in told.items()})
        _put(alone(band, own), told, rows, height)  # copied, so that the band's memory is free for the next
    return [Frame(camera=camera, **told)]


def _rows_of(camera: Camera, rows: slice) -> Camera:
    top, bottom, _ = rows.indices(camera.height)
    K = camera.K - [[0, 0, 0], [0, 0, top], [0, 0, 0]]
    size = camera.width, bottom - top
    return Camera(K, size, camera.world_from_camera, projection=camera.projection, lens=camera.lens)


def _put(frame: Frame, told: dict[str, Any], rows: slice, height: int) -> None:
    """Copy a band's arrays into the rows of the whole picture's arrays."""
    arrays: dict[str, NDArray[Any]] = {name: each for name, each in vars(frame).items() if isinstance(each, np.ndarray)}
    for name, values in arrays.items():
        told.setdefault(name, np.zeros((height, *values.shape[1:]), values.dtype))[rows] = values
