"""Videos, through OpenCV."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Generator, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.core.errors import FileFormatError
from pyibr.core.files import check_writable, reading, write_atomically
from pyibr.core.optional import opencv

SUFFIXES = (".avi", ".m4v", ".mkv", ".mov", ".mp4", ".mpeg", ".mpg", ".ts", ".webm", ".wmv")
"""Of what is read as a video."""

CODECS = {".mp4": "mp4v", ".mov": "mp4v", ".avi": "MJPG", ".mkv": "FFV1"}
"""Of what can be written, by suffix: those that all builds of OpenCV have; FFV1 loses nothing."""

_ROOM = 1 << 16  # bytes: more than FFmpeg holds back, so that there is room for them only if all before were written

_QUIET = {"OPENCV_FFMPEG_LOGLEVEL": "-8", "OPENCV_LOG_LEVEL": "SILENT"}  # what is wrong is told by the errors here


def first_frame(path: Path) -> NDArray[np.uint8]:
    """The first picture of a video."""
    return next(Video(path).frames([0]))


class Video:
    """The frames of a video.

    Parameters
    ----------
    path : path

    Raises
    ------
    FileFormatError
        If there is no such file, or it is no video that OpenCV reads.
    MissingPackageError
        OpenCV is not installed.

    Attributes
    ----------
    path : Path
    fps : float or None
        Frames a second, if the file tells.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        with self._opened() as (cv2, capture):
            rate = float(capture.get(cv2.CAP_PROP_FPS))
            self.fps = rate if 0 < rate < np.inf else None
            self._count = 0
            while capture.grab():  # what headers tell of the number of frames is a guess in some formats
                self._count += 1
        if not self._count:
            raise FileFormatError(f"{path}: not a readable video file, or truncated: no frame in it")

    def __len__(self) -> int:
        return self._count

    def frames(self, numbers: Iterable[int]) -> Iterator[NDArray[np.uint8]]:
        """(H, W, 3) of the frames of these numbers, which grow."""
        with self._opened() as (_, capture):
            at = 0
            for number in numbers:
                while at < number and capture.grab():
                    at += 1
                there, frame = capture.read()
                if not there:
                    raise FileFormatError(f"{self.path}: truncated: frame {number} cannot be read")
                at += 1
                yield np.ascontiguousarray(frame[..., ::-1])  # OpenCV's are blue first

    @contextmanager
    def _opened(self) -> Generator[tuple[Any, Any], None, None]:
        with reading(self.path, "video") as source:
            with _quietly() as cv2:
                capture = cv2.VideoCapture(_name(source), cv2.CAP_FFMPEG)
            try:
                if not capture.isOpened():
                    raise FileFormatError(f"{self.path}: not a readable video file, or truncated")
                yield cv2, capture
            finally:
                capture.release()


class VideoWriter:
    """Writes a video file, whole, when it is closed without an error.

    Parameters
    ----------
    path : path
        Ends in .mp4, .mov, .avi (Motion JPEG) or .mkv (lossless).
    fps : float
        Frames a second.
    """

    def __init__(self, path: Path, fps: float) -> None:
        self._path, self._fps = path, fps
        self._folder = tempfile.TemporaryDirectory(prefix="pyibr-")
        self._file = Path(self._folder.name) / f"video{path.suffix.lower()}"
        self._writer: Any = None
        self._count = 0

    def __enter__(self) -> VideoWriter:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if self._writer is not None:
            with _quietly():
                self._writer.release()
        try:
            if kind is None and self._writer is not None:
                self._check()
                write_atomically(self._path, self._file.read_bytes())
        finally:
            self._folder.cleanup()

    def add(self, color: NDArray[Any]) -> None:
        """Add a frame (H, W, 3), uint8, or floats of which [0, 1] become 0 to 255."""
        if color.dtype != np.uint8:
            color = np.rint(np.clip(np.nan_to_num(color), 0, 1) * 255).astype(np.uint8)
        if self._writer is None:
            size = color.shape[1], color.shape[0]
            with _quietly() as cv2:
                code = cv2.VideoWriter_fourcc(*CODECS[self._path.suffix.lower()])
                self._writer = cv2.VideoWriter(_name(self._file), cv2.CAP_FFMPEG, code, self._fps, size)
            if not self._writer.isOpened():
                raise FileFormatError(f"{self._path}: OpenCV cannot write a video of {size[0]}x{size[1]}")
        with _quietly():
            self._writer.write(np.ascontiguousarray(color[..., ::-1]))  # OpenCV's are blue first
        self._count += 1

    def _check(self) -> None:
        """Raise FileFormatError if frames got lost: OpenCV tells nobody of a full disk."""
        try:
            write_atomically(self._file.with_name("room"), bytes(_ROOM))
            is_whole = len(Video(self._file)) == self._count
        except FileFormatError:
            is_whole = False
        if not is_whole:
            place = Path(self._folder.name).parent
            raise FileFormatError(f"{self._path}: cannot be written: frames got lost in {place}, which may be full")


def check_video_output(path: Path) -> None:
    """Raise what writing a video there would raise before the first frame."""
    if path.suffix.lower() not in CODECS:
        raise FileFormatError(f"{path}: no video format {path.suffix} to write; known are {', '.join(sorted(CODECS))}")
    opencv("a video", "VideoWriter", "VideoCapture")
    check_writable(path)


def _name(file: Path) -> str:
    """Name by which OpenCV opens a file: it takes what is before a colon for a protocol, and crashes on no text."""
    name = str(file.absolute())
    try:
        name.encode("utf-8")
    except UnicodeEncodeError:
        raise FileFormatError(f"{file}: OpenCV opens no file whose name is no text in UTF-8") from None
    return name


@contextmanager
def _quietly() -> Generator[Any, None, None]:
    """OpenCV, which opens a file and keeps its and FFmpeg's words to itself, then and later."""
    cv2 = opencv("a video", "VideoWriter", "VideoCapture")
    before = {name: os.environ.get(name) for name in _QUIET}
    level = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    os.environ.update(_QUIET)
    try:
        yield cv2
    finally:
        cv2.utils.logging.setLogLevel(level)
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
