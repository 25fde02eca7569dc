"""`pyibr orbit`: turntables, camera paths and single pictures of things, as films or numbered pictures."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
import typer
from numpy.typing import ArrayLike

from pyibr.app.commands.exposure import Exposure
from pyibr.app.commands.outputs import Kind, Outputs, VideoOptions
from pyibr.app.commands.progress import with_progress
from pyibr.app.commands.things import ImageOptions, StartCamera, ThingFiles, UpOption, direction_of
from pyibr.app.commands.views import DepthRange
from pyibr.app.options import DeviceName, FillOption, Samples, Size, device_of, fill_of, printable_text
from pyibr.app.view.paths import CameraPath
from pyibr.capture.rigs import RenderOptions, drawn, framed, gathered
from pyibr.capture.turntable import turntable_cameras
from pyibr.core.camera import Camera
from pyibr.core.errors import ArgumentError
from pyibr.images import DepthImage
from pyibr.io import read_cameras
from pyibr.meshes.mesh import Mesh
from pyibr.picture.light import Light
from pyibr.picture.render import Thing

_FRAMES = 72


class Way(NamedTuple):
    """Options of the camera's path."""

    orbit: Annotated[
        float | None,
        typer.Option(metavar="DEGREES", help="Angle by which the camera turns to the right about them; default: 360"),
    ] = None
    swing: Annotated[
        float | None,
        typer.Option(
            metavar="DEGREES", help="Instead: swing to and fro, by this angle to either side; for single photographs"
        ),
    ] = None
    path: Annotated[
        Path | None,
        typer.Option("--path", help="Instead: a smooth path through cameras, as `view` saves it, or as --to"),
    ] = None
    to: Annotated[
        Path | None,
        typer.Option(help="Instead: a picture from this camera, or from each of several, as --to of `warp`"),
    ] = None
    start: StartCamera = None
    size: Size = None

    def count(self, frames: int | None) -> int:
        """Return the number of pictures; raise an error if options contradict each other or hold no cameras."""
        given = [f"--{name}" for name in ("orbit", "swing", "path", "to") if getattr(self, name) is not None]
        given += ["--start"] if (self.path or self.to) and self.start else []
        given += ["--frames"] if self.to and frames else []
        if len(given) > 1:
            raise ArgumentError(given[1], f"none together with {given[0]}", "one")
        self._given()
        return frames or (_FRAMES if self.to is None else len(read_cameras(self.to)))

    def _given(self) -> tuple[CameraPath | None, Camera | None]:
        path = None if self.path is None else CameraPath(list(read_cameras(self.path).values()))
        return path, None if self.start is None else Camera.load(self.start)

    def cameras(self, things: Sequence[Thing], frames: int, up: ArrayLike | None) -> list[Camera]:
        """Return a camera for each picture."""
        path, first = self._given()
        if self.to is not None:
            made = list(read_cameras(self.to).values())
        elif path is not None:
            made = [path.at(float(time)) for time in np.linspace(0, path.seconds, frames)]
        else:
            turn = 360.0 if self.orbit is None else self.orbit
            made = turntable_cameras(things, frames, first, turn=turn, swing=self.swing, up=up)
        return [framed(camera, self.size or camera.size) for camera in made]


def orbit(
    things: ThingFiles,
    output: Annotated[Path, typer.Option("--output", "-o", help="A video; or pictures OUT_0000, ...")],
    frames: Annotated[
        int | None, typer.Option(min=1, max=100_000, help="Number of pictures along the path; default: 72")
    ] = None,
    *,
    way: Way,
    depth_out: Annotated[Path | None, typer.Option(help="Also write the depth of the pictures")] = None,
    up: UpOption = None,
    fill: FillOption = "background",
    samples: Samples = 1,
    options: ImageOptions,
    video: VideoOptions,
    device: DeviceName = None,
) -> None:
    """Draw things from all round, in a swing to and fro, or along a path. Meshes without colours are lit."""
    count = way.count(frames)
    written: dict[str, tuple[Path | None, Kind]] = {"--output": (output, "color"), "--depth-out": (depth_out, "depth")}
    outputs = Outputs(written, options.stored, range(count) if count > 1 else None, video)
    files = [file for thing in things for file in (thing.rglob("*") if thing.is_dir() else [thing])]
    read = {"--camera": options.camera, "--to": way.to, "--path": way.path, "--start": way.start}
    outputs.check({"THINGS": files, **{name: [file] for name, file in read.items() if file}}, things)
    with device_of(device), outputs, Exposure(options.exposure) as exposed:
        known, customary = options.things(things, exposed)
        cameras = way.cameras(known, count, direction_of(up or customary))
        is_plain = any(isinstance(one, Mesh) and one.colors is None and one.texture is None for one in known)
        shown = gathered(known, fill_of(fill), cameras)
        for number, one in enumerate(with_progress(cameras, count, "Drawing")):
            how: RenderOptions = {"samples": samples, "light": _light_of(one)} if is_plain else {"samples": samples}
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", UserWarning)  # empty pictures are reported at the end
                (frame,) = drawn(shown, [one], **how)
            outputs.write({"color": frame.color, "depth": frame.depth}, number, float(frame.valid.mean()), one)
    views, seen = [one for one in known if isinstance(one, DepthImage)], DepthRange()
    for view in views:
        seen.add(view.known_depth)
    outputs.tell("pictures", f"{printable_text(things[0])} is out of view", seen if views else "")


def _light_of(camera: Camera) -> Light:
    """A light over the camera's left shoulder, which moves with it, so that no side stays dark."""
    return Light(direction=camera.world_from_camera[:3, :3] @ (0.4, 0.5, 1), ambient=0.3, shadow_size=0)
