"""The files that commands write: single, numbered, or a video; checked before the work."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
import typer
from numpy.typing import NDArray

import pyibr as ibr
from pyibr.app.commands.beside import Behind
from pyibr.app.commands.command import tell_written
from pyibr.app.commands.exposure import stored
from pyibr.app.options import StoredDepth, print_note, printable_text
from pyibr.core.camera import Camera
from pyibr.core.checks import positive
from pyibr.core.errors import ArgumentError
from pyibr.core.files import check_writable, identity
from pyibr.io import check_output, depth_kinds
from pyibr.io.video import Video
from pyibr.io.video_writing import CODECS, Codec, VideoWriter, check_video_output

Kind = Literal["color", "depth", "mask"]


_FPS = 30.0  # for videos, if neither --fps nor the source sets it
_DEPTH_FILM = ".mkv"  # for depth: FFV1, which is lossless


class VideoOptions(NamedTuple):
    """Options of videos."""

    fps: Annotated[
        float | None,
        typer.Option(help="Frame rate of a video; default: the source's frame times and sound, or 30"),
    ] = None
    codec: Annotated[
        Codec | None, typer.Option(help="Codec of a video; default: H.264, VP9 in WebM, lossless FFV1 in MKV")
    ] = None


class Outputs:
    """Files that a command writes for its frames: a single file, numbered files, or a video.

    Parameters
    ----------
    files : mapping
        For each option, starting with --output, its path (or None) and kind of content.
    stored : StoredDepth
        How depth is written.
    numbers : sequence of int, or None
        Numbers of the frames; None for a single frame without a number.
    video : VideoOptions
        Without --fps, frames keep their times in `film`, and its sound is copied.
    film : Video, optional
        The source, if it is a video.
    own : dict of int to str, optional
        File names of the frames by number, if --output is a folder.
    """

    def __init__(
        self,
        files: Mapping[str, tuple[Path | None, Kind]],
        stored: StoredDepth,
        numbers: Sequence[int] | None,
        video: VideoOptions,
        film: Video | None = None,
        own: Mapping[int, str] | None = None,
    ) -> None:
        self._files: dict[str, tuple[Path, Kind]] = {
            option: (path, kind) for option, (path, kind) in files.items() if path is not None
        }
        self._main, _ = next(iter(self._files.values()))
        self._stored, self._numbers, self._own = stored, numbers, own
        self._films = {path for path, kind in self._files.values() if numbers is not None and _is_film(path, kind)}
        self._is_video = self._main in self._films
        for option, value in zip(("--fps", "--codec"), video, strict=True):
            if value is not None and not self._films:
                expected = f"a video of several views ({', '.join(CODECS)}) for --output"
                raise ArgumentError(option, expected, str(self._main))
        self._fps = None if video.fps is None else positive("--fps", video.fps, "frames a second > 0")
        self._codec: Codec | None = video.codec
        self._film = film if video.fps is None else None
        self._stack, self._behind = ExitStack(), Behind(in_order=bool(self._films))
        self._writers: dict[Path, VideoWriter] = {}
        self.written: list[Path] = []
        self._shares: list[float] = []

    def check(self, inputs: Mapping[str, Sequence[Path]], recordings: Sequence[Path] = ()) -> None:
        """Raise the errors of writing before anything is computed.

        inputs: files that are read, by option. recordings: folders that are read. Outputs in their subfolders or
        beside frames are refused, because the next run would read them as frames.
        """
        names = {option: self._names(path) for option, (path, _) in self._files.items()}
        for option, (path, kind) in self._files.items():
            first = names[option][0]
            if kind == "depth" and first.suffix.lower() in (".png", _DEPTH_FILM) and self._stored.depth_scale is None:
                expected = f"stored units per scene unit, for the integers of {path}"
                raise ArgumentError("--depth-scale", expected, "none")
        for option, (path, kind) in self._files.items():
            if path in self._films:
                check_video_output(path) if kind == "depth" else check_video_output(path, self._codec)
            elif kind == "color" and self._numbers is None and path.suffix.lower() in CODECS:
                raise ArgumentError(
                    option, "several views for a video, by --frames or from a recording", f"one for {path}"
                )
            elif kind == "color" and not path.suffix:
                raise ArgumentError(option, f"a file, such as {path / 'new.png'}", f"{path} without a suffix")
            else:
                check_output(names[option][0], kind)
        check_outputs(inputs, names)
        folders = {folder.resolve() for folder in recordings if folder.is_dir()}
        frames = [file for name in ("COLOR", "DEPTH", "--color") for file in inputs.get(name, ())] if folders else []
        of_frames = {file.resolve().parent for file in frames}
        for option, (path, _) in self._files.items():
            place = names[option][0].resolve().parent
            if not folders.isdisjoint(place.parents) or (place in of_frames and place in folders):
                raise ArgumentError(option, "a path outside of the recording that is read", str(path))

    def done(self) -> set[int]:
        """Numbers of the frames whose files all exist."""
        if self._is_video:
            raise ArgumentError("--skip-existing", "numbered pictures, not a video", str(self._main))
        paths = [path for path, _ in self._files.values()]
        return {n for n in self._numbers or [0] if all(self._name(path, n).is_file() for path in paths)}

    def __enter__(self) -> Outputs:
        self._writers = {path: self._stack.enter_context(self._video(path)) for path in self._films}
        self._stack.enter_context(self._behind)  # last, so that it ends before the video does
        return self

    def __exit__(self, *error: object) -> None:
        self._stack.__exit__(*error)  # pyright: ignore[reportArgumentType]

    def write(self, images: Mapping[Kind, NDArray[Any]], number: int, covered: float, camera: Camera | None) -> None:
        """Write a frame in the background.

        covered: fraction of covered pixels. camera: camera of the depth.
        """
        self._behind.add(lambda: self._store(images, number, camera))
        self._size = next(iter(images.values())).shape[1::-1]
        self.written.append(self._main if self._main in self._films else self._name(self._main, number))
        self._shares.append(covered)

    def _store(self, images: Mapping[Kind, NDArray[Any]], number: int, camera: Camera | None) -> None:
        for path, kind in self._files.values():
            name = self._name(path, number)
            how = self._stored
            if path in self._films:
                image = images[kind]
                if kind == "depth":
                    image = depth_kinds.stored(
                        image, how.depth_kind, camera, path, how.depth_scale, how.depth_offset, whole=True
                    )
                self._writers[path].add(image, None if self._film is None else self._time(number))
            elif kind == "color":
                ibr.write_color(name, stored(images[kind], name))
            elif kind == "depth":
                ibr.write_depth(
                    name,
                    images[kind],
                    depth_scale=how.depth_scale,
                    depth_offset=how.depth_offset,
                    depth_kind=how.depth_kind,
                    camera=camera,
                )
            else:
                ibr.write_mask(name, images[kind])

    def _video(self, path: Path) -> VideoWriter:
        film = self._film
        if (path, "depth") in self._files.values():
            return VideoWriter(path, (film.fps if film else self._fps) or _FPS, codec="ffv1", bits=16)
        if film is None:
            return VideoWriter(path, self._fps or _FPS, codec=self._codec)
        start = film.times[next(iter(self._numbers or [0]))]
        sound = film.path if film.has_sound else None
        return VideoWriter(path, film.fps or _FPS, codec=self._codec, sound=sound, start=start)

    def _time(self, number: int) -> float:
        """Seconds from the first frame taken of the film to this frame."""
        assert self._film is not None and self._numbers is not None
        return self._film.times[number] - self._film.times[self._numbers[0]]

    def tell(self, several: str, lacking: str, depths: object = "") -> None:
        """Report the written files.

        several: noun for the frames. lacking: reason for empty frames. depths: range of depth that was read.
        """
        written, count = self.written, None if self._numbers is None else len(self.written)
        empty = [file for file, share in zip(written, self._shares, strict=True) if share == 0]
        if empty:
            first = printable_text(empty[0])
            many = f"{len(empty)} of {count} {several} are empty, as {first}" if count else f"{first} is empty"
            print_note(f"{many}: {lacking}")
        size = self._writers[self._main].size or self._size if self._is_video else self._size
        (width, height), covered = size, float(np.mean(self._shares))
        words = f"{width}x{height}, {covered:.1%} covered{f'; {depths}' if depths else ''}"
        words = f"{count} {several}, {words}" if count else words
        tell_written(list(dict.fromkeys(written)), words, frames=len(written), size=size, covered=covered)

    def _names(self, path: Path) -> list[Path]:
        if path in self._films:
            return [path]
        return [self._name(path, number) for number in self._numbers or [0]]

    def _name(self, path: Path, number: int) -> Path:
        if self._own is not None and path == self._main:
            return path / self._own[number]
        return path if self._numbers is None else path.with_name(f"{path.stem}_{number:04d}{path.suffix}")


def _is_film(path: Path, kind: Kind) -> bool:
    suffix = path.suffix.lower()
    return suffix == _DEPTH_FILM if kind == "depth" else kind == "color" and suffix in CODECS


def check_outputs(inputs: Mapping[str, Sequence[Path]], outputs: Mapping[str, Sequence[Path]]) -> None:
    """Raise ArgumentError if an output is also an input or another output."""
    taken = {identity(file): option for option, paths in inputs.items() for path in paths for file in _files_of(path)}
    for option, paths in outputs.items():
        for path in paths:
            other = taken.get(identity(path))
            if other is not None:
                raise ArgumentError(option, "a file of its own", f"{path}, the same as {other}")
            taken[identity(path)] = option
            check_writable(path)


def _files_of(path: Path) -> list[Path]:
    """The path, and files of a COLMAP model in it: COLMAP depth, which may be an output, has their suffix."""
    return [path, *(path / place / name for place in ("", "0") for name in ("cameras.bin", "images.bin"))]
