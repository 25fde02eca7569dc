"""Camera files: JSON with width, height, K (or fx, fy, cx, cy), world_from_camera, projection and lens; or Open3D's.

Open3D's are its PinholeCameraIntrinsic, PinholeCameraParameters and PinholeCameraTrajectory.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from os import PathLike
from typing import Any, cast

from pyibr.core.checks import Float64, checked_pose, numbers
from pyibr.core.conventions import pose_from_extrinsics
from pyibr.core.errors import FileFormatError
from pyibr.core.files import read_text, reading, write_atomically
from pyibr.core.lens import Lens

_PARTS = ("fx", "fy", "cx", "cy")
_LENS_KEYS = ("model", "coefficients", "radius")
_FOREIGN = ("distortion_model", "camera_model", "ppx", "depth_scale", "k1", "frames")
_MATRIX, _INTRINSIC, _EXTRINSIC, _CAMERAS = "intrinsic_matrix", "intrinsic", "extrinsic", "parameters"  # Open3D's
_KEYS = ("width", "height", "K", *_PARTS, "world_from_camera", "projection", "lens")


def write_json(path: str | PathLike[str], data: object) -> None:
    """Write a whole JSON file, or leave the old file."""
    write_atomically(path, (json.dumps(data, indent=1) + "\n").encode("utf-8"))


def read_json(path: str | PathLike[str], kind: str) -> object:
    """Return a JSON file's content, or raise FileFormatError; `kind` names the expected content in the message."""
    with reading(path, kind) as source:
        return json.loads(read_text(source))


def is_own(entries: dict[str, Any]) -> bool:
    """Tell whether a JSON object has the form of `Camera.save` or Open3D, valid or not."""
    if is_open3d(entries):
        return True
    is_whole = {"width", "height"} <= entries.keys() and not entries.keys().isdisjoint(("K", *_PARTS))
    return is_whole and entries.keys().isdisjoint(_FOREIGN)


def camera_arguments(data: object, path: str | PathLike[str]) -> dict[str, Any]:
    """Return the arguments of `Camera` in a JSON object, unchecked; `path` is for messages."""
    if not isinstance(data, dict):
        raise FileFormatError(f"{path}: expected a JSON object, got {type(data).__name__}")
    entries = cast("dict[str, Any]", data)
    if is_open3d(entries):
        mixed = sorted(entries.keys() & set(_KEYS[2:]))
        if mixed:
            raise FileFormatError(f"{path}: has {mixed[0]!r}, which Open3D's cameras lack")
        return _open3d_arguments(entries, path)
    if "K" in entries and not entries.keys().isdisjoint(_PARTS):
        raise FileFormatError(f"{path}: has both K and {', '.join(_PARTS)}")
    _check_keys(entries, _KEYS, ("width", "height", *(("K",) if "K" in entries else _PARTS)), f"{path}:", "a camera")
    if "K" in entries:
        intrinsics = entries["K"]
    else:
        fx, fy, cx, cy = (entries[key] for key in _PARTS)
        intrinsics = [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]
    return {
        "K": intrinsics,
        "size": (entries["width"], entries["height"]),
        "world_from_camera": entries.get("world_from_camera"),
        "projection": entries.get("projection", "perspective"),
        "lens": _read_lens(path, entries.get("lens")),
    }


def _read_lens(path: str | PathLike[str], entry: object) -> Lens | None:
    if entry is None:
        return None
    if not isinstance(entry, dict):
        raise FileFormatError(f"{path}: expected a lens with {', '.join(_LENS_KEYS)}, got {type(entry).__name__}")
    parts = cast("dict[str, Any]", entry)
    _check_keys(parts, _LENS_KEYS, _LENS_KEYS[:2], f"{path}: its lens", "a lens")
    return Lens(**parts)


def _check_keys(entries: dict[str, Any], known: Sequence[str], needed: Sequence[str], place: str, kind: str) -> None:
    """Raise FileFormatError if an object has unknown keys, or lacks needed ones."""
    unknown = sorted(entries.keys() - set(known))
    if unknown:
        raise FileFormatError(f"{place} unknown key {unknown[0]!r} ({kind} has {', '.join(known)})")
    missing = [key for key in needed if key not in entries]
    if missing:
        raise FileFormatError(f"{place} has no {', '.join(missing)}")


def is_open3d(entries: dict[str, Any]) -> bool:
    """Tell whether a JSON object is a camera file of Open3D's."""
    return not entries.keys().isdisjoint((_MATRIX, _INTRINSIC, "class_name"))


def _open3d_arguments(entries: dict[str, Any], path: str | PathLike[str]) -> dict[str, Any]:
    """Return the arguments of `Camera` from Open3D's object of one camera.

    Matrices are lists of numbers in column order. An extrinsic leads from the world to the camera; axes and pixel
    centres are pyibr's. Other entries, as in the `intrinsic.json` of Open3D's recordings, do not describe the camera.
    """
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
    K, pose = numbers(_MATRIX, known[_MATRIX], (9,)).reshape(3, 3).T, None
    if _EXTRINSIC in entries:
        columns = numbers(_EXTRINSIC, entries[_EXTRINSIC], (16,)).reshape(4, 4)
        camera_from_world = checked_pose(columns.T, _EXTRINSIC)
        pose = pose_from_extrinsics(camera_from_world[:3, :3], camera_from_world[:3, 3])
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


def camera_entries(
    K: Float64, size: tuple[int, int], world_from_camera: Float64, projection: str, lens: Lens | None
) -> dict[str, Any]:
    """Return a camera as a JSON object; `camera_arguments` restores it bit for bit."""
    data: dict[str, Any] = {
        "width": size[0],
        "height": size[1],
        "K": K.tolist(),
        "world_from_camera": world_from_camera.tolist(),
        "projection": projection,
    }
    if lens is not None:
        radius = {"radius": lens.radius} if lens.radius < math.inf else {}
        data["lens"] = {"model": lens.model, "coefficients": lens.coefficients, **radius}
    return data
