"""Depth of many frames in one file: a gray video, or an array in NPY or NPZ. Frames are read one at a time."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any
from zipfile import ZipFile

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera
from pyibr.core.checks import one_of
from pyibr.core.errors import FileFormatError
from pyibr.core.files import check_unpacked, checked_path, reading
from pyibr.io import DepthKind, DepthReading, arrays, depth_kinds
from pyibr.io.recordings import Recording, Stored, check_numbers
from pyibr.io.video import SUFFIXES, Video

if TYPE_CHECKING:
    from typing_extensions import Unpack

_ARRAYS = (".npy", ".npz")
FRAME_SUFFIXES = (*SUFFIXES, *_ARRAYS)
"""Suffixes of files that may hold the depth of several frames."""

_Depth = NDArray[np.float32]


class DepthFrames:
    """The depth of each frame of a file.

    Parameters
    ----------
    path : path
        A video in gray of 8, 10, 12 or 16 bits, or with the numbers in its green channel; or NPY or NPZ with an array
        (N, H, W), which may have axes of length 1.
    channel : str, optional
        Name of the array in an NPZ; default: the only one, or "depth". Title or number of a video's track.

    Raises
    ------
    FileFormatError
        If there is no such file, or it holds something else.

    Attributes
    ----------
    path : Path
    source : Video, or an array
        The file that the frames are read from.

    Examples
    --------
    >>> import numpy as np
    >>> import pyibr as ibr
    >>> from pyibr.io.depth_frames import DepthFrames
    >>> ibr.write_video("depth.mkv", (np.full((48, 64), 500 * n, np.uint16) for n in range(4)), fps=30, bits=16)
    >>> frames = DepthFrames("depth.mkv")
    >>> len(frames), [float(depth[0, 0]) for depth in frames.read([1, 3], depth_scale=1000)]
    (4, [0.5, 1.5])
    """

    def __init__(self, path: str | os.PathLike[str], channel: str | None = None) -> None:
        self.path = checked_path(path)
        is_video = self.path.suffix.lower() in SUFFIXES
        self.source: Video | _Array = Video(self.path, channel, "depth") if is_video else _Array(self.path, channel)
        self._running: tuple[int, Iterator[NDArray[Any]]] = 0, iter(())

    def __len__(self) -> int:
        return len(self.source)

    @property
    def fps(self) -> float | None:
        """Frames per second, or None if the file lacks the rate."""
        return self.source.fps if isinstance(self.source, Video) else None

    def read(
        self, numbers: Iterable[int], camera: Camera | None = None, **how: Unpack[DepthReading]
    ) -> Iterator[_Depth]:
        """(H, W) planar depth of the frames with these increasing numbers; options as in `read_depth`."""
        for number in numbers:
            yield self.read_one(number, camera, how)

    def read_one(self, number: int, camera: Camera | None, how: DepthReading) -> _Depth:
        """Planar depth of a frame; fast for the frame after the last one read."""
        kind = how.get("depth_kind", "z")
        one_of("depth_kind", kind, DepthKind)
        stored = values = self._stored(number)
        if kind != "relative":
            values = depth_kinds.scaled(stored, how.get("depth_scale"), how.get("depth_offset", 0.0), self.path)
        if kind == "z":
            depth_kinds.warn_of_relative(stored, self.path)
        return depth_kinds.planar(values, kind, camera, self.path, how.get("near", 1.0), how.get("far", 10.0))

    def _stored(self, number: int) -> NDArray[Any]:
        """The frame as stored; frames since the last one read are skipped."""
        at, frames = self._running
        if number < at or at == 0:
            at, frames = number, self.source.gray(range(number, len(self)))
        for _ in range(at, number):
            next(frames)
        self._running = number + 1, frames
        return next(frames)


class _Array:
    """An array (N, H, W), read one frame at a time."""

    def __init__(self, path: Path, channel: str | None) -> None:
        self._path, self._channel = path, channel
        with reading(path, "NumPy") as source:
            self._mapped: NDArray[Any] | None = None
            if source.suffix.lower() == ".npy":
                mapped: NDArray[Any] = np.load(source, mmap_mode="r", allow_pickle=False)
                self._mapped, shape, self._dtype = mapped, mapped.shape, mapped.dtype
            else:
                with ZipFile(source) as packed, self._opened(packed) as stream:
                    shape, by_columns, self._dtype = arrays.header_of(stream)
                    if by_columns:
                        raise ValueError("its array is in Fortran order")
        lengths = [length for length in shape if length != 1]
        self.is_image = len(lengths) == 2
        self._shape = [1, *lengths] if self.is_image else lengths
        if len(self._shape) != 3 or self._dtype.kind not in "uif" or 0 in self._shape:
            raise FileFormatError(f"{path}: expected depth of shape (N, H, W), got {self._dtype} of {tuple(shape)}")

    def __len__(self) -> int:
        return self._shape[0]

    def gray(self, numbers: Iterable[int]) -> Iterator[NDArray[Any]]:
        """(H, W) of the frames with these numbers, which must be increasing."""
        if self._mapped is not None:
            stack = self._mapped.reshape(self._shape)
            yield from (np.array(stack[number]) for number in numbers)
            return
        size = math.prod(self._shape[1:]) * self._dtype.itemsize
        check_unpacked(size)
        with reading(self._path, "NumPy") as source, ZipFile(source) as packed, self._opened(packed) as stream:
            arrays.header_of(stream)
            first = stream.tell()
            for number in numbers:
                stream.seek(first + number * size)  # continues from its position
                data = stream.read(size)
                if len(data) < size:
                    raise FileFormatError(f"{self._path}: truncated: frame {number} cannot be read")
                yield np.frombuffer(data, self._dtype).reshape(self._shape[1:])

    def _opened(self, packed: ZipFile) -> IO[bytes]:
        return packed.open(arrays.member_of(self._path, packed, "depth", self._channel))


@dataclass(frozen=True)
class OfFile(Stored):
    """A frame of a file that holds the depth of several frames."""

    frames: DepthFrames | None = None
    number: int = 0

    def read_depth(self, path: Path, camera: Camera | None, how: DepthReading) -> _Depth:
        assert self.frames is not None
        return self.frames.read_one(self.number, camera, {**how, "depth_scale": how.get("depth_scale") or self.scale})


def frames_in(path: Path, channel: str | None = None) -> DepthFrames | None:
    """The frames of a file; None if it holds a single image."""
    suffix = path.suffix.lower()
    if suffix not in FRAME_SUFFIXES or (suffix in _ARRAYS and _Array(path, channel).is_image):
        return None
    return DepthFrames(path, channel)


def recorded(colors: Sequence[Path], frames: DepthFrames, video: Path | None = None) -> Recording:
    """A recording of a depth file's frames in order, with a picture for each, one video for all, or none."""
    if colors:
        check_numbers(len(colors), len(frames), str(frames.path))
    stored = [OfFile(frames=frames, number=number) for number in range(len(frames))]
    return Recording(list(colors), [frames.path] * len(frames), stored=stored, video=video)
