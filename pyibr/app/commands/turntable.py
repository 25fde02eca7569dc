"""Pictures of things from given cameras, or on a turntable."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
import typer

import pyibr as ibr
from pyibr.app.commands.outputs import Outputs, VideoOptions
from pyibr.app.commands.progress import with_progress
from pyibr.app.commands.things import Up, UpOption, direction_of
from pyibr.app.options import Samples, Size, StoredDepth
from pyibr.capture.rigs import framed
from pyibr.core.camera import Camera
from pyibr.core.checks import Float64
from pyibr.core.errors import ArgumentError
from pyibr.images.pictures import camera_before
from pyibr.io import read_cameras
from pyibr.picture.light import Light
from pyibr.picture.render import Thing


class TurntableOptions(NamedTuple):
    """Options of the cameras and of the sampling."""

    to: Annotated[
        Path | None,
        typer.Option(help="The picture's camera, or several, as --camera of `warp`; default: chosen automatically"),
    ] = None
    orbit: Annotated[
        float, typer.Option(metavar="DEGREES", help="Angle of the turn by --frames about the thing's middle")
    ] = 360.0
    frames: Annotated[
        int, typer.Option(min=1, max=100_000, help="Number of pictures of a turntable, the first from the camera")
    ] = 1
    size: Size = None
    up: UpOption = None
    samples: Samples = 1


class Turntable:
    """A picture, numbered pictures or a video of a thing; options are checked before any work.

    inputs: files that are read, by option.
    """

    def __init__(
        self, output: Path, turn: TurntableOptions, video: VideoOptions, inputs: Mapping[str, Sequence[Path]]
    ) -> None:
        self._cameras = [] if turn.to is None else list(read_cameras(turn.to).values())
        if len(self._cameras) > 1 and turn.frames > 1:
            raise ArgumentError("--frames", f"1 with the {len(self._cameras)} cameras of --to", str(turn.frames))
        self._turn, count = turn, max(turn.frames, len(self._cameras))
        numbers = range(count) if count > 1 else None
        self._outputs = Outputs({"--output": (output, "color")}, StoredDepth(), numbers, video)
        self._outputs.check({**inputs, "--to": [] if turn.to is None else [turn.to]})

    def draw(
        self,
        thing: Thing,
        ball: tuple[Float64, float],
        *,
        start: Camera | None = None,
        up: Up | None = None,
        light: Callable[[Camera], Light | None] = lambda _: None,
        anisotropy: int = 1,
    ) -> None:
        """Draw the pictures and report them.

        Parameters
        ----------
        thing : thing
        ball : (3,), float
            Middle and radius of a ball that contains the thing; the turntable turns about the middle.
        start, up
            The first camera, and up in the world, unless options set them; by default a camera that sees the ball
            obliquely from above, and the first camera's up direction.
        light : callable
            Returns the light for a camera.
        anisotropy : int
            As for `pyibr.render`.
        """
        turn, (middle, radius) = self._turn, ball
        axis = direction_of(turn.up or up)
        if start is None or turn.up:
            width, height = turn.size or (1, 1)
            corner = radius * max(1.0, height / max(width, 1)) / np.sqrt(3)  # of a cube
            start = camera_before(middle - corner, middle + corner, np.array(axis or (0.0, -1.0, 0.0)))
        cameras = self._cameras or [start]
        cameras = cameras if turn.size is None else [framed(one, turn.size) for one in cameras]
        if turn.frames > 1:
            step = turn.orbit / turn.frames
            cameras = [cameras[0].orbited(step * number, middle, axis=axis) for number in range(turn.frames)]
        with self._outputs as outputs:
            for number, camera in enumerate(with_progress(cameras, len(cameras), "Drawing")):
                frame = ibr.render(thing, camera, light(camera), samples=turn.samples, anisotropy=anisotropy)
                outputs.write({"color": frame.color}, number, float(frame.valid.mean()), camera)
        outputs.tell("views", "the thing is out of view")
