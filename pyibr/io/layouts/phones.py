"""Phones with a LiDAR scanner: Stray Scanner, Record3D, Polycam, 3D Scanner App. Depth is coarser than pictures."""

from __future__ import annotations

import functools
import json
import zipfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.core.calibrations import unread_in, warn_of_unread
from pyibr.core.camera import Camera
from pyibr.core.checks import Float64
from pyibr.core.conventions import CV_FROM_GL
from pyibr.core.errors import FileFormatError
from pyibr.core.files import decoding, read_at_most, read_text, reading
from pyibr.core.optional import lzfse
from pyibr.io import image, read_depth
from pyibr.io.folders import in_order, number_of
from pyibr.io.layouts import plain
from pyibr.io.layouts.parts import beside, by_number, camera_of, joined, matrix, numbers_in, object_in
from pyibr.io.poses import pose_of, rigid_or_none
from pyibr.io.recordings import COLOR_SUFFIXES, Recording, Stored, size_of
from pyibr.io.video import Video

_MEDIUM = 1  # ARKit's confidence; 0 is low, 2 is high


def find_stray(folder: Path) -> Recording | None:
    """Find rgb.mp4 (or rgb), depth in millimetres, confidence, camera_matrix.csv and odometry.csv (OpenCV's axes)."""
    intrinsics, video = folder / "camera_matrix.csv", folder / "rgb.mp4"
    depth = plain.folder_in(folder, ("depth",))
    if not intrinsics.is_file() or depth is None:
        return None
    depths = by_number(depth, (".png", ".npy"))
    pictures = plain.folder_in(folder, plain.COLOR_FOLDERS)
    if pictures is not None:
        colors = by_number(pictures, COLOR_SUFFIXES)
    elif video.is_file():
        colors = dict.fromkeys(range(len(Video(video))), video)
    else:
        return None
    odometry = folder / "odometry.csv"
    poses = _odometry(odometry) if odometry.is_file() else dict.fromkeys(colors, np.eye(4))
    numbers, found = joined(depth, colors, depths)

    @functools.cache
    def camera() -> Any:
        return camera_of(intrinsics, numbers_in(intrinsics), size_of(colors[numbers[0]]))

    return found._replace(
        known=lambda: [camera()],
        placed=[poses.get(number) for number in numbers],
        depth_cameras=lambda: beside([camera()] * len(numbers), depths[numbers[0]]),
        stored=_of_arkit(1000, _confidences(folder), numbers),
        video=video if pictures is None else None,
    )


def find_record3d(folder: Path) -> Recording | None:
    """Find rgb, depth (metres), confidence and metadata.json: K by columns, OpenGL poses as quaternion, position."""
    file = folder / "metadata.json"
    if not file.is_file() or not {"K", "poses"} <= (told := object_in(file)).keys():
        return None
    pictures, depth = plain.folder_in(folder, plain.COLOR_FOLDERS), plain.folder_in(folder, plain.DEPTH_FOLDERS)
    if pictures is None or depth is None:
        return None
    colors, depths = by_number(pictures, COLOR_SUFFIXES), by_number(depth, (".exr", ".npy", ".png", ".tif"))
    numbers, found = joined(depth, colors, depths)
    cameras, poses = _told_by_record3d(told, file, numbers)
    return found._replace(
        known=lambda: cameras,
        placed=poses,
        depth_cameras=lambda: beside(cameras, depths[numbers[0]]),
        stored=_of_arkit(None, _confidences(folder), numbers),
    )


def find_polycam(folder: Path) -> Recording | None:
    """Find Polycam's raw data: images and OpenGL cameras, maybe corrected, depth in mm, confidence."""
    place = folder / "keyframes" if (folder / "keyframes").is_dir() else folder
    kind = "corrected_" if (place / "corrected_cameras").is_dir() else ""
    pictures, told = place / f"{kind}images", place / f"{kind}cameras"
    if not all(one.is_dir() for one in (pictures, told, place / "depth")):
        return None
    files = by_number(told, (".json",))
    frames = by_number(pictures, COLOR_SUFFIXES), by_number(place / "depth", (".png",)), files
    if not files or "t_00" not in object_in(next(iter(files.values()))):
        return None

    def camera(one: Mapping[str, Any]) -> tuple[Float64, Float64]:
        rows = np.reshape([one[f"t_{i}{j}"] for i in range(3) for j in range(4)], (3, 4))
        return matrix(one["fx"], one["cx"], one["cy"], one["fy"]), np.vstack([rows, [0, 0, 0, 1]])

    return _of_files(place, _confidences(place), frames, camera, r"t_\d\d|center_depth|blur_score|manual_keyframe")


def find_scanner_app(folder: Path) -> Recording | None:
    """Find 3D Scanner App's data: frame_00000.jpg (some missing), .json, depth_ (millimetres) and conf_00000.png."""
    files = by_number(folder, (".json",), "frame_")
    if not files or "cameraPoseARFrame" not in object_in(next(iter(files.values()))):
        return None

    def camera(one: Mapping[str, Any]) -> tuple[Float64, Float64]:
        return np.reshape(one["intrinsics"], (3, 3)), np.reshape(one["cameraPoseARFrame"], (4, 4))

    frames = by_number(folder, (".jpg",), "frame_"), by_number(folder, (".png",), "depth_"), files
    sure = by_number(folder, (".png",), "conf_")
    return _of_files(folder, sure, frames, camera, "cameraPoseARFrame|intrinsics|exifData")


def _of_files(
    place: Path,
    sure: Mapping[int, Path],
    frames: tuple[dict[int, Path], dict[int, Path], dict[int, Path]],
    camera: Callable[[Mapping[str, Any]], tuple[Float64, Float64]],
    keys: str,
) -> Recording:
    """Pictures, depth in millimetres, and a file for each frame with K and a pose with OpenGL's axes."""
    colors, depths, files = frames
    numbers, found = joined(place, colors, depths, files)
    told = [camera(object_in(files[number], keys)) for number in numbers]
    size = size_of(colors[numbers[0]])
    cameras = [camera_of(files[number], K, size) for number, (K, _) in zip(numbers, told, strict=True)]
    exact = [rigid_or_none(pose) for _, pose in told]
    return found._replace(
        known=lambda: cameras,
        placed=[None if pose is None else pose @ CV_FROM_GL for pose in exact],
        depth_cameras=lambda: beside(cameras, depths[numbers[0]]),
        stored=_of_arkit(1000, sure, numbers),
    )


def find_r3d(place: Path) -> Recording | None:
    """Find a .r3d file, also alone in a folder or unpacked: metadata; pictures, depth, confidence (LZFSE) in rgbd."""
    within = [file for file in place.glob("*") if file.suffix.lower() == ".r3d"]
    place = within[0] if len(within) == 1 else place
    packed = zipfile.Path(place) if place.is_file() else place
    file, frames = packed / "metadata", packed / "rgbd"
    if not file.is_file() or not frames.is_dir():
        return None
    names = [place / "rgbd" / one.name for one in frames.iterdir()]
    colors, depths, sure = (
        {
            number: name
            for name in sorted(names, key=in_order)
            if name.suffix == suffix and (number := number_of(name)) is not None
        }
        for suffix in (".jpg", ".depth", ".conf")
    )
    numbers, found = joined(place, colors, depths)
    cameras, poses = _told_by_record3d(json.loads(_bytes(file)), place, numbers)
    width, height = cameras[0].size

    def values(kind: str, name: Path) -> NDArray[Any]:
        """(h, w) of a packed array, which has the picture's aspect ratio."""
        with decoding(name, "LZFSE"):
            flat = np.frombuffer(lzfse().decompress(_bytes(frames / name.name)), kind)
            return flat.reshape(round((flat.size * height / width) ** 0.5), -1)

    depth = functools.partial(values, "<f4")
    return found._replace(
        known=lambda: cameras,
        placed=poses,
        depth_cameras=lambda: beside(cameras, depths[numbers[0]], depth),
        stored=[
            Stored(
                color=lambda name: image.decoded(_bytes(frames / name.name)),
                depth=depth,
                confidence=functools.partial(values, "u1", sure[number]) if number in sure else None,
                least=_MEDIUM,
            )
            for number in numbers
        ],
    )


def _bytes(file: Path | zipfile.Path) -> bytes:
    with file.open("rb") as stream:
        return read_at_most(stream)


def _told_by_record3d(told: Any, file: Path, numbers: Sequence[int]) -> tuple[list[Camera], list[Float64 | None]]:
    """Cameras and poses of the frames with these numbers."""
    warn_of_unread(file, unread_in(told, "poses|initPose|perFrame.*"))  # the first pose is in the list, too
    try:
        rows = np.array(told["poses"], np.float64).reshape(-1, 7)
        K = np.array(told["K"], np.float64).reshape(3, 3).T
        size = int(told["w"]), int(told["h"])
        own = [matrix(fx, cx, cy, fy) for fx, fy, cx, cy in told.get("perFrameIntrinsicCoeffs", ())]
    except (KeyError, TypeError, ValueError) as error:
        raise FileFormatError(f"{file}: expected K, w, h and poses of 7 numbers: {error}") from error
    exact = [rigid_or_none(pose_of(row[4:], row[:4])) for row in rows]
    poses = {number: pose @ CV_FROM_GL for number, pose in enumerate(exact) if pose is not None}
    cameras = [camera_of(file, own[number] if number < len(own) else K, size) for number in numbers]
    return cameras, [poses.get(number) for number in numbers]


def _of_arkit(scale: float | None, files: Mapping[int, Path], numbers: Sequence[int]) -> list[Stored]:
    """Storage of depth with ARKit's confidence, for frames that have a file of it."""
    reads = {number: image.read_color if file.suffix == ".png" else read_depth for number, file in files.items()}
    return [
        Stored(scale, confidence=functools.partial(reads[n], files[n]) if n in files else None, least=_MEDIUM)
        for n in numbers
    ]


def _confidences(place: Path) -> dict[int, Path]:
    folder = place / "confidence"
    return by_number(folder, (".png", ".exr", ".npy")) if folder.is_dir() else {}


def _odometry(path: Path) -> dict[int, Any]:
    """Poses by frame number, from lines: timestamp, frame, x, y, z, qx, qy, qz, qw."""
    with reading(path, "odometry") as source:
        lines = [line.replace(",", " ").split() for line in read_text(source).splitlines()[1:]]
        rows = [[float(word) for word in line[:9]] for line in lines if line]
        return {int(row[1]): rigid_or_none(pose_of(np.array(row[2:5]), np.array(row[5:9]))) for row in rows}
