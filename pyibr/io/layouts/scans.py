"""Scanned rooms: 7-Scenes, ScanNet and its exporters, unpacked .sens, NYU Depth's raw recordings; and BOP's scenes."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.core.calibrations import unread_in, warn_of_unread
from pyibr.core.camera import Camera
from pyibr.core.checks import Float64
from pyibr.core.errors import FileFormatError
from pyibr.core.lens import Lens
from pyibr.io import image, read_depth
from pyibr.io.folders import files_in
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
from pyibr.io.recordings import COLOR_SUFFIXES, Recording, Stored, paired_by_time, paired_files, size_of

_SIZE = (640, 480)
_SEVEN_SCENES = matrix(585.0, 320.0, 240.0)
_INTRINSICS = ("intrinsic/intrinsic_{}.txt", "intrinsic_{}.txt", "intrinsics_{}.txt", "intrinsics/intrinsics_{}.txt")
_MILLIMETRES = Stored(1000)
_EXTRINSICS = ("m_calibrationColorExtrinsic", "m_calibrationDepthExtrinsic")
_INFO = ("_info.txt", "info.txt")
# NYU Depth's, from the data set's toolbox, which counts pixels from 1
_NYU_COLOR = matrix(518.857901175, 324.582449411, 252.737616633, 519.469611121)
_NYU_COLOR_LENS = Lens("brown_conrady", [0.207966153, -0.586138252, 0.000722314, 0.001047963, 0.498569867])
_NYU_DEPTH = matrix(582.624481677, 312.044758708, 237.443896264, 582.691032710)
_NYU_DEPTH_LENS = Lens("brown_conrady", [-0.099897237, 0.390653246, 0.001929059, -0.001942202, -0.510317251])
_NYU_ROTATION = np.array(
    [
        [0.999977988, -0.005035992, -0.004319662],
        [0.005051842, 0.999980519, 0.003666237],
        [0.004301115, -0.003687978, 0.999983949],
    ]
)
_NYU_TRANSLATION = -np.array([0.025031876, 0.000662387, -0.000293423])
_NYU_FAR = 10.0  # metres; the toolbox treats farther depth as invalid


def find_seven_scenes(folder: Path) -> Recording | None:
    """Find files frame-000000.color.png, .depth.png (65535: none) and .pose.txt."""
    if not any(folder.glob("frame-*.pose.txt")) or (found := plain.find_names(folder)) is None:
        return None
    known = own_camera("7-Scenes", _SEVEN_SCENES, _SIZE, found.colors)
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
    moved = {name: [float(word) for word in told[name]] for name in _EXTRINSICS if name in told}
    warn_of_unread(info, unread_in(moved, ""))
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
    told = {int(number): one for number, one in object_in(file, "cam_R_w2c|cam_t_w2c").items() if number.isdecimal()}
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


def find_nyu(folder: Path) -> Recording | None:
    """Find pictures r-TIME-COUNT.ppm and depth d-TIME-COUNT.pgm."""
    colors = [file for file in files_in(folder, (".ppm",), "r-") if file.name.startswith("r-")]
    depths = [file for file in files_in(folder, (".pgm",), "d-") if file.name.startswith("d-")]
    if not colors or not depths:
        return None
    found = paired_by_time(colors, [_time(file) for file in colors], depths, [_time(file) for file in depths])
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = _NYU_ROTATION, _NYU_TRANSLATION
    of_depth = Camera(_NYU_DEPTH, _SIZE, pose, lens=_NYU_DEPTH_LENS)
    return found._replace(
        known=lambda: [Camera(_NYU_COLOR, _SIZE, lens=_NYU_COLOR_LENS)],
        depth_cameras=lambda: [of_depth] * len(found.colors),
        stored=[Stored(depth=_metres)] * len(found.colors),
    )


def _time(file: Path) -> float:
    found = re.match(r"[rd]-(\d+\.\d+)", file.name)
    if found is None:
        raise FileFormatError(f"{file}: expected a time in its name, such as r-1294886360.208451-2996770081.ppm")
    return float(found[1])


def _metres(path: Path) -> NDArray[np.float32]:
    """Depth in metres from the sensor's counts, whose bytes are swapped in these files."""
    counts = image.read_depth(path).astype(np.uint16).byteswap().astype(np.float64)
    with np.errstate(divide="ignore"):
        metres = 351.3 / (1092.5 - counts)
    return np.where((metres > 0) & (metres < _NYU_FAR), metres, np.nan).astype(np.float32)
