"""Scanned rooms: 7-Scenes, ScanNet and its exporters, unpacked .sens recordings; and BOP's scenes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pyibr.core.camera import Camera
from pyibr.core.checks import Float64
from pyibr.core.errors import FileFormatError
from pyibr.io import read_depth
from pyibr.io.layouts import plain
from pyibr.io.layouts.parts import (
    beside,
    by_number,
    camera_of,
    inverted,
    joined,
    matrix,
    numbers_in,
    object_in,
    own_camera,
    values_in,
    without,
)
from pyibr.io.poses import rigid_or_none
from pyibr.io.recordings import COLOR_SUFFIXES, Recording, Stored, paired_files, size_of

_SEVEN_SCENES = matrix(585.0, 320.0, 240.0)
_INTRINSICS = ("intrinsic/intrinsic_{}.txt", "intrinsic_{}.txt", "intrinsics_{}.txt", "intrinsics/intrinsics_{}.txt")
_MILLIMETRES = Stored(1000)
_INFO = ("_info.txt", "info.txt")


def find_seven_scenes(folder: Path) -> Recording | None:
    """Find files frame-000000.color.png, .depth.png (65535: none) and .pose.txt."""
    if not any(folder.glob("frame-*.pose.txt")) or (found := plain.find_names(folder)) is None:
        return None
    known = own_camera("7-Scenes", _SEVEN_SCENES, (640, 480), found.colors)
    stored = Stored(1000, depth=without(65535))
    return found._replace(known=known, stored=[stored] * len(found.colors))


def find_sens(folder: Path) -> Recording | None:
    """Find an unpacked .sens recording: frame-000000.* beside an _info.txt with the calibrations."""
    info = next((folder / name for name in _INFO if (folder / name).is_file()), None)
    if info is None or (found := plain.find_names(folder)) is None:
        return None
    told = {name: value.split() for name, value in values_in(info, "=").items()}
    cameras: dict[str, Camera] = {}
    for kind in ("color", "depth"):
        names = [f"m_{kind}Width", f"m_{kind}Height", f"m_calibration{kind.title()}Intrinsic"]
        if any(name not in told for name in names):
            raise FileFormatError(f"{info}: has no {', '.join(name for name in names if name not in told)}")
        try:
            size = int(told[names[0]][0]), int(told[names[1]][0])
            cameras[kind] = camera_of(info, np.reshape([float(word) for word in told[names[2]]], (4, 4)), size)
        except (ValueError, IndexError) as error:
            raise FileFormatError(f"{info}: {error}") from error
    stored = Stored(float(told.get("m_depthShift", ["1000"])[0]), depth=without(65535))
    count = len(found.colors)
    of_depth = None if cameras["color"] == cameras["depth"] else (lambda: [cameras["depth"]] * count)
    return found._replace(known=lambda: [cameras["color"]], depth_cameras=of_depth, stored=[stored] * count)


def find_scannet(folder: Path) -> Recording | None:
    """Find folders color, depth and pose beside intrinsic_color.txt; or files with the same stem in one folder."""
    for form in _INTRINSICS:
        color, depth = (folder / form.format(kind) for kind in ("color", "depth"))
        if color.is_file() and (found := plain.find_folders(folder)) is not None:
            return _scanned(found, color, depth if depth.is_file() else color)
    if (folder / "intrinsic.txt").is_file() and (found := _of_one_stem(folder)) is not None:
        depth = folder / "depth_intrinsic.txt"
        return _scanned(found, folder / "intrinsic.txt", depth if depth.is_file() else folder / "intrinsic.txt")
    return None


def find_bop(folder: Path) -> Recording | None:
    """Find rgb (or gray) and depth beside scene_camera.json: K, pose in mm and unit of depth for each frame."""
    file = folder / "scene_camera.json"
    if not file.is_file():
        return None
    told = {int(number): one for number, one in object_in(file).items() if number.isdecimal()}
    pictures = by_number(plain.folder_in(folder, ("rgb", "gray", "grey")) or folder, COLOR_SUFFIXES)
    depths = by_number(plain.folder_in(folder, ("depth",)) or folder, (".png", ".tif", ".tiff"))
    numbers, found = joined(file, pictures, depths, told)
    size = size_of(pictures[numbers[0]])
    return found._replace(
        known=lambda: [camera_of(file, np.reshape(told[number].get("cam_K"), (-1, 3)), size) for number in numbers],
        placed=[_bop_pose(told[number]) for number in numbers] if "cam_R_w2c" in told[numbers[0]] else None,
        stored=[Stored(1000 / float(told[number].get("depth_scale", 1))) for number in numbers],
    )


def _bop_pose(told: dict[str, Any]) -> Float64 | None:
    """The pose, in metres."""
    camera_from_world = np.eye(4)
    camera_from_world[:3, :3] = np.reshape(told.get("cam_R_w2c", np.full(9, np.nan)), (3, 3))
    camera_from_world[:3, 3] = np.array(told.get("cam_t_w2c", np.zeros(3))) / 1000
    return inverted(camera_from_world)


def _scanned(found: Recording, color: Path, depth: Path) -> Recording:
    """A recording with the intrinsics of colours and of depth, which share one viewpoint."""
    count = len(found.colors)

    def of_colors() -> list[Camera]:
        return [camera_of(color, numbers_in(color), size_of(found.colors[0]))]

    def of_depth() -> Sequence[Camera | None]:
        camera, size = of_colors()[0], size_of(found.depths[0], lambda path: read_depth(path, depth_scale=1))
        if size == camera.size:
            return [None] * count
        own = camera_of(depth, numbers_in(depth), size)
        return (beside([camera], found.depths[0]) if depth == color else [own]) * count

    return found._replace(cameras=(), known=of_colors, depth_cameras=of_depth, stored=[_MILLIMETRES] * count)


def _of_one_stem(folder: Path) -> Recording | None:
    """Find 00000.jpg, 00000.png and 00000.txt, as exporters of posed images write them."""
    pictures = by_number(folder, (".jpg", ".jpeg"))
    depths, poses = by_number(folder, (".png",)), by_number(folder, (".txt",))
    if not pictures or pictures.keys().isdisjoint(depths):
        return None
    found = paired_files(str(folder), list(pictures.values()), list(depths.values()))
    stems = {file.stem: file for file in poses.values()}
    placed = [_pose_in(stems.get(color.stem)) for color in found.colors]
    return found._replace(placed=placed)


def _pose_in(file: Path | None) -> Float64 | None:
    try:
        return None if file is None else rigid_or_none(numbers_in(file))
    except FileFormatError:
        return None
