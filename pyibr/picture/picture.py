"""Pictures of cameras with lenses, and with several samples per pixel: drawn in parts, then joined and averaged.

Drawing code sees neither lenses nor samples: its targets have pinhole cameras, and their pixels are the samples.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from pyibr.core.camera import Camera
from pyibr.core.checks import check_pixels
from pyibr.images.frame import Frame
from pyibr.opencl.memory import DeviceArray
from pyibr.opencl.memory_pool import telling_shortage
from pyibr.picture.antialiasing import averaged, checked_side, finer
from pyibr.picture.cube_faces import cube_face_cameras, joined_faces
from pyibr.picture.target import Target


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
        If `samples` is not one of its choices, or a part has too many pixels.
    OutOfMemoryError
        If the rays of a lens do not fit in the machine's memory.
    """

    def __init__(self, camera: Camera, samples: int) -> None:
        self._camera, self._side = camera, checked_side(samples)
        check_pixels("camera", camera.size)
        self._fine = finer(camera, self._side)
        with telling_shortage("this machine"):
            self._cameras = cube_face_cameras(self._fine)
        for part in self._cameras:
            check_pixels("camera", part.size)

    def drawn(
        self,
        draw: Callable[[Target], None],
        dtype: np.dtype[Any],
        *,
        channels: int = 3,
        origins: bool = False,
        classes: bool = False,
        anisotropy: int = 1,
        out: Frame | None = None,
        pool: dict[tuple[int, int], DeviceArray] | None = None,
    ) -> Target:
        """Draw each part, and combine the parts to the camera's picture.

        Parameters
        ----------
        draw : callable
            Draws the scene into a target.
        dtype, channels, origins, classes, anisotropy, pool
            As in `Target`.
        out : Frame, optional
            Frame whose arrays are written, instead of new ones.
        """
        whole = out if self._side == 1 else None
        own = whole if self._fine.lens is None else None
        parts: list[Target] = []
        for camera in self._cameras:
            part = Target(
                camera,
                dtype,
                out=own,
                origins=origins,
                classes=classes,
                pool=pool,
                channels=channels,
                anisotropy=anisotropy,
            )
            draw(part)
            parts.append(part)
        return averaged(joined_faces(parts, self._fine, whole), self._camera, self._side, out)
