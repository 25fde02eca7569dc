"""Camera files: JSON with width, height, K (or fx, fy, cx, cy), world_from_camera and projection."""

from __future__ import annotations

import json
from os import PathLike
from typing import Any, cast

from pyibr.core.checks import Float64
from pyibr.core.errors import FileFormatError
from pyibr.core.files import atomic_path, reading

_PARTS = ("fx", "fy", "cx", "cy")
_KEYS = ("width", "height", "K", *_PARTS, "world_from_camera", "projection")


def read_camera_json(path: str | PathLike[str]) -> dict[str, Any]:
    """Return the arguments of `Camera` that a file holds, their values unchecked."""
    with reading(path, "camera JSON") as source:
        data: object = json.loads(source.read_text(encoding="utf-8"))
    if not isinstance(data, dict):
        raise FileFormatError(f"{path}: expected a JSON object, got {type(data).__name__}")
    entries = cast("dict[str, Any]", data)
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
    }


def write_camera_json(
    path: str | PathLike[str],
    K: Float64,
    size: tuple[int, int],
    world_from_camera: Float64,
    projection: str,
) -> None:
    """Write a camera; `read_camera_json` returns the same bits."""
    data = {
        "width": size[0],
        "height": size[1],
        "K": K.tolist(),
        "world_from_camera": world_from_camera.tolist(),
        "projection": projection,
    }
    with atomic_path(path) as temporary:
        temporary.write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
