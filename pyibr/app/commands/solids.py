"""`pyibr object` and `pyibr hull`: solids from images all round, as pictures or as meshes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

import pyibr as ibr
from pyibr.app.commands.outputs import Outputs, VideoOptions, check_outputs
from pyibr.app.options import (
    DeviceName,
    StoredDepth,
    device_of,
    printable_text,
    with_progress,
)
from pyibr.capture.sets import SET_FILE
from pyibr.core.errors import ArgumentError
from pyibr.images import DepthImage
from pyibr.images.silhouette import Silhouette
from pyibr.io import read_cameras
from pyibr.io.image import read_mask
from pyibr.io.layouts import find_recording
from pyibr.io.recordings import cameras_of, paired, posed
from pyibr.meshes.files import check_mesh_file, is_mesh_file
from pyibr.slicing import DepthObject, VisualHull
from pyibr.slicing.solid import Missing

_Output = Annotated[
    Path,
    typer.Option("--output", "-o", help="A picture; of --frames OUT_0000, ... or a video; or a mesh: GLB, OBJ, PLY"),
]
_To = Annotated[Path | None, typer.Option(help="The picture's camera, or several: JSON; default: the first view's")]
_Orbit = Annotated[float, typer.Option(metavar="DEGREES", help="How far --frames turn about the solid's middle")]
_Frames = Annotated[int, typer.Option(min=1, max=100_000, help="Pictures of a turntable, the first from the camera")]
_Resolution = Annotated[int, typer.Option(help="Of a mesh: cells along the solid's longest edge")]
_Samples = Annotated[int, typer.Option(help="A pixel: 1, 4, 9, 16 ...; several make silhouettes smooth")]
_Views = Annotated[
    Path, typer.Argument(metavar="VIEWS", help="A folder of pictures, their depth and cameras: a set, or a recording")
]


def object_(
    views: _Views,
    output: _Output,
    to: _To = None,
    orbit: _Orbit = 360.0,
    frames: _Frames = 1,
    resolution: _Resolution = 128,
    samples: _Samples = 1,
    missing: Annotated[
        Missing, typer.Option(help="What pixels without depth say: nothing there, or nothing")
    ] = "empty",
    *,
    stored: StoredDepth,
    video: VideoOptions,
    device: DeviceName = None,
) -> None:
    """Make a solid of depth images all round, and draw it, on a turntable, or write its mesh."""
    writer = _Writer([views], output, to, orbit, frames, resolution, samples, video)
    with device_of(device):
        writer.write(DepthObject(stored.load(views), missing=missing))


def hull(
    views: Annotated[
        Path, typer.Argument(metavar="PICTURES", help="A folder of pictures, with alpha; or VIEWS as of `object`")
    ],
    output: _Output,
    masks: Annotated[
        Path | None, typer.Argument(metavar="MASKS", help="A folder of masks, not black where the thing is")
    ] = None,
    camera: Annotated[
        Path | None, typer.Option(help="Of the pictures: a list, a folder, a COLMAP model; default: JSON beside them")
    ] = None,
    to: _To = None,
    orbit: _Orbit = 360.0,
    frames: _Frames = 1,
    resolution: _Resolution = 128,
    samples: _Samples = 1,
    *,
    stored: StoredDepth,
    video: VideoOptions,
    device: DeviceName = None,
) -> None:
    """Make the largest solid that fits into silhouettes, and draw it, on a turntable, or write its mesh."""
    writer = _Writer([views, *([masks] if masks else [])], output, to, orbit, frames, resolution, samples, video)
    with device_of(device):
        writer.write(VisualHull(_silhouettes(views, masks, camera, stored)))


class _Writer:
    """Options of what is made of a solid, checked before any work."""

    def __init__(
        self,
        folders: Sequence[Path],
        output: Path,
        to: Path | None,
        orbit: float,
        frames: int,
        resolution: int,
        samples: int,
        video: VideoOptions,
    ) -> None:
        self._output, self._resolution, self._samples = output, resolution, samples
        self._is_mesh = is_mesh_file(output)
        for option, given in (
            ("--to", to is not None),
            ("--frames", frames > 1),
            ("--fps", video.fps is not None),
            ("--codec", video.codec is not None),
        ):
            if self._is_mesh and given:
                raise ArgumentError(option, "a picture or a video for --output", str(output))
        self._cameras = None if to is None else list(read_cameras(to).values())
        if self._cameras is not None and len(self._cameras) > 1 and frames > 1:
            raise ArgumentError("--frames", f"1 with the {len(self._cameras)} cameras of --to", str(frames))
        self._turns = orbit / frames * np.arange(frames)
        count = max(frames, len(self._cameras or ()))
        self._outputs: Outputs | None = None
        read = [file for folder in folders for file in folder.rglob("*")]
        inputs = {"VIEWS": read, "--to": [] if to is None else [to]}
        if self._is_mesh:
            check_mesh_file(output, textured=False, colored=True)
            check_outputs(inputs, {"--output": [output]})
        else:
            self._outputs = Outputs(
                {"--output": (output, "color")}, StoredDepth(), range(count) if count > 1 else None, video, None
            )
            self._outputs.check(inputs)

    def write(self, solid: DepthObject | VisualHull) -> None:
        """Write the mesh or the pictures, and say so."""
        if self._outputs is None:
            mesh = solid.to_mesh(self._resolution)
            mesh.save(self._output)
            typer.echo(f"{printable_text(self._output)}: {len(mesh.faces)} triangles, closed")
            return
        cameras = self._cameras or [solid.views[0].camera]
        if len(self._turns) > 1:
            cameras = [cameras[0].orbited(float(turn), solid.box.center) for turn in self._turns]
        with self._outputs as outputs:
            for number, camera in enumerate(with_progress(cameras, len(cameras), "Drawing")):
                frame = ibr.render(solid, camera, samples=self._samples)
                outputs.write({"color": frame.color}, number, float(frame.valid.mean()), camera)
        outputs.tell(cameras[0].size, "views", "its camera sees nothing of the solid")


def _silhouettes(
    views: Path, masks: Path | None, camera: Path | None, stored: StoredDepth
) -> Sequence[DepthImage | Silhouette]:
    """The views of a folder: with depth; else pictures and masks, or their alpha, and cameras."""
    if masks is None and camera is None and ((views / SET_FILE).exists() or find_recording(views) is not None):
        return stored.load(views)
    recording = paired(views, masks or views)
    made: list[Silhouette] = []
    for color, mask, (own, pose) in zip(
        recording.colors, recording.depths, cameras_of(recording, [camera or views], shared=False), strict=True
    ):
        if pose is not None:
            made.append(Silhouette(ibr.read_color(color), read_mask(mask), posed(own, pose)))
    return made
