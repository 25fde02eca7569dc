"""Sequences of pictures or depth, from a file, a folder or a video."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from numpy.typing import NDArray

from pyibr.app.commands.exposure import Exposure
from pyibr.app.options import StoredDepth
from pyibr.core.camera import Camera
from pyibr.core.errors import FileFormatError
from pyibr.core.files import check_exists
from pyibr.io.depth_frames import frames_in
from pyibr.io.folders import files_in
from pyibr.io.recordings import COLOR_SUFFIXES, depth_files
from pyibr.io.video import SUFFIXES, Video


class Series(NamedTuple):
    """Frames of one path."""

    names: list[str]  # of the files without suffix, or numbers of the frames
    files: list[Path]
    read: Callable[[Iterable[int]], Iterator[NDArray[Any]]]  # returns the frames with given numbers, in ascending order
    fps: float | None = None
    is_single: bool = False  # whether the path is a single image


def pictures_in(path: Path, exposure: Exposure) -> Series:
    """The pictures of a path."""
    if path.suffix.lower() not in SUFFIXES or path.is_dir():
        return _of_files(path, files_in(path, COLOR_SUFFIXES) if path.is_dir() else [path], exposure.read)
    video = Video(path)
    return Series(_numbers(len(video)), [path], video.frames, video.fps)


def depths_in(path: Path, stored: StoredDepth, camera: Camera | None) -> Series:
    """The depth of a path.

    camera: needed for depth that is distances.
    """
    check_exists(path)
    frames = None if path.is_dir() else frames_in(path, stored.how.get("channel"))
    if frames is None:
        return _of_files(path, depth_files(path) if path.is_dir() else [path], lambda file: stored.read(file, camera))

    def read(numbers: Iterable[int]) -> Iterator[NDArray[Any]]:
        return (stored.read_frame(frames, number, camera) for number in numbers)

    return Series(_numbers(len(frames)), [path], read, frames.fps)


def paired(a: Series, b: Series, name: str) -> list[tuple[int, int]]:
    """Pairs of indices into two series: files by their names, if they share any, else frames in order."""
    are_files = all(len(one.files) == len(one.names) for one in (a, b))
    places = {stem: number for number, stem in enumerate(b.names)} if are_files else {}
    pairs = [(number, places[stem]) for number, stem in enumerate(a.names) if stem in places]
    if not pairs and len(a.names) != len(b.names):
        raise FileFormatError(f"{name}: expected {len(a.names)} frames, or files of the same names, got {len(b.names)}")
    return pairs or [(number, number) for number in range(len(a.names))]


def _of_files(path: Path, files: list[Path], read: Callable[[Path], NDArray[Any]]) -> Series:
    check_exists(path)
    if not files:
        raise FileFormatError(f"{path}: expected a file of a known suffix in it")

    def read_some(numbers: Iterable[int]) -> Iterator[NDArray[Any]]:
        return (read(files[number]) for number in numbers)

    return Series([file.stem for file in files], files, read_some, is_single=not path.is_dir())


def _numbers(count: int) -> list[str]:
    return [f"{number:04d}" for number in range(count)]
