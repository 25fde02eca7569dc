"""Writers for cameras of several images: JSON for pyibr, Open3D or NeRF programs, or a COLMAP model as text."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any, Literal

import numpy as np

from pyibr.core.camera import Camera
from pyibr.core.camera_json import write_json
from pyibr.core.checks import instance_of, one_of
from pyibr.core.conventions import CV_FROM_GL
from pyibr.core.errors import ArgumentError
from pyibr.core.files import checked_path, write_atomically, written_together

CameraForm = Literal["pyibr", "colmap", "open3d", "nerfstudio"]

_COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3", "k4")


def write_cameras(path: str | PathLike[str], cameras: Mapping[str, Camera], form: CameraForm = "pyibr") -> None:
    """Write cameras in a form that `read_cameras` and other programs read.

    Parameters
    ----------
    path : path
        A JSON file, or the folder of a COLMAP model.
    cameras : mapping of str to Camera
        Cameras by image name. COLMAP's and NeRF's files store the names; the others store a list, or a single camera.
    form : {"pyibr", "colmap", "open3d", "nerfstudio"}
        JSON as in `Camera.save`; COLMAP's cameras.txt, images.txt and points3D.txt; Open3D's
        PinholeCameraParameters or PinholeCameraTrajectory; transforms.json.

    Raises
    ------
    ArgumentError
        If there is no camera, or the form cannot store one: an orthographic camera, or its lens.

    Examples
    --------
    >>> import pyibr as ibr
    >>> from pyibr.io import read_cameras, write_cameras
    >>> camera = ibr.Camera([[500, 0, 319.5], [0, 500, 239.5], [0, 0, 1]], (640, 480))
    >>> write_cameras("model", {"a.png": camera, "b.png": camera.moved(0.1, 0, 0)}, "colmap")
    >>> [camera.center.tolist() for camera in read_cameras("model").values()]
    [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]]
    """
    place = checked_path(path)
    one_of("form", form, CameraForm)
    if not cameras:
        raise ArgumentError("cameras", "one or more", "none")
    known = [instance_of("cameras", camera, Camera, "cameras by name") for camera in cameras.values()]
    if form == "colmap":
        _write_model(place, cameras)
    elif form == "nerfstudio":
        frames = [{"file_path": name, **nerf_frame(camera)} for name, camera in cameras.items()]
        write_json(place, {"camera_model": frames[0]["camera_model"], "frames": frames})
    elif form == "open3d":
        listed = [_open3d(camera) for camera in known]
        trajectory = {"class_name": "PinholeCameraTrajectory", "version_major": 1, "version_minor": 0}
        write_json(place, listed[0] if len(listed) == 1 else {**trajectory, "parameters": listed})
    else:
        write_json(place, known[0].to_json() if len(known) == 1 else [camera.to_json() for camera in known])


def nerf_frame(camera: Camera) -> dict[str, Any]:
    """A camera as a frame of transforms.json; ArgumentError if the format cannot store it."""
    model, params, _, _ = camera.to_colmap()
    values = [*params[4:].tolist(), *[0.0] * 8][:8]
    if model == "FULL_OPENCV" and any(values[5:]):
        raise ArgumentError("camera", "a lens with k1, k2, p1, p2 and k3 only", str(camera.lens))
    if model == "OPENCV_FISHEYE":
        values = [values[0], values[1], 0.0, 0.0, values[2], values[3]]
    fx, fy, cx, cy = params[:4].tolist()
    intrinsics = {"w": camera.width, "h": camera.height, "fl_x": fx, "fl_y": fy, "cx": cx, "cy": cy}
    name = "OPENCV_FISHEYE" if model == "OPENCV_FISHEYE" else "OPENCV"
    pose = (camera.world_from_camera @ CV_FROM_GL).tolist()
    told = {"camera_model": name, **intrinsics, **dict(zip(_COEFFICIENTS, values, strict=False))}
    return {**told, "transform_matrix": pose}


def _write_model(folder: Path, cameras: Mapping[str, Camera]) -> None:
    """Write a COLMAP model without points; cameras of equal intrinsics are stored once."""
    numbers, images = dict[str, int](), list[str]()
    for number, (name, camera) in enumerate(cameras.items(), 1):
        model, params, qvec, tvec = camera.to_colmap()
        intrinsics = f"{model} {camera.width} {camera.height} {_words(params)}"
        own = numbers.setdefault(intrinsics, len(numbers) + 1)
        images.append(f"{number} {_words(qvec)} {_words(tvec)} {own} {name}\n\n")
    lines = [f"{number} {intrinsics}\n" for intrinsics, number in numbers.items()]
    with written_together():
        write_atomically(folder / "points3D.txt", b"# none\n")
        write_atomically(folder / "images.txt", "".join(images).encode())
        write_atomically(folder / "cameras.txt", "".join(lines).encode())


def _words(values: np.ndarray[Any, Any]) -> str:
    return " ".join(map(repr, values.tolist()))


def _open3d(camera: Camera) -> dict[str, Any]:
    """Open3D's PinholeCameraParameters, with matrices in column order."""
    if camera.projection != "perspective" or camera.lens is not None:
        raise ArgumentError("cameras", "perspective cameras without a lens for Open3D", str(camera))
    intrinsic = {"width": camera.width, "height": camera.height, "intrinsic_matrix": camera.K.T.ravel().tolist()}
    return {
        "class_name": "PinholeCameraParameters",
        "version_major": 1,
        "version_minor": 0,
        "extrinsic": camera.camera_from_world.T.ravel().tolist(),
        "intrinsic": intrinsic,
    }
