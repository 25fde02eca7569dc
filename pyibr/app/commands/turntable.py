"""Pictures of things from cameras that are told, or on a turntable."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, NamedTuple

import typer
from numpy.typing import ArrayLike

import pyibr as ibr
from pyibr.app.commands.outputs import Outputs, VideoOptions
from pyibr.app.commands.progress import with_progress
from pyibr.app.options import Samples, StoredDepth
from pyibr.core.camera import Camera
from pyibr.core.errors import ArgumentError
from pyibr.io import read_cameras
from pyibr.picture.light import Light
from pyibr.picture.render import Thing


class TurntableOptions(NamedTuple):
    """Options of where pictures are taken from, and how finely."""

    to: Annotated[
        Path | None,
        typer.Option(help="The picture's camera, or several, as --camera of `warp`; default: chosen"),
    ] = None
    orbit: Annotated[float, typer.Option(metavar="DEGREES", help="How far --frames turn about the thing's middle")] = (
        360.0
    )
    frames: Annotated[
        int, typer.Option(min=1, max=100_000, help="Pictures of a turntable, the first from the camera")
    ] = 1
    samples: Samples = 1


class Turntable:
    """Pictures of a thing, one, several or a video: what is asked for is checked before any work.

    Parameters
    ----------
    output : path
        Of the picture, of numbered ones, or of a video.
    turn : TurntableOptions
    video : VideoOptions
    inputs : mapping
        Files that are read, by option.
    """

    def __init__(
        self, output: Path, turn: TurntableOptions, video: VideoOptions, inputs: Mapping[str, Sequence[Path]]
    ) -> None:
        self._cameras = [] if turn.to is None else list(read_cameras(turn.to).values())
        if len(self._cameras) > 1 and turn.frames > 1:
            raise ArgumentError("--frames", f"1 with the {len(self._cameras)} cameras of --to", str(turn.frames))
        self._turn, count = turn, max(turn.frames, len(self._cameras))
        numbers = range(count) if count > 1 else None
        self._outputs = Outputs({"--output": (output, "color")}, StoredDepth(), numbers, video, None)
        self._outputs.check({**inputs, "--to": [] if turn.to is None else [turn.to]})

    def draw(
        self,
        thing: Thing,
        start: Camera,
        middle: ArrayLike,
        *,
        axis: ArrayLike | None = None,
        light: Light | None = None,
        anisotropy: int = 1,
    ) -> None:
        """Draw the pictures, and say so: from `start`, unless a camera is told, about an axis through the middle."""
        turn, cameras = self._turn, self._cameras or [start]
        if turn.frames > 1:
            step = turn.orbit / turn.frames
            cameras = [cameras[0].orbited(step * number, middle, axis=axis) for number in range(turn.frames)]
        with self._outputs as outputs:
            for number, camera in enumerate(with_progress(cameras, len(cameras), "Drawing")):
                frame = ibr.render(thing, camera, light, samples=turn.samples, anisotropy=anisotropy)
                outputs.write({"color": frame.color}, number, float(frame.valid.mean()), camera)
        outputs.tell(cameras[0].size, "views", "its camera sees nothing of it")
