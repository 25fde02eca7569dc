"""The triangles that the rays of a camera's pixels meet (kernels/raster/rays.cl)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera
from pyibr.core.checks import Float64, check_pixels
from pyibr.core.undistortion import cube_faces
from pyibr.opencl.device import one_call
from pyibr.opencl.launch import launch
from pyibr.opencl.memory import empty, upload
from pyibr.opencl.program import kernel
from pyibr.picture.cube_faces import cube_face_cameras
from pyibr.picture.target import Target
from pyibr.raster.bins import bin_primitives

_NEAR = 1e-6  # nearest depth that counts, as a share of the depth of the farthest vertex
_BIN = 4  # pixels: a ray tests all triangles of its bin


def triangles_met(
    camera: Camera, vertices: Float64, faces: NDArray[np.int32], *, last: bool = False
) -> NDArray[np.int32]:
    """Return the first or last triangle that the ray of each pixel meets in front of the camera: (H * W,), -1 for none.

    Among equally distant triangles, the first wins. A ray that meets no triangle gets one that it misses by less than a
    thousandth of a pixel.
    """
    bent, rows_columns = camera.lens is not None, np.indices((camera.height, camera.width), np.float32)
    places = [face.places[:2] for face in cube_faces(camera)] if bent else [rows_columns[::-1]]
    with one_call():
        corners, met = upload(faces), empty((camera.width * camera.height,), np.int32)
        met.fill(-1)
        for pinhole, there in zip(cube_face_cameras(camera), places, strict=True):
            check_pixels("camera", pinhole.size, _BIN << 15)  # bins are numbered in 16 bits
            target = Target(pinhole, np.dtype(np.uint8), channels=0)
            # float64, since far from the world's origin sums lose digits. Depths up to 1 keep products in range.
            projected = vertices @ target.from_world[:, :3].T + target.from_world[:, 3]
            projected[:, :3] /= max(np.abs(projected[:, 2]).max(), 1e-300)
            on_device = upload(projected.astype(np.float32))
            bins = bin_primitives(target, corners, on_device, _NEAR, BIN=_BIN, BETWEEN=int(bent))
            launch(
                kernel("raster/rays.cl", "meet", BIN=_BIN),
                met.shape,
                faces=corners,
                places=upload(np.ascontiguousarray(there)),
                rays=met.shape[0],
                sense=-1 if last else 1,
                met=met,
                **bins.arguments,
            )
        return met.to_host()
