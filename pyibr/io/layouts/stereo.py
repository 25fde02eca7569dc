"""Stereo benchmarks: Middlebury's pairs since 2014, ETH3D's with the same layout, KITTI's sparse depth from LiDAR."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from pyibr.core.errors import FileFormatError
from pyibr.io.folders import files_in
from pyibr.io.layouts.parts import by_number, camera_of, joined, numbers_in, values_in
from pyibr.io.recordings import COLOR_SUFFIXES, Recording, Stored, size_of

_DISPARITY = ("disp{}.pfm", "disp{}GT.pfm", "disp{}.npy", "disp{}-n.pgm")
_DEPTHS = ("groundtruth_depth", "velodyne_raw")
_KINDS, _CAMERAS, _CALIBRATION = ("groundtruth", "velodyne_raw"), ("image_02", "image_03"), "calib_cam_to_cam.txt"
_KITTI = Stored(256)


def find_middlebury(folder: Path) -> Recording | None:
    """Find im0.png, disp0.pfm (maybe also the other view) and calib.txt: disparity in pixels, baseline in mm."""
    calibration = folder / "calib.txt"
    views = [number for number in (0, 1) if (folder / f"im{number}.png").is_file() and _disparity(folder, number)]
    if not views or not calibration.is_file():
        return None
    lines = values_in(calibration, "=")
    told = {name: [float(n) for n in re.findall(r"[-+.\deE]+", value)] for name, value in lines.items() if value}
    offset, baseline = told.get("doffs", [0.0])[0], told["baseline"][0] / 1000
    matrices = [np.reshape(told[f"cam{number}"], (3, 3)) for number in views]
    images = [folder / f"im{number}.png" for number in views]
    cameras = [camera_of(calibration, K, size_of(image)) for K, image in zip(matrices, images, strict=True)]
    steps = [np.diag([1.0, 1.0, 1.0, 1.0]) for _ in views]
    for number, step in zip(views, steps, strict=True):
        step[0, 3] = number * baseline
    return Recording(
        images,
        [path for number in views if (path := _disparity(folder, number))],
        known=lambda: cameras,
        placed=steps,
        stored=[Stored(float(camera.K[0, 0]) * baseline, "inverse", offset) for camera in cameras],
        is_still=True,
    )


def _disparity(folder: Path, number: int) -> Path | None:
    return next((path for form in _DISPARITY if (path := folder / form.format(number)).is_file()), None)


def find_selection(folder: Path) -> Recording | None:
    """Find folders image, groundtruth_depth (or velodyne_raw) and intrinsics, with one file for each frame."""
    images, intrinsics = folder / "image", folder / "intrinsics"
    depth = next((folder / name for name in _DEPTHS if (folder / name).is_dir()), None)
    if not images.is_dir() or depth is None:
        return None
    if not intrinsics.is_dir():
        raise FileFormatError(f"{folder}: has images and {depth.name}, but no folder intrinsics")
    depths = {
        re.sub("_(groundtruth_depth|velodyne_raw)_", "_image_", file.name): file for file in files_in(depth, (".png",))
    }
    _, found = joined(depth, {file.name: file for file in files_in(images, COLOR_SUFFIXES)}, depths)
    files = [intrinsics / f"{color.stem}.txt" for color in found.colors]
    return found._replace(
        known=lambda: [
            camera_of(file, numbers_in(file).reshape(3, 3), size_of(color))
            for file, color in zip(files, found.colors, strict=True)
        ],
        stored=[_KITTI] * len(files),
    )


def find_drive(folder: Path) -> Recording | None:
    """Find image_02/data beside proj_depth/groundtruth/image_02, and calib_cam_to_cam.txt there or one folder up."""
    places = [folder / _CALIBRATION, folder.resolve().parent / _CALIBRATION]
    calibration = next((place for place in places if place.is_file()), None)
    depths = [folder / "proj_depth" / kind / camera for kind in _KINDS for camera in _CAMERAS]
    depth = next((place for place in depths if place.is_dir() and (folder / place.name / "data").is_dir()), None)
    if calibration is None or depth is None:
        return None
    _, found = joined(depth, by_number(folder / depth.name / "data", COLOR_SUFFIXES), by_number(depth, (".png",)))
    row = values_in(calibration, ":")[f"P_rect_{depth.name[-2:]}"]
    K = np.reshape([float(word) for word in row.split()], (3, 4))[:, :3]
    return found._replace(
        known=lambda: [camera_of(calibration, K, size_of(found.colors[0]))],
        stored=[_KITTI] * len(found.colors),
    )
