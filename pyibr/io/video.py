"""Videos are read through PyAV: all formats and codecs of FFmpeg, with colours, orientation and times as in players."""

from __future__ import annotations

import os
import re
from collections.abc import Generator, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pyibr.core.errors import FileFormatError
from pyibr.core.files import checked_path, reading
from pyibr.core.optional import pyav
from pyibr.io.folders import choose, kind_of

SUFFIXES = (".avi", ".m4v", ".mkv", ".mov", ".mp4", ".mpeg", ".mpg", ".ts", ".webm", ".wmv")
"""Suffixes that are read as videos."""

LARGE = 720
"""Rows from which players assume HDTV's colours, unless the file names a standard."""


def first_frame(path: Path) -> NDArray[np.uint8]:
    """The first picture of a video."""
    return next(Video(path).frames([0]))


@contextmanager
def opened(path: Path) -> Generator[Any, None, None]:
    """PyAV's container of a file with a track of pictures."""
    av = pyav()
    with reading(path, "video") as source, source.open("rb") as file:
        try:
            container = av.open(file)
            container.streams.video[0]
        except (av.FFmpegError, IndexError):
            raise FileFormatError(f"{path}: not a readable video file, or truncated") from None
        with container:
            yield container


def tracks_of(container: Any, kind: Literal["depth", "color"]) -> dict[str, int]:
    """Number and title of each track, except covers, with its misfit for `choose` by its pixels: gray is depth."""
    found = dict[str, int]()
    for number, stream in enumerate(container.streams.video):
        title, pixels = stream.metadata.get("title", ""), getattr(stream, "pix_fmt", None) or ""
        is_gray, of_depth = pixels.startswith("gray"), re.match(r"gray(f|\d)", pixels) is not None
        misfit = 0 if of_depth else 1 if is_gray or kind_of(title) == "depth" else 2
        if not stream.disposition & stream.disposition.attached_pic:
            found[f"{number} {title}".strip()] = misfit if kind == "depth" else int(is_gray)
    return found or {"0": 0}


class Video:
    """The frames of a video, as players show them: rotated if the file says so.

    Parameters
    ----------
    path : path
    track : str or int, optional
        Title or number of the track. By default, title and pixel format decide among several; the choice is reported.
    kind : {"color", "depth"}

    Raises
    ------
    FileFormatError
        If there is no such file, or FFmpeg cannot read it as a video.
    MissingPackageError
        PyAV is not installed.

    Attributes
    ----------
    path : Path
    start : float
        Time of the first frame in the file, in seconds.
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

    def __init__(
        self,
        path: str | os.PathLike[str],
        track: str | int | None = None,
        kind: Literal["color", "depth"] = "color",
    ) -> None:
        self.path = checked_path(path)
        with opened(self.path) as container:
            self._track = int(choose(self.path, kind, tracks_of(container, kind), track).split()[0])
            stream = container.streams.video[self._track]
            rate, tick_length = stream.average_rate or stream.guessed_rate, stream.time_base
            self.fps = float(rate) if rate else None
            self.has_sound = bool(container.streams.audio)
            ticks = [packet.pts for packet in container.demux(stream) if packet.size and not packet.is_discard]
        if not ticks:
            raise FileFormatError(f"{path}: not a readable video file, or truncated: no frame in it")
        self.start = 0.0
        if None in ticks:
            self.times = [number / (self.fps or 30.0) for number in range(len(ticks))]
        else:
            first, *_ = ticks = sorted(ticks)
            self.times = [float((tick - first) * tick_length) for tick in ticks]
            self.start = float(first * tick_length)

    def __len__(self) -> int:
        return len(self.times)

    def __iter__(self) -> Iterator[NDArray[np.uint8]]:
        return self.frames(range(len(self)))

    def frames(self, numbers: Iterable[int]) -> Iterator[NDArray[np.uint8]]:
        """(H, W, 3) uint8 of the frames with these numbers, which must be increasing."""
        for frame in self._frames(numbers):
            yield _turned(frame, frame.to_ndarray(format="rgb24", src_colorspace=_colorspace(frame)))

    def gray(self, numbers: Iterable[int]) -> Iterator[NDArray[Any]]:
        """(H, W) of frames that hold numbers, such as depth: uint8, or uint16 to 1023, 4095 or 65535, by their bits.

        Gray formats are read as stored; from other formats the green channel is read, as players show it.
        """
        for frame in self._frames(numbers):
            most = (1 << frame.format.components[0].bits) - 1
            kind = np.uint8 if most < 256 else np.uint16
            if frame.format.name.startswith("gray"):
                yield _turned(frame, frame.to_ndarray().astype(kind))
                continue
            values = frame.to_ndarray(format="rgb48le", src_colorspace=_colorspace(frame))[..., 1].astype(np.uint32)
            yield _turned(frame, ((values * most + 32767) // 65535).astype(kind))

    def _frames(self, numbers: Iterable[int]) -> Iterator[Any]:
        with opened(self.path) as container:
            stream = container.streams.video[self._track]
            stream.thread_type = "AUTO"
            decoded = enumerate(container.decode(stream))
            for number in numbers:
                frame = next((frame for at, frame in decoded if at == number), None)
                if frame is None:
                    raise FileFormatError(f"{self.path}: truncated: frame {number} cannot be read")
                yield frame


def _colorspace(frame: Any) -> str | None:
    """The colour standard that players assume, if the file names none."""
    told = frame.colorspace
    return None if told != 2 else "ITU709" if frame.height >= LARGE else "ITU601"


def _turned(frame: Any, pixels: NDArray[Any]) -> NDArray[Any]:
    return np.ascontiguousarray(np.rot90(pixels, round(frame.rotation / 90)))  # lines of frames may have padding
