"""Inputs of `warp` and `register`: matching pictures, depth and cameras."""

from __future__ import annotations

import functools
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from numpy.typing import NDArray

from pyibr.app.commands.cameras import LensOptions, depth_camera_in
from pyibr.app.options import print_note, printable_text
from pyibr.core.camera import Camera
from pyibr.core.errors import ArgumentError, FileFormatError
from pyibr.core.files import check_exists
from pyibr.io.depth_frames import FRAME_SUFFIXES, DepthFrames, frames_in, recorded
from pyibr.io.folders import files_in
from pyibr.io.layouts import find_recording, may_be_recording, recording_in
from pyibr.io.recordings import (
    COLOR_SUFFIXES,
    PLAIN,
    Recording,
    Shot,
    Stored,
    are_placed,
    cameras_of,
    check_numbers,
    depth_files,
    paired,
    shots_of,
    with_camera,
)
from pyibr.io.video import SUFFIXES, Video

_Read = TypeVar("_Read")


class Losses:
    """Unusable frames of recordings, which are left out and reported. For single pictures they are an error.

    recorded: whether the frames belong to a recording. unsure: each frame's fraction of samples that are left out for
    low confidence.
    """

    def __init__(self, recorded: bool) -> None:
        self._recorded = recorded
        self._errors: list[FileFormatError] = []
        self.unsure: list[float] = []

    def or_none(self, made: Callable[[], _Read]) -> _Read | None:
        """Return the result of `made`; None if a frame's files cannot be used."""
        try:
            return made()
        except FileFormatError as error:
            if not self._recorded:
                raise
            self._errors.append(error)
            return None

    def tell(self, some: bool) -> None:
        """Report lost frames; raise the first error if no frame is left."""
        if self._errors and not some:
            raise self._errors[0]
        if self._errors:
            files = "1 file" if len(self._errors) == 1 else f"{len(self._errors)} files"
            print_note(f"{files} cannot be used; left out: {printable_text(self._errors[0])}")
        if any(self.unsure):
            share = sum(self.unsure) / len(self.unsure)
            print_note(f"{share:.1%} of all samples are left out for low confidence (--min-confidence)")


@dataclass(frozen=True)
class Source:
    """Frames; frames of a video keep its frame numbers."""

    shots: list[Shot]
    video: Video | None
    cameras: Sequence[Path] = ()  # files of the recording, if it is one
    is_placed: bool = False  # whether the frames' poses are known

    def colors(self, losses: Losses, skipped: Collection[int] = ()) -> Iterator[NDArray[Any] | None]:
        """Yield the pictures, None if one is lost or its number skipped; nothing for depth without pictures."""
        wanted = [shot.number for shot in self.shots if shot.number not in skipped]
        frames = None if self.video is None else self.video.frames(wanted)
        for shot in self.shots:
            if shot.number in skipped:
                yield None
            elif frames is not None:
                yield next(frames)
            elif shot.color is not None:
                yield losses.or_none(functools.partial(shot.stored.picture, shot.color))

    def files(self) -> dict[str, list[Path]]:
        """List the files to read: colours and depth."""
        colors = [shot.color for shot in self.shots if shot.color is not None]
        return {"COLOR": colors, "DEPTH": [shot.depth for shot in self.shots]}


class InputOptions(NamedTuple):
    """Options that name the inputs and how to read them."""

    inputs: list[Path]
    cameras: list[Path]
    depth_cameras: list[Path]
    poses: list[Path]
    take: str | None
    lens: LensOptions = LensOptions()
    channel: str | None = None
    extrinsics: Path | None = None

    def read(self, sources: Sequence[Source]) -> dict[str, list[Path]]:
        """All files that are read, by option or argument."""
        each = [source.files() for source in sources]
        files = {name: [path for own in each for path in own[name]] for name in ("COLOR", "DEPTH")}
        options = {"--camera": self.cameras, "--depth-camera": self.depth_cameras, "--poses": self.poses}
        if self.extrinsics:
            options["--extrinsics"] = [self.extrinsics]
        return {**files, **options, "the recording": [path for source in sources for path in source.cameras]}


def open_sources(options: InputOptions) -> tuple[list[Source], bool]:
    """The sources, and whether they are single pictures, which then form one source."""
    recordings, are_stills = _recordings(options.inputs, options.channel)
    count = len(recordings)
    cameras = [options.cameras] if count == 1 else _each("--camera", options.cameras, count)
    depth_cameras = _each("--depth-camera", options.depth_cameras, count)
    poses = _each("--poses", options.poses, count)
    sources: list[Source] = []
    if options.extrinsics and not options.depth_cameras:
        raise ArgumentError("--extrinsics", "--depth-camera with it", "none")
    for (recording, video), of_colors, of_depth, path in zip(recordings, cameras, depth_cameras, poses, strict=True):
        taken = _taken(options.take, len(recording.depths), are_stills)
        shots, is_placed = _shots(recording, are_stills, of_colors, of_depth, path, taken, options)
        sources.append(Source(shots, video, recording.cameras, is_placed))
    for source in sources[1:]:
        if len(source.shots) != len(sources[0].shots):
            expected = f"as many frames in each source as in the first, {len(sources[0].shots)}"
            raise ArgumentError("sources", expected, f"{len(source.shots)} of {source.shots[0].depth.parent}")
    return sources, are_stills


def open_depths(
    options: InputOptions, color: Path | None, alone: Callable[[Path, Stored], tuple[Camera, Camera | None]]
) -> tuple[Source, bool]:
    """Frames of depth, with pictures if `color` or a recording has them, and whether there is a single frame.

    alone: for depth without pictures, returns the cameras for its first file and its storage: the picture's camera,
    and the depth's if it differs.
    """
    (depth,), take = options.inputs, options.take
    is_recording = color in (None, depth) and find_recording(depth, options.channel) is not None
    if is_recording or color is not None:
        inputs = [depth] if color is None or is_recording else [color, depth]
        (source,), is_still = open_sources(options._replace(inputs=inputs))
        return source, is_still
    frames = None if depth.is_dir() else frames_in(depth, options.channel)
    found = Recording([], depth_files(depth) if depth.is_dir() else [depth])
    found = found if frames is None else recorded([], frames)
    if not found.depths:
        raise FileFormatError(f"{depth}: no file of depth in it")
    is_still = not depth.is_dir() and frames is None
    stored = found.stored or [PLAIN] * len(found.depths)
    cameras = alone(found.depths[0], stored[0])
    shots = [Shot(None, found.depths[k], *cameras, stored[k], k) for k in _taken(take, len(found.depths), is_still)]
    return Source(shots, None), is_still


def _recordings(inputs: Sequence[Path], channel: str | None) -> tuple[list[tuple[Recording, Video | None]], bool]:
    for path in inputs:
        check_exists(path)
    if len(inputs) == 1 and may_be_recording(inputs[0], channel):
        recording = recording_in(inputs[0], channel)
        _note_unpaired(recording)
        return [(recording, None if recording.video is None else Video(recording.video))], recording.is_still
    if len(inputs) % 2:
        expected = "COLOR and DEPTH, for each source; or one folder with both"
        raise ArgumentError("sources", expected, f"{len(inputs)} paths" if inputs[1:] else str(inputs[0]))
    pairs = list(zip(inputs[::2], inputs[1::2], strict=True))
    several = [color.is_dir() or color.suffix.lower() in SUFFIXES for color, _ in pairs]
    for (color, depth), are_several in zip(pairs, several, strict=True):
        if are_several != several[0]:
            raise ArgumentError("sources", "all recordings, or all single pictures", f"{pairs[0][0]} and {color}")
        if are_several and not depth.is_dir() and depth.suffix.lower() not in FRAME_SUFFIXES:
            raise ArgumentError("DEPTH", f"a folder, a video, or NPY or NPZ, for the frames of {color}", str(depth))
    if several[0]:
        return [_recorded(*pair, channel) for pair in pairs], False
    return [(Recording([color for color, _ in pairs], [depth for _, depth in pairs]), None)], True


def _recorded(color: Path, depth: Path, channel: str | None) -> tuple[Recording, Video | None]:
    video = None if color.is_dir() else Video(color)
    if depth.is_dir() and video is None:
        recording = paired(color, depth)
        _note_unpaired(recording)
        return recording, None
    colors = files_in(color, COLOR_SUFFIXES) if video is None else [color] * len(video)
    if not depth.is_dir():
        return recorded(colors, DepthFrames(depth, channel), None if video is None else color), video
    depths = depth_files(depth)
    check_numbers(len(colors), len(depths), str(depth))
    return Recording(colors, depths, video=None if video is None else color), video


def _note_unpaired(recording: Recording) -> None:
    if recording.times is not None:
        _note_left_out(len(recording.left_out), "no depth at this time", recording.colors)
    elif recording.left_out:
        folders = " and ".join(dict.fromkeys(printable_text(files[0].parent) for files in recording[:2]))
        count, first = len(recording.left_out), printable_text(recording.left_out[0].name)
        what = f"1 file of {folders}, {first}:" if count == 1 else f"{count} files of {folders}, as {first}:"
        print_note(f"{what} no partner of the same name or number; left out")


def _note_left_out(count: int, why: str, files: Sequence[Path]) -> None:
    if count:
        print_note(
            f"{count} {'pictures' if count > 1 else 'picture'} of {printable_text(files[0].parent)}: {why}; left out"
        )


def _each(option: str, given: Sequence[Path], count: int) -> list[list[Path]]:
    """Give each recording its own value of an option, if any."""
    if given and len(given) != count:
        raise ArgumentError(option, f"one for each of the {count} sources" if count > 1 else "one", str(len(given)))
    return [[path] for path in given] if given else [[]] * count


def _taken(take: str | None, count: int, are_stills: bool) -> range:
    """Numbers of the frames that --take selects."""
    part = _part(take)
    if are_stills and take is not None:
        raise ArgumentError("--take", "a recording", "single pictures")
    numbers = range(count)[part]
    if not numbers:
        raise ArgumentError("--take", f"some of the {count} frames", str(take))
    return numbers


def _part(text: str | None) -> slice:
    """Parse the value of --take."""
    try:
        numbers = [int(word) if word else None for word in (text or ":").split(":")]
        if len(numbers) in (2, 3) and (len(numbers) < 3 or numbers[2] is None or numbers[2] > 0):
            return slice(*numbers)
    except ValueError:
        pass
    raise ArgumentError("--take", "START:STOP or START:STOP:STEP, as 10:90:2", str(text))


def _shots(
    recording: Recording,
    are_stills: bool,
    camera_files: Sequence[Path],
    depth_camera_files: Sequence[Path],
    pose_files: Sequence[Path],
    taken: range,
    options: InputOptions,
) -> tuple[list[Shot], bool]:
    """The selected frames with a usable pose, and whether any poses are known."""
    lens = options.lens
    first, file = recording.colors[0], next(iter(camera_files), None)
    if are_stills and recording.known is None and len(recording.colors) == 1 and not (camera_files[1:] or pose_files):
        own = lens.camera_of(first, file)
        cameras = [(own, own.world_from_camera)]
    else:
        if lens != LensOptions():
            if are_stills and recording.known is None:
                got = f"{len(recording.colors)} pictures"
                raise ArgumentError("--fov, --focal-35mm", "a single picture, or a recording", got)
            recording = with_camera(recording, lens.camera_of(first, file, recording.size))
        cameras = cameras_of(recording, camera_files, next(iter(pose_files), None), shared=not are_stills)
    stored = recording.stored[0] if recording.stored else PLAIN
    args = recording.depths[0], stored, cameras[0][0], options.extrinsics
    of_depth = [depth_camera_in(path, *args) for path in depth_camera_files]
    shots = shots_of(recording, cameras, next(iter(of_depth), None))
    found = [shot for place in taken if (shot := shots[place]) is not None]
    why = "no usable pose" if recording.times is None else "no pose at this time"
    _note_left_out(len(taken) - len(found), why, recording.colors)
    if not found:
        raise FileFormatError(f"{recording.colors[taken[0]]}: {why}, as for all other frames")
    return found, are_placed(cameras)
