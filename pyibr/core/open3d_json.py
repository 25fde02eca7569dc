"""Open3D's camera files: its PinholeCameraIntrinsic, PinholeCameraParameters and PinholeCameraTrajectory as JSON.

Matrices are lists of numbers in column order. An extrinsic leads from the world to the camera; axes and pixel centres
are pyibr's. Other entries, as in the `intrinsic.json` of Open3D's recordings, do not describe the camera.
"""

from __future__ import annotations

from os import PathLike
from typing import Any, cast

from pyibr.core.checks import checked_pose, numbers
from pyibr.core.conventions import pose_from_extrinsics
from pyibr.core.errors import ArgumentError, FileFormatError

_MATRIX, _INTRINSIC, _EXTRINSIC = "intrinsic_matrix", "intrinsic", "extrinsic"
_CAMERAS = "parameters"


def is_open3d(entries: dict[str, Any]) -> bool:
    """Tell whether a JSON object is a camera file of Open3D's."""
    return not entries.keys().isdisjoint((_MATRIX, _INTRINSIC, "class_name"))


def open3d_arguments(entries: dict[str, Any], path: str | PathLike[str]) -> dict[str, Any]:
    """Return the arguments of `Camera` from the object of one camera; `path` is for messages."""
    if _CAMERAS in entries or _is_shared(entries):
        raise FileFormatError(f"{path}: expected one camera, got Open3D's trajectory of several")
    intrinsic = entries if _MATRIX in entries else entries.get(_INTRINSIC)
    if not isinstance(intrinsic, dict):
        raise FileFormatError(f"{path}: has no {_MATRIX}, and no {_INTRINSIC} with one")
    known = cast("dict[str, Any]", intrinsic)
    missing = [key for key in ("width", "height", _MATRIX) if key not in known]
    missing += [_EXTRINSIC] if intrinsic is not entries and _EXTRINSIC not in entries else []
    if missing:
        raise FileFormatError(f"{path}: has no {', '.join(missing)}")
    try:
        K = numbers(_MATRIX, known[_MATRIX], (9,)).reshape(3, 3).T
        pose = None
        if _EXTRINSIC in entries:
            columns = numbers(_EXTRINSIC, entries[_EXTRINSIC], (16,)).reshape(4, 4)
            camera_from_world = checked_pose(columns.T, _EXTRINSIC)
            pose = pose_from_extrinsics(camera_from_world[:3, :3], camera_from_world[:3, 3])
    except ArgumentError as error:
        raise FileFormatError(f"{path}: {error}") from error
    return {"K": K, "size": (known["width"], known["height"]), "world_from_camera": pose}


def open3d_cameras(entries: dict[str, Any]) -> object:
    """Return a trajectory's cameras, one object each; None if it is no trajectory."""
    if _CAMERAS in entries:
        return entries[_CAMERAS]
    if _is_shared(entries):  # Open3D's first form: one intrinsic for all
        return [{_INTRINSIC: entries.get(_INTRINSIC), _EXTRINSIC: one} for one in entries[_EXTRINSIC]]
    return None


def _is_shared(entries: dict[str, Any]) -> bool:
    several = entries.get(_EXTRINSIC)
    return isinstance(several, list) and any(isinstance(one, list) for one in cast("list[object]", several))
