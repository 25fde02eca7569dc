"""Recordings of depth cameras: which files of a folder are colour, depth and poses, and which belong together."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from pyibr.core.camera import Camera
from pyibr.core.checks import Float64
from pyibr.core.errors import ArgumentError, FileFormatError
from pyibr.core.files import reading
from pyibr.io import read_cameras, read_color, read_poses
from pyibr.io.folders import at_one_time, files_in, least_apart, number_of, time_of

COLOR_SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp", ".ppm", ".npy", ".npz", ".pfm", ".exr")
DEPTH_SUFFIXES = (".png", ".tif", ".tiff", ".npy", ".npz", ".pfm", ".exr", ".bin")

_COLOR_FOLDERS, _DEPTH_FOLDERS = ("rgb", "color", "colour", "image", "images"), ("depth", "depths")
_POSE_FILES = ("groundtruth.txt", "trajectory.log", "trajectory.txt", "poses.txt")
_OPEN3D = ("intrinsic.json", "camera_intrinsic.json", "camera_primesense.json")  # as its recorders and samples name it
_CAMERA_FILES = ("frusta.json", "camera.json", *_OPEN3D, "camera-intrinsics.txt", "intrinsics.K.txt")
_FORMS = "rgb.txt and depth.txt; color (or rgb) and depth folders; or files with color and depth in their names"


class Recording(NamedTuple):
    """Files of a recording, of which the same places belong together.

    Attributes
    ----------
    colors, depths : list of Path
        Of a video the same file for each frame.
    cameras : tuple of Path
        What `read_cameras` reads: one file or folder, or a file for each frame; or nothing.
    poses : Path or None
        What `read_poses` reads, if there is something.
    left_out : sequence of Path
        Colour images that have no depth of their time; where numbers tell what belongs together, also depths without
        colours.
    times : list of float, or None
        Of the colours, in seconds, if they are known.
    kept : list of bool, or None
        Of all colour images that there were, which are among these.
    """

    colors: list[Path]
    depths: list[Path]
    cameras: tuple[Path, ...] = ()
    poses: Path | None = None
    left_out: Sequence[Path] = ()
    times: list[float] | None = None
    kept: list[bool] | None = None


def recording_in(folder: Path) -> Recording:
    """The recording that a folder holds, in the form of TUM RGB-D, 7-Scenes, Redwood, COLMAP's dense maps or alike."""
    found = find_recording(folder)
    if found is None:
        raise FileFormatError(f"{folder}: neither frusta.json nor frames are in it, of colour and depth: {_FORMS}")
    return found


def find_recording(folder: Path) -> Recording | None:
    """Do as `recording_in` does; None if the folder holds no frames of colour and depth."""
    if (folder / "rgb.txt").is_file() and (folder / "depth.txt").is_file():
        (color_times, colors), (depth_times, depths) = (_listed(folder / name) for name in ("rgb.txt", "depth.txt"))
        found = _at_one_time(colors, color_times, depths, depth_times)
    elif (maps := folder / "stereo" / "depth_maps").is_dir() and (folder / "images").is_dir():
        return _dense_maps(folder, maps)
    elif (color := _folder_in(folder, _COLOR_FOLDERS)) and (depth := _folder_in(folder, _DEPTH_FOLDERS)):
        found = paired(color, depth)
    else:
        depths = files_in(folder, DEPTH_SUFFIXES, "depth")
        colors = files_in(folder, COLOR_SUFFIXES, "color") or files_in(folder, COLOR_SUFFIXES, "rgb")
        if not depths or not colors:
            return None
        found = _paired(str(folder), colors, depths)
    poses = next((folder / name for name in _POSE_FILES if (folder / name).is_file()), None)
    if poses is None:
        places = [
            place for place in (folder / "pose", folder / "poses") if place.is_dir() and files_in(place, (".txt",))
        ]
        poses = next(iter(places), folder if files_in(folder, (".txt",), "pose") else None)
    return found._replace(cameras=_camera_files(folder, found.colors), poses=poses)


def cameras_of(
    recording: Recording, files: Sequence[Path] = (), poses: Path | None = None, shared: bool = True
) -> list[tuple[Camera, Float64 | None]]:
    """The camera of each frame, and its pose there: None where no pose of the frame's time is known.

    Parameters
    ----------
    recording : Recording
    files : sequence of Path
        Instead of the recording's own cameras.
    poses : Path, optional
        Instead of the recording's own poses, which count if it has one camera.
    shared : bool
        Whether one camera may be that of all frames, without poses, too.
    """
    read = list(files) or list(recording.cameras)
    own = recording.poses if len(read) == 1 else None
    path = poses or own
    cameras = _cameras(recording, read, shared or path is not None)
    if path is None or (poses is None and len(set(cameras)) > 1):
        return [(camera, camera.world_from_camera) for camera in cameras]
    return list(zip(cameras, _poses(recording, path), strict=True))


def posed(camera: Camera, pose: Float64) -> Camera:
    """The camera at another place."""
    return Camera(camera.K, camera.size, pose, projection=camera.projection, lens=camera.lens)


def paired(color_folder: Path, depth_folder: Path) -> Recording:
    """The pictures of one folder with the depths of another."""
    colors, depths = files_in(color_folder, COLOR_SUFFIXES), files_in(depth_folder, DEPTH_SUFFIXES)
    for folder, files, kind in ((color_folder, colors, "picture"), (depth_folder, depths, "file of depth")):
        if not files:
            raise FileFormatError(f"{folder}: no {kind} in it")
    return _paired(str(depth_folder), colors, depths)


def check_numbers(colors: int, depths: int, name: str) -> None:
    """Raise ArgumentError unless there are as many frames of depth as of colour."""
    if colors != depths:
        raise ArgumentError(name, f"a depth for each of the {colors} frames of colour", f"{depths} of depth")


def _paired(name: str, colors: list[Path], depths: list[Path]) -> Recording:
    """By their times if the names are times, else by the names, else by their numbers, else in order."""
    color_times, depth_times = ([time_of(path) for path in paths] for paths in (colors, depths))
    if None not in color_times and None not in depth_times:
        return _at_one_time(colors, [t or 0.0 for t in color_times], depths, [t or 0.0 for t in depth_times])
    preferred = sorted(depths, key=lambda path: -DEPTH_SUFFIXES.index(path.suffix.lower()))
    by_name = {_name(path): path for path in preferred}
    if by_name.keys() == {_name(path) for path in colors} and len(by_name) == len(colors):
        return Recording(colors, [by_name[_name(path)] for path in colors])
    numbers, others = ([_numbers(path) for path in paths] for paths in (colors, depths))
    if len(set(numbers)) == len(colors) and len(set(others)) == len(depths):
        found = _of_same_numbers(name, dict(zip(numbers, colors, strict=True)), dict(zip(others, depths, strict=True)))
        if found is not None:
            return found
    check_numbers(len(colors), len(depths), name)
    return Recording(colors, depths)


def _folder_in(folder: Path, names: Sequence[str]) -> Path | None:
    """The first folder in it of one of these names, in whatever case."""
    try:
        entries = sorted(folder.iterdir(), reverse=True)
    except OSError as error:
        raise FileFormatError(f"{folder}: cannot be read: {error.strerror}") from error
    there = {entry.name.lower(): entry for entry in entries if entry.is_dir()}
    return next((there[name] for name in names if name in there), None)


def _of_same_numbers(
    name: str, colors: dict[tuple[int, ...], Path], depths: dict[tuple[int, ...], Path]
) -> Recording | None:
    """Pair files of the same numbers, if frames are lost here and there; None if no number is in both."""
    both = [own for own in colors if own in depths]
    lacking = [own for own in [*colors, *depths] if own not in colors or own not in depths]
    shifts = {a[-1] - b[-1] for a, b in zip(colors, depths, strict=False)}  # counted from 0 and from 1, say
    if not both:
        return None
    if lacking and (2 * len(both) < max(len(colors), len(depths)) or (len(colors) == len(depths) and len(shifts) == 1)):
        file, missing = (colors, "depth") if lacking[0] in colors else (depths, "colour")
        raise ArgumentError(name, "colour and depth of the same numbers", f"{file[lacking[0]].name} without {missing}")
    kept = [own in depths for own in colors]
    left_out = [(colors if own in colors else depths)[own] for own in lacking]
    return Recording([colors[own] for own in both], [depths[own] for own in both], left_out=left_out, kept=kept)


def _name(path: Path) -> str:
    """Name of a file without the words that tell colour from depth."""
    return re.sub(r"[._-]?(colou?r|rgb|depth)[._-]?", "", path.stem.lower())


def _numbers(path: Path) -> tuple[int, ...]:
    return tuple(int(number) for number in re.findall(r"\d+", path.name))


def _at_one_time(
    colors: list[Path], color_times: list[float], depths: list[Path], depth_times: list[float]
) -> Recording:
    pairs = at_one_time(color_times, depth_times)
    if not pairs:
        gap = f"the nearest is {least_apart(color_times, depth_times):.6g} s away"
        raise FileFormatError(f"{depths[0].parent}: no depth within 0.02 s of a colour image; {gap}")
    chosen = [colors[i] for i, _ in pairs], [depths[j] for _, j in pairs]
    kept = {i for i, _ in pairs}
    return Recording(
        *chosen,
        left_out=[color for i, color in enumerate(colors) if i not in kept],
        times=[color_times[i] for i, _ in pairs],
        kept=[i in kept for i in range(len(colors))],
    )


def _listed(path: Path) -> tuple[list[float], list[Path]]:
    """Times and files of a list of a TUM data set."""
    with reading(path, "list of images") as source:
        lines = [line.split() for line in source.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
        rows = sorted((float(line[0]), line[1]) for line in lines if line)
    if not rows:
        raise FileFormatError(f"{path}: lists no image")
    return [time for time, _ in rows], [path.parent / name for _, name in rows]


def _dense_maps(folder: Path, maps: Path) -> Recording:
    """COLMAP's workspace: depth maps have the names of their images, with more behind."""
    images = files_in(folder / "images", COLOR_SUFFIXES)
    of_image = {image: maps / f"{image.name}.geometric.bin" for image in images}
    there = {image: depth for image, depth in of_image.items() if depth.is_file()}
    if not there:
        raise FileFormatError(f"{maps}: no depth map of an image, as {next(iter(of_image.values()), maps).name}")
    cameras = (folder / "sparse",) if (folder / "sparse").is_dir() else ()
    left_out = [image for image in images if image not in there]
    return Recording(list(there), list(there.values()), cameras, None, left_out)


def _camera_files(folder: Path, colors: Sequence[Path]) -> tuple[Path, ...]:
    """A file of each frame, or of all."""
    stems = [color.stem.removesuffix(".color") for color in colors]
    for place in (folder, folder / "camera"):
        own = [place / f"{stem}.json" for stem in stems]
        if any(file.is_file() for file in own):
            return tuple(own)
    return next(((folder / name,) for name in _CAMERA_FILES if (folder / name).is_file()), ())


def _cameras(recording: Recording, files: Sequence[Path], shared: bool) -> list[Camera]:
    """A camera for each frame: by the names of the pictures, or in order; or one for all."""
    colors, count = recording.colors, len(recording.depths)
    if not files:
        raise ArgumentError("camera", "a file with the camera", f"none for {colors[0]}")
    sizes = [_size_of(colors[0]) if file.suffix.lower() == ".txt" else None for file in files]
    found = [named for file, size in zip(files, sizes, strict=True) for named in read_cameras(file, size=size).items()]
    if len(found) == 1 and (count == 1 or shared):
        return [found[0][1]] * count
    by_name = dict(found) if len(files) == 1 and files[0].is_dir() else {}
    chosen = [by_name[name] for color in colors for name in (color.name, color.stem) if name in by_name]
    if len(chosen) == count:
        return chosen
    if len(found) != count:
        names = ", ".join(map(str, files))
        raise FileFormatError(f"{names}: expected a camera for each of {count} pictures, got {len(found)}")
    return [camera for _, camera in found]


def _size_of(color: Path) -> tuple[int, int]:
    height, width = read_color(color).shape[:2]
    return width, height


def _poses(recording: Recording, path: Path) -> list[Float64 | None]:
    """A pose for each frame, by its time or number, or in order; None where there is none of its time."""
    matrices, times = read_poses(path)
    colors, count = recording.colors, len(recording.depths)
    pairs: dict[int, int] = {}
    if times is not None and len(set(colors)) == count:
        at = recording.times or [float(number_of(color) or 0) for color in colors]
        pairs = dict(at_one_time(at, times.tolist()))
    if pairs and (recording.times or len(pairs) == count):
        return [matrices[pairs[place]] if place in pairs else None for place in range(count)]
    if not pairs and recording.kept is not None and len(matrices) == len(recording.kept):  # one of each that there was
        return [pose for pose, is_kept in zip(matrices, recording.kept, strict=True) if is_kept]
    if len(matrices) != count:
        lacking = next(color for place, color in enumerate(colors) if place not in pairs)
        named = f", and none for {lacking.name}" if pairs else ""
        raise FileFormatError(f"{path}: expected a pose for each of {count} frames, got {len(matrices)}{named}")
    return list(matrices)
