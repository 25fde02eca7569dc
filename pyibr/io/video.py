"""Videos are read through PyAV: all formats and codecs of FFmpeg, with colours, orientation and times as in players."""

from __future__ import annotations

import os
from collections.abc import Generator, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.core.errors import FileFormatError
from pyibr.core.files import checked_path, reading
from pyibr.core.optional import pyav

SUFFIXES = (".avi", ".m4v", ".mkv", ".mov", ".mp4", ".mpeg", ".mpg", ".ts", ".webm", ".wmv")
"""Suffixes that are read as videos."""

LARGE = 720
"""Rows from which players assume HDTV's colours, unless the file names a standard."""


def first_frame(path: Path) -> NDArray[np.uint8]:
    """The first picture of a video."""
    return next(Video(path).frames([0]))


class Video:
    """The frames of a video, as players show them: rotated if the file says so.

    Parameters
    ----------
    path : path

    Raises
    ------
    FileFormatError
        If there is no such file, or FFmpeg cannot read it as a video.
    MissingPackageError
        PyAV is not installed.

    Attributes
    ----------
    path : Path
    fps : float or None
        Average number of frames per second, if the file has it.
    times : list of float
        Times of the frames, in seconds from the first.
    has_sound : bool

    Examples
    --------
    >>> import numpy as np
    >>> import pyibr as ibr
    >>> ibr.write_video("gray.mp4", (np.full((48, 64, 3), 10 * n, np.uint8) for n in range(5)), fps=10)
    >>> video = ibr.Video("gray.mp4")
    >>> len(video), video.fps, [frame.shape for frame in video][0]
    (5, 10.0, (48, 64, 3))
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = checked_path(path)
        with self._opened() as (container, stream):
            rate, tick_length = stream.average_rate or stream.guessed_rate, stream.time_base
            self.fps = float(rate) if rate else None
            self.has_sound = bool(container.streams.audio)
            ticks = [packet.pts for packet in container.demux(stream) if packet.size and not packet.is_discard]
        if not ticks:
            raise FileFormatError(f"{path}: not a readable video file, or truncated: no frame in it")
        if None in ticks:
            self.times = [number / (self.fps or 30.0) for number in range(len(ticks))]
        else:
            first, *_ = ticks = sorted(ticks)
            self.times = [float((tick - first) * tick_length) for tick in ticks]

    def __len__(self) -> int:
        return len(self.times)

    def __iter__(self) -> Iterator[NDArray[np.uint8]]:
        return self.frames(range(len(self)))

    def frames(self, numbers: Iterable[int]) -> Iterator[NDArray[np.uint8]]:
        """(H, W, 3) uint8 of the frames with these numbers, which must be increasing."""
        for frame in self._frames(numbers):
            yield _turned(frame, frame.to_ndarray(format="rgb24", src_colorspace=_colorspace(frame)))

    def gray(self, numbers: Iterable[int]) -> Iterator[NDArray[np.uint16]]:
        """(H, W) uint16 of frames that hold numbers, such as depth: 0 to 255, 1023, 4095 or 65535, by the file's bits.

        Gray formats are read as stored; from other formats the green channel is read, as players show it.
        """
        for frame in self._frames(numbers):
            if frame.format.name.startswith("gray"):
                yield _turned(frame, frame.to_ndarray().astype(np.uint16))
                continue
            most = (1 << frame.format.components[0].bits) - 1
            values = frame.to_ndarray(format="rgb48le", src_colorspace=_colorspace(frame))[..., 1].astype(np.uint32)
            yield _turned(frame, ((values * most + 32767) // 65535).astype(np.uint16))

    def _frames(self, numbers: Iterable[int]) -> Iterator[Any]:
        with self._opened() as (container, stream):
            decoded = enumerate(container.decode(stream))
            for number in numbers:
                frame = next((frame for at, frame in decoded if at == number), None)
                if frame is None:
                    raise FileFormatError(f"{self.path}: truncated: frame {number} cannot be read")
                yield frame

    @contextmanager
    def _opened(self) -> Generator[tuple[Any, Any], None, None]:
        av = pyav()
        with reading(self.path, "video") as source, source.open("rb") as file:
            try:
                container = av.open(file)
                stream = container.streams.video[0]
            except (av.FFmpegError, IndexError):
                raise FileFormatError(f"{self.path}: not a readable video file, or truncated") from None
            with container:
                stream.thread_type = "AUTO"
                yield container, stream


def _colorspace(frame: Any) -> str | None:
    """The colour standard that players assume, if the file names none."""
    told = frame.colorspace
    return None if told != 2 else "ITU709" if frame.height >= LARGE else "ITU601"


def _turned(frame: Any, pixels: NDArray[Any]) -> NDArray[Any]:
    return np.ascontiguousarray(np.rot90(pixels, round(frame.rotation / 90)))  # lines of frames may have padding
