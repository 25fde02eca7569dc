"""transforms.json of nerfstudio, instant-ngp and NeRF: OpenGL's axes, pixel centres at halves."""

from __future__ import annotations

import functools
import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np

from pyibr.core.calibrations import cameras_in, making
from pyibr.core.camera import Camera
from pyibr.core.camera_json import write_json
from pyibr.core.conventions import CV_FROM_GL
from pyibr.core.errors import ArgumentError, FileFormatError
from pyibr.images import DepthImage
from pyibr.io import image, write_color
from pyibr.io.camera_files import nerf_frame
from pyibr.io.layouts.parts import beside, object_in
from pyibr.io.poses import rigid_or_none
from pyibr.io.recordings import Recording, Stored, size_of

_log = logging.getLogger("pyibr")

_Entry = dict[str, Any]

_FILES = ("transforms.json", "transforms_train.json", "transforms_val.json", "transforms_test.json")
_DEPTH = ("depth_file_path", "depth_path")
_UNITS = ("integer_depth_scale", "depth_unit_scale_factor")  # scene units per stored unit, default 0.001
_SUFFIXES = ("", ".png", ".jpg", ".jpeg")


def find_transforms(folder: Path) -> Recording | None:
    """Find frames with file_path, depth_file_path (millimetres, or integer_depth_scale) and transform_matrix."""
    found = next((folder / name for name in _FILES if (folder / name).is_file()), None)
    if found is None:
        return None
    told = object_in(found)
    entries = _entries(found, told.pop("frames", None), told)
    with_depth = [(entry, name) for entry in entries for name in _DEPTH if name in entry]
    if not with_depth:
        return None
    if not all({*_UNITS} & entry.keys() or str(entry[name]).lower().endswith(".png") for entry, name in with_depth):
        _log.warning("%s: depth is read as millimetres, as in nerfstudio; for metres pass a depth scale of 1", found)
    colors = [_picture(folder, entry) for entry, _ in with_depth]
    depths = [_file(folder, entry[name]) for entry, name in with_depth]

    def cameras() -> list[Camera]:
        return [_camera(found, entry, color) for (entry, _), color in zip(with_depth, colors, strict=True)]

    return Recording(
        colors,
        depths,
        left_out=[_picture(folder, entry) for entry in entries if not any(name in entry for name in _DEPTH)],
        known=cameras,
        depth_cameras=lambda: beside(cameras(), depths[0]),
        placed=[_pose(entry.get("transform_matrix")) for entry, _ in with_depth],
        stored=[_stored(folder, entry) for entry, _ in with_depth],
    )


def _entries(path: Path, frames: object, common: _Entry) -> list[_Entry]:
    """The frames, each with the file's common entries added."""
    listed = cast("list[object]", frames) if isinstance(frames, list) else [None]
    if not all(isinstance(one, dict) for one in listed):
        raise FileFormatError(f"{path}: expected a list of frames")
    return [{**common, **cast("_Entry", one)} for one in listed]


def _picture(folder: Path, entry: _Entry) -> Path:
    """A frame's picture; NeRF's original files omit the suffix."""
    path = _file(folder, entry.get("file_path", ""))
    return next((file for suffix in _SUFFIXES if (file := path.with_name(path.name + suffix)).is_file()), path)


def _file(folder: Path, name: object) -> Path:
    """The file of a name; programs on Windows write backslashes."""
    return folder / str(name).replace("\\", "/")


def _pose(rows: object) -> Any:
    try:
        pose = np.vstack([np.array(rows, np.float64)[:3], [0, 0, 0, 1]])
    except (TypeError, ValueError, IndexError):
        return None
    exact = rigid_or_none(pose) if pose.shape == (4, 4) else None
    return None if exact is None else exact @ CV_FROM_GL


def _stored(folder: Path, entry: _Entry) -> Stored:
    unit = float(next((entry[name] for name in _UNITS if name in entry), 0.001))
    mask = _file(folder, entry["mask_path"]) if entry.get("mask_path") else None
    return Stored(1 / unit, confidence=None if mask is None else functools.partial(_mask, mask), least=1)


def _mask(path: Path) -> Any:
    values = image.read_color(path)
    return values if values.ndim == 2 else values[..., 0]


def _camera(file: Path, entry: _Entry, color: Path) -> Camera:
    """The camera of a frame, without its pose."""
    tree = {"frames": [entry | {"transform_matrix": np.eye(4).tolist()}]}
    with making(file):
        (make,) = cameras_in(tree, file, size_of(color)).values()
        return Camera(**make())


def write_transforms(folder: Path, views: Sequence[DepthImage]) -> None:
    """Write transforms.json, and depth as 16-bit PNG, beside the pictures color_00.png etc. in the folder.

    If the format cannot describe a camera, nothing is written. Float colours have no PNG yet, and are written, too.
    """
    try:
        cameras = [nerf_frame(view.camera) for view in views]
    except ArgumentError:
        return
    frames: list[dict[str, Any]] = []
    unit = _unit([float(view.depth[view.valid].max(initial=0)) for view in views])
    for number, (view, camera) in enumerate(zip(views, cameras, strict=True)):
        color, depth = f"color_{number:02d}.png", f"depth_{number:02d}.png"
        if view.shown_color.dtype != np.uint8:
            write_color(folder / color, view.shown_color)
        counts = np.where(view.valid, np.rint(view.depth / unit), 0)
        image.write_color(folder / depth, counts.astype(np.uint16))
        frames.append({"file_path": color, "depth_file_path": depth, **camera})
    write_frames(folder, frames, unit)


def write_frames(folder: Path, frames: Sequence[_Entry], unit: float) -> None:
    """Write transforms.json from frames, each with the entries of `nerf_frame` and the names of its files.

    unit: scene units per stored unit of depth.
    """
    model = frames[0]["camera_model"] if frames else "OPENCV"
    write_json(folder / _FILES[0], {"camera_model": model, **dict.fromkeys(_UNITS, unit), "frames": list(frames)})


def _unit(farthest: Sequence[float]) -> float:
    """Scene units per stored unit: 0.001 as in nerfstudio, unless depths are too large or small for 16 bits then."""
    far = max(farthest, default=0.0)
    return 0.001 if 1 <= far < 65.535 or far == 0 else far / 65535
