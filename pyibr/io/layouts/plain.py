"""Generic layouts: frames in two folders, or in one by their names, with files of cameras and poses beside them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pyibr.core.errors import FileFormatError
from pyibr.io.colmap_model import model_in
from pyibr.io.depth_frames import FRAME_SUFFIXES, DepthFrames, recorded
from pyibr.io.folders import files_in
from pyibr.io.recordings import COLOR_SUFFIXES, Recording, depth_files, paired, paired_files
from pyibr.io.video import SUFFIXES, Video

COLOR_FOLDERS, DEPTH_FOLDERS = ("rgb", "color", "colour", "image", "images"), ("depth", "depths")
_POSE_FILES = ("groundtruth.txt", "trajectory.log", "trajectory.txt", "poses.txt")
_OPEN3D = ("intrinsic.json", "camera_intrinsic.json", "camera_primesense.json")  # names in its recorders and samples
_CAMERA_FILES = ("frusta.json", "camera.json", *_OPEN3D, "camera-intrinsics.txt", "intrinsics.K.txt")


def find_folders(folder: Path) -> Recording | None:
    """Find two folders, of pictures and of depth."""
    color, depth = folder_in(folder, COLOR_FOLDERS), folder_in(folder, DEPTH_FOLDERS)
    return with_files(folder, paired(color, depth)) if color and depth else None


def find_films(folder: Path, channel: str | None = None) -> Recording | None:
    """Find a video of colours, and depth as a video or as an array (`channel`) of all frames."""
    colors = [file for word in ("color", "rgb") for file in files_in(folder, SUFFIXES, word)]
    depths = [file for file in files_in(folder, FRAME_SUFFIXES, "depth") if file not in colors]
    if len(colors) != 1 or len(depths) != 1:
        return None
    video, frames = Video(colors[0]), DepthFrames(depths[0], channel)
    return with_files(folder, recorded([video.path] * len(video), frames, video.path))


def find_names(folder: Path) -> Recording | None:
    """Find files with color (or rgb) and depth in their names."""
    depths = depth_files(folder, "depth")
    colors = files_in(folder, COLOR_SUFFIXES, "color") or files_in(folder, COLOR_SUFFIXES, "rgb")
    return with_files(folder, paired_files(str(folder), colors, depths)) if depths and colors else None


def folder_in(folder: Path, names: Sequence[str]) -> Path | None:
    """The first subfolder with one of these names, in any case."""
    try:
        entries = sorted(folder.iterdir(), reverse=True)
    except OSError as error:
        raise FileFormatError(f"{folder}: cannot be read: {error.strerror}") from error
    there = {entry.name.lower(): entry for entry in entries if entry.is_dir()}
    return next((there[name] for name in names if name in there), None)


def with_files(folder: Path, found: Recording) -> Recording:
    """The recording with the camera and pose files in its folder."""
    poses = next((folder / name for name in _POSE_FILES if (folder / name).is_file()), None)
    if poses is None:
        places = [
            place for place in (folder / "pose", folder / "poses") if place.is_dir() and files_in(place, (".txt",))
        ]
        poses = next(iter(places), folder if files_in(folder, (".txt",), "pose") else None)
    return found._replace(cameras=_camera_files(folder, found.colors), poses=poses)


def _camera_files(folder: Path, colors: Sequence[Path]) -> tuple[Path, ...]:
    """A camera file for each frame, or one for all; or COLMAP's model."""
    stems = [color.stem.removesuffix(".color") for color in colors]
    for place in (folder, folder / "camera"):
        own = [place / f"{stem}.json" for stem in stems]
        if any(file.is_file() for file in own):
            return tuple(own)
    models = [place for place in (folder / "sparse", folder) if model_in(place)]
    return next(((folder / name,) for name in _CAMERA_FILES if (folder / name).is_file()), tuple(models[:1]))
