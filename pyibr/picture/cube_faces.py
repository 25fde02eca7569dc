"""Pictures of cameras with lenses: drawn by one or several pinhole cameras, then resampled along the pixels' rays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pyibr.core.camera import Camera
from pyibr.core.pixelspace import pitch
from pyibr.core.undistortion import cube_faces
from pyibr.images.frame import Frame, PixelClass
from pyibr.opencl.device import current
from pyibr.opencl.launch import launch
from pyibr.opencl.memory import empty
from pyibr.opencl.program import kernel
from pyibr.picture.target import Target
from pyibr.picture.undistort import positions_on_device


def cube_face_cameras(camera: Camera) -> list[Camera]:
    """Return the pinhole cameras whose targets `joined_faces` takes; the camera itself if it has no lens."""
    if camera.lens is None:
        return [camera]
    world = camera.world_from_camera
    return [
        Camera(face.camera.K, face.camera.size, world @ face.camera.world_from_camera) for face in cube_faces(camera)
    ]


def joined_faces(targets: Sequence[Target], camera: Camera, out: Frame | None = None) -> Target:
    """Return a camera's picture from the targets of its `cube_face_cameras`; `out`: a frame that is overwritten."""
    if camera.lens is None:
        return targets[0]
    like = targets[0].color
    profile = current().profile
    origins, classes = targets[0].source is not None, targets[0].classes is not None
    whole = Target(camera, like.dtype, out=out, channels=like.shape[2], origins=origins, classes=classes)
    whole.filled = any(target.filled for target in targets)
    guesses = any(target.guesses is not None for target in targets)
    defines = {"ORIGINS": int(whole.source is not None), "CLASSES": int(whole.classes is not None)}
    blended = targets[0].alpha is not None
    if blended:
        whole.alpha = empty(whole.depth.shape, np.float32)
    defines |= {"GUESSES": int(guesses), "ALPHA": int(blended)}
    for number, (face, target) in enumerate(zip(cube_faces(camera), targets, strict=True)):
        told: dict[str, Any] = {**whole.origins, **{f"face_{name}": array for name, array in target.origins.items()}}
        if whole.classes is not None:
            told |= {"face_classes": target.classes, "classes": whole.classes, "unseen": int(PixelClass.OUTSIDE)}
        if guesses:
            told |= {"face_guesses": target.made_guesses(), "guesses": whole.made_guesses()}
        if blended:
            told |= {"face_alpha": target.alpha, "alpha": whole.alpha}
        launch(
            kernel("picture/cube_faces.cl", "join_faces", **defines, **target.color_defines),
            profile.packets(*camera.size, profile.strip),
            places=positions_on_device(face),
            face_depth=target.depth,
            face_color=target.color,
            face_valid=target.valid,
            face_width=target.camera.width,
            face_height=target.camera.height,
            width=camera.width,
            height=camera.height,
            pitch=pitch(camera.width),
            first=number == 0,
            linear=all(target.mixable for target in targets),
            filled=int(whole.filled),
            **target.background_arguments,
            **whole.outputs(),
            **told,
        )
    whole.blank = False
    return whole
