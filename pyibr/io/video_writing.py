"""Videos are written through PyAV, GIFs through Pillow; sound can be copied from another video."""

from __future__ import annotations

import itertools
import logging
import os
from collections.abc import Generator, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from fractions import Fraction
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pyibr.core.checks import describe, positive
from pyibr.core.errors import ArgumentError, FileFormatError
from pyibr.core.files import check_writable, checked_path, written_whole
from pyibr.core.optional import pyav
from pyibr.io.video import LARGE

_log = logging.getLogger("pyibr")

Codec = Literal["h264", "h265", "av1", "vp9", "ffv1"]

_TICKS = 90_000  # per second, for frames with their own times


@dataclass(frozen=True)
class _Encoder:
    """FFmpeg's name of a codec, and its options: hardly visible loss, and fast enough for live recording."""

    name: str
    pixels: dict[int, str]  # formats by bits a channel
    options: dict[str, str] = field(default_factory=dict[str, str])
    halves: bool = True  # colours are kept for every second pixel only, and sizes are even
    gray: dict[int, str] = field(default_factory=dict[int, str])  # formats of gray by bits

    def of(self, frame: NDArray[Any]) -> _Encoder:
        """The encoder for gray if the frame is gray, else this one."""
        return replace(self, pixels=self.gray) if frame.ndim == 2 else self


_ENCODERS = {
    "h264": _Encoder("libx264", {8: "yuv420p", 10: "yuv420p10le"}, {"preset": "veryfast", "crf": "18"}),
    "h265": _Encoder(
        "libx265",
        {8: "yuv420p", 10: "yuv420p10le", 12: "yuv420p12le"},
        {"preset": "veryfast", "crf": "20", "x265-params": "log-level=none"},
    ),
    "av1": _Encoder("libsvtav1", {8: "yuv420p", 10: "yuv420p10le"}, {"preset": "9", "crf": "25"}),
    "vp9": _Encoder(
        "libvpx-vp9", {8: "yuv420p"}, {"deadline": "realtime", "cpu-used": "6", "row-mt": "1", "crf": "24", "b": "0"}
    ),
    "ffv1": _Encoder(
        "ffv1",
        {8: "bgr0", 10: "gbrp10le", 12: "gbrp12le", 16: "gbrp16le"},
        halves=False,
        gray={8: "gray", 16: "gray16le"},
    ),
    "mjpeg": _Encoder("mjpeg", {8: "yuvj420p"}, {"qmin": "2", "qmax": "3"}),
    "webp": _Encoder("libwebp_anim", {8: "yuv420p"}, {"quality": "90", "loop": "0"}, halves=False),
}

CODECS = {
    ".mp4": ("h264", "h265", "av1"),
    ".m4v": ("h264", "h265"),
    ".mov": ("h264", "h265"),
    ".webm": ("vp9", "av1"),
    ".mkv": ("ffv1", "h264", "h265", "av1", "vp9"),
    ".avi": ("mjpeg",),
    ".webp": ("webp",),
    ".gif": ("gif",),
}
"""Codecs for each suffix; the first is the default."""

_CONTAINERS = {".m4v": "mp4", ".mkv": "matroska"}


def write_video(
    path: str | os.PathLike[str],
    frames: Iterable[ArrayLike],
    fps: float,
    *,
    codec: Codec | None = None,
    bits: int = 8,
    sound: str | os.PathLike[str] | None = None,
) -> None:
    """Write frames as a video.

    Parameters
    ----------
    path : path
        Ends in .mp4, .m4v or .mov (H.264 by default, which browsers and notebooks play), .webm (VP9), .mkv (FFV1, which
        loses nothing), .avi (Motion JPEG), .gif or .webp (animated pictures).
    frames : iterable of (H, W, 3) or (H, W) arrays
        uint8, uint16, or floats with [0, 1] from black to white. Each frame is requested when it is written. Odd sizes
        lose their last row or column, except in .mkv, .gif and .webp. FFV1 keeps the values of gray, (H, W), exactly.
    fps : float
        Frames per second.
    codec : {"h264", "h265", "av1", "vp9", "ffv1"}, optional
        Replaces the format's default.
    bits : {8, 10, 12, 16}
        Bits per channel, if the codec supports them.
    sound : path, optional
        A video whose sound is copied unchanged, from its beginning.

    Raises
    ------
    ArgumentError
        If the codec does not fit the format, `bits` does not fit the codec, or frames differ in size.
    FileFormatError
        If the file cannot be written. The old file is then left.
    MissingPackageError
        PyAV is not installed.

    Examples
    --------
    >>> import numpy as np
    >>> import pyibr as ibr
    >>> ibr.write_video("noise.webm", np.random.default_rng(1).random((4, 48, 64, 3)), fps=25)
    """
    place = checked_path(path)
    check_video_output(place, codec, bits)
    with VideoWriter(place, positive("fps", fps, "frames a second > 0"), codec=codec, bits=bits, sound=sound) as video:
        for frame in frames:
            video.add(np.asarray(frame))


class VideoWriter:
    """Writer of a video file, which appears when it is closed; if interrupted, the file holds the complete frames.

    An error leaves the old file. The parameters are as in `write_video`, already checked by `check_video_output`;
    start: time of the first frame in the sound, in seconds.
    """

    def __init__(
        self,
        path: Path,
        fps: float,
        *,
        codec: Codec | None = None,
        bits: int = 8,
        sound: str | os.PathLike[str] | None = None,
        start: float = 0.0,
    ) -> None:
        self._path, self._rate = path, Fraction(fps).limit_denominator(10_000)
        self._suffix = path.suffix.lower()
        self._encoder = _ENCODERS.get(codec or CODECS[self._suffix][0])
        self._bits, self._sound = bits, None if sound is None else (checked_path(sound), Fraction(start))
        self._stack = ExitStack()
        self._file: Any = None
        self._film: _Film | _Gif | None = None
        self._count = 0
        self._shape: tuple[int, ...] = ()

    def __enter__(self) -> VideoWriter:
        self._file = self._stack.enter_context(written_whole(self._path))
        self._stack.push(self._finish)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: Any) -> None:
        if self._film is not None and kind is not None and not issubclass(kind, Exception):
            kind = error = trace = None  # interrupted: the frames so far are complete
        self._stack.__exit__(kind, error, trace)

    def _finish(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is not None:
            return
        if self._film is None:
            raise FileFormatError(f"{self._path}: cannot be written: a video without a frame")
        with _written(self._path):
            self._film.close()

    @property
    def size(self) -> tuple[int, int] | None:
        """Width and height of the film's frames; None before the first, and for animated pictures."""
        return self._film.size if isinstance(self._film, _Film) else None

    def add(self, color: NDArray[Any], time: float | None = None) -> None:
        """Add a frame `time` seconds after the first; pass `time` for all frames, or for none to use the rate."""
        if color.ndim == 2 and (self._encoder is None or self._bits not in self._encoder.gray):
            color = np.repeat(color[..., None], 3, axis=2)
        if self._film is None:
            self._shape = color.shape[:2]
            with _written(self._path):
                if self._encoder is None:
                    self._film = _Gif(self._file, self._rate)
                else:
                    encoder = self._encoder.of(color)
                    self._film = _Film(
                        self._file, self._path, encoder, self._bits, self._shape, self._rate, self._sound
                    )
        if color.shape[:2] != self._shape:
            expected = "x".join(map(str, self._shape[::-1]))
            raise ArgumentError("frames", f"all of one size, {expected}", "x".join(map(str, color.shape[1::-1])))
        with _written(self._path):
            self._film.add(color, Fraction(self._count) / self._rate if time is None else Fraction(time))
        self._count += 1


class _Film:
    """A file written by FFmpeg."""

    def __init__(
        self,
        file: Any,
        path: Path,
        encoder: _Encoder,
        bits: int,
        shape: tuple[int, ...],
        rate: Fraction,
        sound: tuple[Path, Fraction] | None,
    ) -> None:
        self._av, self._stack = pyav(), ExitStack()
        suffix, step = path.suffix.lower(), 2 if encoder.halves else 1
        self._deep, self._halved = bits > 8, encoder.halves
        self._height, self._width = (length // step * step for length in shape)
        self.size = self._width, self._height
        if not self._height or not self._width:
            raise FileFormatError(f"{path}: PyAV cannot write a video of {shape[1]}x{shape[0]}")
        self._container = self._av.open(file, "w", format=_CONTAINERS.get(suffix, suffix[1:]))
        os.environ.setdefault("SVT_LOG", "1")  # else that encoder prints to the terminal
        self._stream = self._container.add_stream(encoder.name, rate=rate, options=dict(encoder.options))
        self._stream.width, self._stream.height = self._width, self._height
        self._stream.pix_fmt = self._pixels = encoder.pixels[bits]
        context = self._stream.codec_context
        self._ticks = rate if suffix == ".avi" else Fraction(_TICKS)  # AVI stores no times
        context.time_base = 1 / self._ticks
        self._duration = round(self._ticks / rate)
        if encoder.name == "libx265" and suffix != ".mkv":
            context.codec_tag = "hvc1"  # Apple's players need this tag
        self._is_large = self._height >= LARGE
        if encoder.halves:
            context.color_range = 2 if self._pixels.startswith("yuvj") else 1
            context.colorspace = 1 if self._is_large else 5
        self._sound = iter(()) if sound is None else self._carried_over(path, *sound)
        self._packet = next(self._sound, None)

    def add(self, color: NDArray[Any], time: Fraction) -> None:
        whole = _in_words(color[..., :3] if color.ndim == 3 else color, 16 if self._deep else 8)
        whole = whole[: self._height, : self._width]
        formats = ("gray", "gray16le") if whole.ndim == 2 else ("rgb24", "rgb48le")
        frame = self._av.VideoFrame.from_ndarray(np.ascontiguousarray(whole), format=formats[self._deep])
        space = "ITU709" if self._is_large else "ITU601"
        frame = frame.reformat(format=self._pixels, dst_colorspace=space if self._halved else None)
        frame.pts, frame.duration, frame.time_base = round(time * self._ticks), self._duration, 1 / self._ticks
        self._hear_until(time + self._duration / self._ticks)
        self._container.mux(self._stream.encode(frame))

    def close(self) -> None:
        packets = self._stream.encode()
        if self._stream.codec_context.name == "libx265" and len(packets) < 3:
            for packet in packets:  # the encoder leaves `dts` unset in so short a film
                packet.dts = packet.pts
        self._container.mux(packets)
        self._container.close()
        self._stack.close()

    def _hear_until(self, time: Fraction) -> None:
        while self._packet is not None and self._packet[0] < time:
            self._container.mux(self._packet[1])
            self._packet = next(self._sound, None)

    def _carried_over(self, path: Path, sound: Path, start: Fraction) -> Iterator[tuple[Fraction, Any]]:
        """Packets of a file's sound with their times, for a new stream, which is added immediately."""
        source = self._stack.enter_context(self._av.open(str(sound)))
        if not source.streams.audio:
            return iter(())
        heard = source.streams.audio[0]
        try:
            stream = self._container.add_stream_from_template(heard)
        except ValueError:
            _log.warning("%s: sound of %s (%s) does not fit there; left out", path, sound, heard.codec.name)
            return iter(())

        def packets() -> Iterator[tuple[Fraction, Any]]:
            ticks = round(start / heard.time_base)
            for packet in source.demux(heard):
                if packet.dts is not None and packet.dts >= ticks:
                    packet.pts, packet.dts, packet.stream = packet.pts - ticks, packet.dts - ticks, stream
                    yield packet.dts * heard.time_base, packet

        return packets()


class _Gif:
    """An animated GIF, written by Pillow, with a palette for each frame."""

    def __init__(self, file: Any, rate: Fraction) -> None:
        self._file, self._rate = file, rate
        self._images: list[Any] = []
        self._times: list[Fraction] = []

    def add(self, color: NDArray[Any], time: Fraction) -> None:
        from PIL import Image

        self._images.append(Image.fromarray(np.ascontiguousarray(_in_words(color, 8)[..., :3])).quantize(256))
        self._times.append(time)

    def close(self) -> None:
        ends = [*self._times[1:], self._times[-1] + 1 / self._rate]
        # A GIF counts hundredths of a second: rounding the end times, not the durations, keeps the total duration.
        marks = [0, *(round(100 * end) for end in ends)]
        durations = [10 * (after - before) for before, after in itertools.pairwise(marks)]
        first, *others = self._images
        first.save(self._file, "GIF", save_all=True, append_images=others, duration=durations, loop=0)


def check_video_output(path: Path, codec: Codec | None = None, bits: int = 8) -> None:
    """Raise the errors of writing a video before its first frame."""
    suffix = path.suffix.lower()
    if suffix not in CODECS:
        raise FileFormatError(f"{path}: no video format {path.suffix} to write; known are {', '.join(sorted(CODECS))}")
    used = codec or CODECS[suffix][0]
    if used not in CODECS[suffix]:
        raise ArgumentError("codec", f"{' or '.join(CODECS[suffix])} for {path}", describe(used))
    if used in _ENCODERS and bits not in _ENCODERS[used].pixels:
        raise ArgumentError("bits", " or ".join(map(str, _ENCODERS[used].pixels)) + f" for {used}", str(bits))
    pyav()
    check_writable(path)


@contextmanager
def _written(path: Path) -> Generator[None, None, None]:
    """Turn FFmpeg's errors into FileFormatError."""
    try:
        yield
    except (FileFormatError, ArgumentError):
        raise
    except Exception as error:
        reason = getattr(error, "strerror", None) or error
        raise FileFormatError(f"{path}: cannot be written: {reason}") from error


def _in_words(color: NDArray[Any], bits: int) -> NDArray[Any]:
    """Channels as integers of 8 or 16 bits, from integers or from floats in [0, 1]."""
    most, dtype = (1 << bits) - 1, np.uint8 if bits == 8 else np.uint16
    if color.dtype == dtype:
        return color
    if color.dtype == np.uint8:
        return color.astype(dtype) * 257
    share = color / 65535 if color.dtype == np.uint16 else np.nan_to_num(color)
    return np.rint(np.clip(share, 0, 1) * most).astype(dtype)
