"""`pyibr object` and `pyibr hull`: solids from images taken all round, as pictures or as meshes."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

import pyibr as ibr
from pyibr.app.commands.command import tell_written
from pyibr.app.commands.outputs import VideoOptions, check_outputs
from pyibr.app.commands.things import check_up, save_upright
from pyibr.app.commands.turntable import Turntable, TurntableOptions
from pyibr.app.options import DeviceName, StoredDepth, device_of, given_of
from pyibr.capture.sets import SET_FILE
from pyibr.core.checks import Float64
from pyibr.core.errors import ArgumentError
from pyibr.images import DepthImage
from pyibr.images.silhouette import Silhouette
from pyibr.io.gaussian_files import refuse_gaussians
from pyibr.io.image import read_mask
from pyibr.io.layouts import find_recording
from pyibr.io.recordings import cameras_of, paired, posed
from pyibr.meshes.files import check_mesh_file, is_mesh_file
from pyibr.slicing import DepthObject, VisualHull
from pyibr.slicing.solid import Missing

_Output = Annotated[
    Path,
    typer.Option("--output", "-o", help="A picture; with --frames OUT_0000, ... or a video; or a mesh: GLB, OBJ, PLY"),
]
_Resolution = Annotated[int, typer.Option(help="Cells of a mesh along the solid's longest edge")]
_Views = Annotated[
    Path, typer.Argument(metavar="VIEWS", help="A folder of pictures, their depth and cameras: a set, or a recording")
]


def object_(
    views: _Views,
    output: _Output,
    *,
    turn: TurntableOptions,
    resolution: _Resolution = 128,
    missing: Annotated[
        Missing, typer.Option(help="Meaning of pixels without depth: no surface, or not known")
    ] = "empty",
    stored: StoredDepth,
    video: VideoOptions,
    device: DeviceName = None,
) -> None:
    """Make a solid from depth images taken all round. Draw it, also on a turntable, or write its mesh."""
    write = _writer([views], output, turn, resolution, video)
    with device_of(device):
        write(DepthObject(stored.load(views), missing=missing))


def hull(
    views: Annotated[
        Path, typer.Argument(metavar="PICTURES", help="A folder of pictures, with alpha; or VIEWS as for `object`")
    ],
    output: _Output,
    masks: Annotated[
        Path | None, typer.Argument(metavar="MASKS", help="A folder of masks, black outside the object")
    ] = None,
    camera: Annotated[
        Path | None,
        typer.Option(help="Cameras of the pictures: a list, a folder, a COLMAP model; default: JSON beside them"),
    ] = None,
    *,
    turn: TurntableOptions,
    resolution: _Resolution = 128,
    stored: StoredDepth,
    video: VideoOptions,
    device: DeviceName = None,
) -> None:
    """Make the largest solid that fits into silhouettes. Draw it, also on a turntable, or write its mesh."""
    write = _writer([views, *([masks] if masks else [])], output, turn, resolution, video)
    with device_of(device):
        write(VisualHull(_silhouettes(views, masks, camera, stored)))


def _writer(
    folders: Sequence[Path], output: Path, turn: TurntableOptions, resolution: int, video: VideoOptions
) -> Callable[[DepthObject | VisualHull], None]:
    """Return a function that writes the requested output of a solid; check the output first, before any work."""
    for folder in folders:
        refuse_gaussians(folder, "a folder of pictures")
    inputs = {"VIEWS": [file for folder in folders for file in folder.rglob("*")]}
    if not is_mesh_file(output):
        table = Turntable(output, turn, video, inputs)
        return lambda solid: table.draw(solid, _ball_of(solid), start=solid.views[0].camera)
    if given := [*given_of(turn._replace(up=None)), *given_of(video)]:
        raise ArgumentError(given[0], "a picture or a video for --output", str(output))
    check_up(turn.up, output)
    check_mesh_file(output)
    check_outputs(inputs, {"--output": [output]})

    def write(solid: DepthObject | VisualHull) -> None:
        mesh = solid.to_mesh(resolution)
        remark = save_upright(mesh, output, turn.up)
        tell_written([output], f"{len(mesh.faces)} triangles, closed{remark}", triangles=len(mesh.faces))

    return write


def _ball_of(solid: DepthObject | VisualHull) -> tuple[Float64, float]:
    low, high = solid.bounds
    return solid.box.center, 0.5 * float(np.linalg.norm(high - low))


def _silhouettes(
    views: Path, masks: Path | None, camera: Path | None, stored: StoredDepth
) -> Sequence[DepthImage | Silhouette]:
    """The views of a folder: depth images; else pictures with cameras and with masks or alpha."""
    if masks is None and camera is None and ((views / SET_FILE).exists() or find_recording(views) is not None):
        return stored.load(views)
    recording = paired(views, masks or views)
    made: list[Silhouette] = []
    for color, mask, (own, pose) in zip(
        recording.colors, recording.depths, cameras_of(recording, [camera or views], shared=False), strict=True
    ):
        if pose is not None:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # the mask holds the alpha, so the warning about it is not needed
                shown = ibr.read_color(color)
            made.append(Silhouette(shown, read_mask(mask, of_alpha=masks is None), posed(own, pose)))
    return made
