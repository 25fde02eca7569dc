"""Recordings of depth cameras: colour, depth and pose files of a folder, and their pairing into frames."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pyibr.core.calibrations import points_up
from pyibr.core.camera import Camera
from pyibr.core.checks import Float64
from pyibr.core.conventions import mirrored
from pyibr.core.errors import ArgumentError, FileFormatError
from pyibr.core.files import decoding
from pyibr.io import (
    COLOR_SUFFIXES,
    DEPTH_SUFFIXES,
    DepthKind,
    DepthReading,
    depth_kinds,
    read_cameras,
    read_color,
    read_depth,
)
from pyibr.io.folders import at_one_time, files_in, least_apart, number_of, time_of
from pyibr.io.poses import read_trajectory
from pyibr.io.video import SUFFIXES, first_frame

if TYPE_CHECKING:
    from typing_extensions import Unpack

_SIZELESS = (".txt", ".npy", ".csv", ".yaml", ".yml", ".xml", ".gltf", ".glb")  # these may lack the pictures' size

_LOSSY = (".jpg", ".jpeg")

Depth = NDArray[np.float32]


@dataclass(frozen=True)
class Stored:
    """Storage of a frame in a layout; readers of its files, for layouts where the files' format does not suffice."""

    scale: float | None = None  # stored units of depth per scene unit; None if the files or the caller give it
    kind: DepthKind = "z"
    offset: float = 0.0  # stored units to add before the division by the scale
    color: Callable[[Path], NDArray[Any]] = read_color
    depth: Callable[[Path], NDArray[Any]] | None = None  # in stored units, NaN where there is none
    confidence: Callable[[], NDArray[Any]] | None = None  # (h, w), of each sample
    least: float = 0.0  # samples of a lower confidence are left out
    chosen: bool = False  # whether `channel` has chosen the images of `depth`

    def read_depth(self, path: Path, camera: Camera | None, how: DepthReading) -> Depth:
        """Planar depth as from `pyibr.read_depth`; `how` replaces the layout's options, except by "z" or 0."""
        scale, kind = how.get("depth_scale") or self.scale, how.get("depth_kind", "z")
        offset = how.get("depth_offset") or self.offset
        kind = self.kind if kind == "z" else kind
        if self.depth is None:
            whole: DepthReading = {**how, "depth_scale": scale, "depth_offset": offset, "depth_kind": kind}
            return read_depth(path, camera=camera, **whole)
        if (chosen := how.get("channel") or how.get("part")) and not self.chosen:
            raise ArgumentError("channel", f"none for {path}: its layout chooses the depth", repr(chosen))
        with decoding(path, "depth", ArgumentError):
            values = (self.depth(path) + np.float64(offset)) / (scale or 1)
        return depth_kinds.planar(
            values.astype(np.float32), kind, camera, path, how.get("near", 1.0), how.get("far", 10.0)
        )

    def picture(self, path: Path) -> NDArray[Any]:
        """The picture as `color` reads it; FileFormatError, which names the file, if it cannot be read."""
        with decoding(path, "picture", ArgumentError):
            shown = self.color(path)
            return shown if shown.dtype != np.uint16 else shown / np.float32(65535)

    def sure(self, path: Path, depth: Depth, least: float | None) -> tuple[Depth, float]:
        """Depth without samples of confidence below `least` (None: the layout's), and the fraction of such samples."""
        if self.confidence is None:
            return depth, 0.0
        with decoding(path, "confidence", ArgumentError):
            known = self.confidence()
        if known.shape != depth.shape:
            raise ArgumentError("confidence", f"{depth.shape[1]}x{depth.shape[0]}, as depth", str(known.shape[::-1]))
        unsure = np.isfinite(depth) & (depth > 0) & (known < (self.least if least is None else least))
        return np.where(unsure, np.float32(np.nan), depth), float(unsure.mean())


PLAIN = Stored()


class Recording(NamedTuple):
    """Files of a recording; entries with the same index belong together."""

    colors: list[Path]  # a video repeats the same file for each frame
    depths: list[Path]
    cameras: tuple[Path, ...] = ()  # input of `read_cameras`: one file or folder, or a file for each frame; or nothing
    poses: Path | None = None  # input of `read_poses`
    left_out: Sequence[Path] = ()
    """Colours without a depth of the same time; if files are paired by number, also depths without colours."""
    times: list[float] | None = None  # of the colours, in seconds
    kept: list[bool] | None = None  # for each colour image originally found, whether it is in `colors`
    known: Callable[[], Sequence[Camera]] | None = None
    """Cameras that the layout gives, one for all frames or one for each, for recordings without files in `cameras`."""
    placed: Sequence[Float64 | None] | None = None
    """Poses (4, 4) that the layout gives, unless `poses` does; None for a frame without a usable pose."""
    depth_cameras: Callable[[], Sequence[Camera | None]] | None = None
    """Cameras of depth that does not share the pictures' cameras, in the same frame as `known`."""
    stored: Sequence[Stored] | None = None
    video: Path | None = None  # the video that the colours are frames of
    is_still: bool = False  # one picture, or several pictures of one moment
    points_up: bool = False  # y points up in the poses' frames: then poses and world are mirrored

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the first picture."""
        return size_of(self.colors[0], self.stored[0].picture if self.stored else read_color)


def cameras_of(
    recording: Recording, files: Sequence[Path] = (), poses: Path | None = None, shared: bool = True
) -> list[tuple[Camera, Float64 | None]]:
    """Camera and pose of each frame; the pose is None if none is known at the frame's time.

    files, poses: replace the recording's own cameras and poses; its own poses are used only if it has one camera.
    shared: whether one camera may serve all frames even without poses.
    """
    read = list(files) or list(recording.cameras)
    path = poses or (recording.poses if len(read) <= 1 else None)
    if not read and recording.known is not None:
        with decoding(recording.depths[0].parent, "camera", ArgumentError):
            known = list(recording.known())
        cameras = known * len(recording.depths) if len(known) == 1 else known
    else:
        cameras = _cameras(recording, read, shared or path is not None)
    if poses is None and len(set(cameras)) > 1 and recording.placed is None:
        path = None
    if path is not None:
        placed = _poses(recording, path)
        if recording.points_up or any(points_up(file) for file in read):
            placed = [None if pose is None else mirrored(pose) for pose in placed]
        return list(zip(cameras, placed, strict=True))
    if recording.placed is not None:
        return list(zip(cameras, recording.placed, strict=True))
    return [(camera, camera.world_from_camera) for camera in cameras]


def with_camera(recording: Recording, camera: Camera) -> Recording:
    """The recording with this camera for all its frames."""
    return recording._replace(cameras=(), known=lambda: [camera])


class Shot(NamedTuple):
    """One frame: its files, the camera of its colours, and the camera of its depth if different.

    color: None for depth alone. stored: storage of the files. number: the frame's own, used in the names of results.
    """

    color: Path | None
    depth: Path
    camera: Camera
    depth_camera: Camera | None
    stored: Stored = PLAIN
    number: int = 0

    def read_depth(self, least: float | None = None, **how: Unpack[DepthReading]) -> tuple[Depth, float]:
        """Planar depth without samples of low confidence, and the fraction of removed samples."""
        depth = self.stored.read_depth(self.depth, self.depth_camera or self.camera, how)
        return self.stored.sure(self.depth, depth, least)


def shots_of(
    recording: Recording,
    cameras: Sequence[tuple[Camera, Float64 | None]],
    depth_camera: Camera | None = None,
) -> list[Shot | None]:
    """The frames in the order of `cameras_of`; None for a frame without a pose.

    depth_camera: replaces the recording's own depth camera. It moves rigidly with the camera of the colours, from
    the first one on.
    """
    count, made = len(recording.depths), list[Shot | None]()
    own = recording.depth_cameras() if recording.depth_cameras and depth_camera is None else [depth_camera] * count
    for k, (number, (camera, pose)) in enumerate(zip(numbers_of(recording), cameras, strict=True)):
        if pose is None:
            made.append(None)
            continue
        of_depth, start = own[k], camera if depth_camera is None else cameras[0][0]
        if of_depth is not None and pose is not start.world_from_camera:
            of_depth = posed(of_depth, pose @ start.camera_from_world @ of_depth.world_from_camera)
        stored = recording.stored[k] if recording.stored else PLAIN
        made.append(Shot(recording.colors[k], recording.depths[k], posed(camera, pose), of_depth, stored, number))
    return made


def are_placed(cameras: Sequence[tuple[Camera, Float64 | None]]) -> bool:
    """Tell whether the frames have known poses; a pose that several frames share counts as unknown."""
    known = [pose for _, pose in cameras if pose is not None]
    return len(cameras) == 1 or any(not np.array_equal(pose, known[0]) for pose in known)


def numbers_of(recording: Recording) -> list[int]:
    """The frames' own numbers: from the pictures' names, or indices among all pictures originally found."""
    count = len(recording.colors)
    named = [number_of(color) for color in recording.colors]
    if recording.video is None and recording.times is None and None not in named and len(set(named)) == count:
        return [number or 0 for number in named]
    return [place for place, is_kept in enumerate(recording.kept or [True] * count) if is_kept]


def posed(camera: Camera, pose: Float64) -> Camera:
    """The camera with another pose."""
    return Camera(camera.K, camera.size, pose, projection=camera.projection, lens=camera.lens)


def depth_files(folder: Path, word: str = "") -> list[Path]:
    """A folder's files of depth, in order; JPEG counts only without others, which it may depict."""
    return files_in(folder, DEPTH_SUFFIXES, word) or files_in(folder, _LOSSY, word)


def paired(color_folder: Path, depth_folder: Path) -> Recording:
    """The pictures of one folder with the depths of another."""
    colors, depths = files_in(color_folder, COLOR_SUFFIXES), depth_files(depth_folder)
    for folder, files, kind in ((color_folder, colors, "picture"), (depth_folder, depths, "file of depth")):
        if not files:
            raise FileFormatError(f"{folder}: no {kind} in it")
    return paired_files(str(depth_folder), colors, depths)


def check_numbers(colors: int, depths: int, name: str) -> None:
    """Raise ArgumentError unless there are as many frames of depth as of colour."""
    if colors != depths:
        raise ArgumentError(name, f"a depth for each of the {colors} frames of colour", f"{depths} of depth")


def paired_files(name: str, colors: list[Path], depths: list[Path]) -> Recording:
    """Pair files by times if the names are times, else by names, else by numbers, else in order."""
    color_times, depth_times = ([time_of(path) for path in paths] for paths in (colors, depths))
    if None not in color_times and None not in depth_times:
        return paired_by_time(colors, [t or 0.0 for t in color_times], depths, [t or 0.0 for t in depth_times])
    preferred = sorted(depths, key=lambda path: -(*DEPTH_SUFFIXES, *_LOSSY).index(path.suffix.lower()))
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


def _of_same_numbers(
    name: str, colors: dict[tuple[int, ...], Path], depths: dict[tuple[int, ...], Path]
) -> Recording | None:
    """Pair files of equal numbers where some frames are lost; None if no number is in both."""
    both = [own for own in colors if own in depths]
    lacking = [own for own in [*colors, *depths] if own not in colors or own not in depths]
    shifts = {a[-1] - b[-1] for a, b in zip(colors, depths, strict=False)}  # different starts, such as 0 and 1
    if not both:
        return None
    if lacking and (2 * len(both) < max(len(colors), len(depths)) or (len(colors) == len(depths) and len(shifts) == 1)):
        file, missing = (colors, "depth") if lacking[0] in colors else (depths, "colour")
        raise ArgumentError(name, "colour and depth of the same numbers", f"{file[lacking[0]].name} without {missing}")
    kept = [own in depths for own in colors]
    left_out = [(colors if own in colors else depths)[own] for own in lacking]
    return Recording([colors[own] for own in both], [depths[own] for own in both], left_out=left_out, kept=kept)


def _name(path: Path) -> str:
    """Name of a file without the words that distinguish colour from depth."""
    return re.sub(r"[._-]?(colou?r|rgb|depth|pose)[._-]?", "", path.stem.lower())


def _numbers(path: Path) -> tuple[int, ...]:
    return tuple(int(number) for number in re.findall(r"\d+", path.stem))


def paired_by_time(
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


def _cameras(recording: Recording, files: Sequence[Path], shared: bool) -> list[Camera]:
    """A camera for each frame: by the pictures' names, in order, or one for all."""
    colors, count = recording.colors, len(recording.depths)
    if not files:
        raise ArgumentError("camera", "a file with the camera (or --fov, --focal-35mm)", f"none for {colors[0]}")
    sizes = [size_of(colors[0]) if file.suffix.lower() in _SIZELESS else None for file in files]
    found = [named for file, size in zip(files, sizes, strict=True) for named in read_cameras(file, size=size).items()]
    if len(found) == 1 and (count == 1 or shared):
        return [found[0][1]] * count
    by_name = dict(found) if len(files) == 1 and files[0].is_dir() else {}
    chosen = [by_name[name] for color in colors if (name := next((n for n in _names_of(color) if n in by_name), None))]
    if len(chosen) == count:
        return chosen
    if len(found) != count:
        names = ", ".join(map(str, files))
        raise FileFormatError(f"{names}: expected a camera for each of {count} pictures, got {len(found)}")
    return [camera for _, camera in found]


def _names_of(color: Path) -> list[str]:
    """Names that camera files may use for a picture: its own, with preceding folders (of rigs), and its stem."""
    parts = color.parts
    return ["/".join(parts[-count:]) for count in range(min(len(parts), 4), 0, -1)] + [color.stem]


def size_of(picture: Path, read: Callable[[Path], NDArray[Any]] = read_color) -> tuple[int, int]:
    """(width, height) of a picture or a depth map, as `read` returns it, or of a video's frames."""
    read = first_frame if picture.suffix.lower() in SUFFIXES else read
    height, width = read(picture).shape[:2]
    return width, height


def _poses(recording: Recording, path: Path) -> list[Float64 | None]:
    """A pose for each frame, by its time or number, or in order; None if there is none for its time."""
    found = read_trajectory(path)
    matrices, colors, count = found.poses, recording.colors, len(recording.depths)
    if recording.video is None and found.files is not None and (named := _by_names(colors, found.files)):
        return [matrices[named[place]] if place in named else None for place in range(count)]
    pairs: dict[int, int] = {}
    if found.times is not None and len(set(colors)) == count and recording.video is None:
        at = recording.times or [float(number_of(color) or 0) for color in colors]
        pairs = dict(at_one_time(at, found.times.tolist()))
    if pairs and (recording.times or 2 * len(pairs) >= count):
        return [matrices[pairs[place]] if place in pairs else None for place in range(count)]
    if not pairs and recording.kept is not None and len(matrices) == len(recording.kept):  # one of each
        return [pose for pose, is_kept in zip(matrices, recording.kept, strict=True) if is_kept]
    if len(matrices) != count:
        raise FileFormatError(f"{path}: expected a pose for each of {count} frames, got {len(matrices)}")
    return matrices


def _by_names(colors: Sequence[Path], files: Sequence[Path]) -> dict[int, int]:
    """For each picture, the index of the pose whose file has its time, name or numbers; empty if no pose matches."""
    times = [[time_of(path) for path in paths] for paths in (colors, files)]
    if None not in times[0] and None not in times[1]:
        return dict(at_one_time(*([time or 0.0 for time in each] for each in times)))
    for key in (_name, _numbers):
        of_files = {key(file): place for place, file in enumerate(files)}
        found = {place: of_files[key(color)] for place, color in enumerate(colors) if key(color) in of_files}
        if len(of_files) == len(files) and found:
            return found
    return {}
