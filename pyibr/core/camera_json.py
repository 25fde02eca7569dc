"""Camera files: JSON with width, height, K (or fx, fy, cx, cy), world_from_camera, projection and lens; or Open3D's."""

from __future__ import annotations

import json
import math
from os import PathLike
from typing import Any, cast

from pyibr.core.checks import Float64
from pyibr.core.errors import ArgumentError, FileFormatError
from pyibr.core.files import read_text, reading, write_atomically
from pyibr.core.lens import Lens
from pyibr.core.open3d_json import is_open3d, open3d_arguments

_PARTS = ("fx", "fy", "cx", "cy")
_LENS_KEYS = ("model", "coefficients", "radius")
_FOREIGN = ("distortion_model", "camera_model", "ppx", "depth_scale", "k1", "frames")
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
        return open3d_arguments(entries, path)
    unknown = sorted(entries.keys() - set(_KEYS))
    if unknown:
        raise FileFormatError(f"{path}: unknown key {unknown[0]!r} (a camera has {', '.join(_KEYS)})")
    if "K" in entries and not entries.keys().isdisjoint(_PARTS):
        raise FileFormatError(f"{path}: has both K and {', '.join(_PARTS)}")
    missing = [key for key in ("width", "height") if key not in entries]
    missing += [] if "K" in entries else [key for key in _PARTS if key not in entries]
    if missing:
        raise FileFormatError(f"{path}: has no {', '.join(missing)}")
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
    unknown = sorted(parts.keys() - set(_LENS_KEYS))
    if unknown:
        raise FileFormatError(f"{path}: unknown key {unknown[0]!r} (a lens has {', '.join(_LENS_KEYS)})")
    missing = [key for key in _LENS_KEYS[:2] if key not in parts]
    if missing:
        raise FileFormatError(f"{path}: its lens has no {', '.join(missing)}")
    try:
        return Lens(**parts)
    except ArgumentError as error:
        raise FileFormatError(f"{path}: {error}") from error


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
