"""The files that commands write: checked before the work, one or numbered, pictures or a video."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path

import pyibr as ibr
from pyibr.core.checks import positive
from pyibr.core.errors import ArgumentError
from pyibr.core.files import check_writable, identity
from pyibr.io import check_output
from pyibr.io.video import CODECS, VideoWriter, check_video_output

_FPS = 30.0  # of videos, if nothing tells


class Outputs:
    """What `warp` writes: a view's picture, depth and mask; of several views numbered files, or a video and these.

    Parameters
    ----------
    color, depth, valid : Path, or None
        --output, --depth-out and --valid-out.
    scale : float, or None
        --depth-scale.
    count : int, or None
        How many views there are; None for one, which has no number.
    fps, source_fps : float, or None
        --fps, and what the source has.
    """

    def __init__(
        self,
        color: Path,
        depth: Path | None,
        valid: Path | None,
        scale: float | None,
        count: int | None,
        fps: float | None,
        source_fps: float | None,
    ) -> None:
        self._color, self._depth, self._valid = color, depth, valid
        self._scale, self._count = scale, count
        self._is_video = count is not None and color.suffix.lower() in CODECS
        if fps is not None and not self._is_video:
            raise ArgumentError("--fps", f"a video of several views ({', '.join(CODECS)}) for --output", str(color))
        self._fps = source_fps or _FPS if fps is None else positive("--fps", fps, "frames a second > 0")
        self._stack = ExitStack()
        self._writer: VideoWriter | None = None

    def check(self, inputs: Mapping[str, Sequence[Path]]) -> None:
        """Raise what writing them would raise, before anything is computed; inputs: files that are read, by option."""
        if self._depth is not None and self._depth.suffix.lower() == ".png" and self._scale is None:
            expected = f"stored units per scene unit, for the integers of {self._depth}"
            raise ArgumentError("--depth-scale", expected, "none")
        if self._is_video:
            check_video_output(self._color)
        else:
            check_output(self._color, "color")
        if self._depth is not None:
            check_output(self._depth, "depth")
        if self._valid is not None:
            check_output(self._valid, "mask")
        named = {"--depth-out": self._names(self._depth), "--valid-out": self._names(self._valid)}
        check_outputs(inputs, {"--output": [self._color] if self._is_video else self._names(self._color), **named})

    def __enter__(self) -> Outputs:
        return self

    def __exit__(self, *error: object) -> None:
        self._stack.__exit__(*error)  # pyright: ignore[reportArgumentType]

    def write(self, frame: ibr.Frame, number: int) -> Path:
        """Write a frame; return the name of its picture."""
        name = self._color
        if self._is_video:
            if self._writer is None:
                self._writer = self._stack.enter_context(VideoWriter(name, self._fps))
            self._writer.add(frame.color)
        else:
            name = self._name(name, number)
            ibr.write_color(name, frame.color)
        if self._depth is not None:
            ibr.write_depth(self._name(self._depth, number), frame.depth, self._scale)
        if self._valid is not None:
            ibr.write_mask(self._name(self._valid, number), frame.valid)
        return name

    def _names(self, path: Path | None) -> list[Path]:
        return [] if path is None else [self._name(path, number) for number in range(self._count or 1)]

    def _name(self, path: Path, number: int) -> Path:
        return path if self._count is None else path.with_name(f"{path.stem}_{number:04d}{path.suffix}")


def check_outputs(inputs: Mapping[str, Sequence[Path]], outputs: Mapping[str, Sequence[Path]]) -> None:
    """Raise ArgumentError if a file that is written would be one that is read, or be written twice."""
    taken = {identity(path): option for option, paths in inputs.items() for path in paths}
    for option, paths in outputs.items():
        for path in paths:
            other = taken.get(identity(path))
            if other is not None:
                raise ArgumentError(option, "a file of its own", f"{path}, which is {other}'s too")
            taken[identity(path)] = option
            check_writable(path)
