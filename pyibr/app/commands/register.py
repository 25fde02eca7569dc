"""`pyibr register`: registers depth and colour of two cameras, for single frames and recordings."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray

import pyibr as ibr
from pyibr.app.commands.beside import read_ahead
from pyibr.app.commands.cameras import ExtrinsicsFile, depth_camera_in
from pyibr.app.commands.exposure import Exposure
from pyibr.app.commands.outputs import Kind, Outputs, VideoOptions
from pyibr.app.commands.progress import with_progress
from pyibr.app.commands.sources import InputOptions, Losses, Source, open_depths
from pyibr.app.commands.views import Depth, DepthOptions, DepthRange, DepthReader
from pyibr.app.options import CleaningOptions, DepthFiles, DeviceName, ExposureOption, StoredDepth, Take, device_of
from pyibr.core.camera import Camera
from pyibr.core.errors import ArgumentError
from pyibr.io.recordings import Shot, Stored

Color = NDArray[Any]
_Given = tuple[Shot, Depth, Color | None]

_Pictures = Annotated[
    Path | None,
    typer.Option(
        help="Its image, a folder of images, a video, or DEPTH's folder again: write colours for the depth samples, "
        "black if unseen"
    ),
]


def register(
    depth: DepthFiles,
    depth_camera: Annotated[
        Path, typer.Option(metavar="FILE[#NAME]", help="The camera of the depth: a calibration of any kind")
    ],
    color_camera: Annotated[
        Path, typer.Option(metavar="FILE[#NAME]", help="The camera of the colours, in the same world")
    ],
    output: Annotated[
        Path,
        typer.Option("--output", "-o", help="The registered depth; with --color, the colours; several: OUT_0000, ..."),
    ],
    extrinsics: ExtrinsicsFile = None,
    color: _Pictures = None,
    take: Take = None,
    *,
    cleaning: CleaningOptions,
    stored: StoredDepth,
    exposure: ExposureOption = 0.0,
    seen_out: Annotated[
        Path | None, typer.Option(help="With --color: also write the mask of samples with a colour")
    ] = None,
    device: DeviceName = None,
) -> None:
    """Register depth to a colour camera's image, or colours to depth samples; for each frame of a recording."""
    if seen_out is not None and color is None:
        raise ArgumentError("--seen-out", "--color with it", "none")
    channel = stored.how.get("channel")
    inputs = InputOptions([depth], [color_camera], [depth_camera], [], take, channel=channel, extrinsics=extrinsics)

    def alone(first: Path, how: Stored) -> tuple[Camera, Camera]:
        of_color = Camera.load(color_camera)
        return of_color, depth_camera_in(depth_camera, first, how, of_color, extrinsics)

    source, is_still = open_depths(inputs, color, alone)
    numbers = None if is_still else [shot.number for shot in source.shots]
    files: dict[str, tuple[Path | None, Kind]] = {"--output": (output, "depth" if color is None else "color")}
    outputs = Outputs({**files, "--seen-out": (seen_out, "mask")}, stored, numbers, VideoOptions(), source.video)
    read = source.files()
    cameras = {"--depth-camera": [depth_camera], "--color-camera": [color_camera]}
    cameras |= {"--extrinsics": [extrinsics]} if extrinsics else {}
    files_read = {"DEPTH": read["DEPTH"], "--color": [] if color is None else read["COLOR"], **cameras}
    outputs.check(files_read, [depth] if color is None else [depth, color])
    losses = Losses(recorded=not is_still)
    seen = DepthRange()
    depth_options = DepthOptions(
        stored, None, *cleaning.checked(), steady=not is_still, recorded=not is_still, seen=seen
    )
    depths = DepthReader(depth_options, losses)
    pictures = None if color is None else source.colors(losses)
    with device_of(device), outputs, Exposure(exposure) as exposed:
        frames = _read(source, depths, pictures, exposed, stored.empty_from)
        for shot, given, picture in with_progress(read_ahead(frames), len(source.shots), "Registering"):
            made = losses.or_none(functools.partial(_registered, depths, shot, given, picture))
            if made is not None:
                images, covered = made
                outputs.write(images, shot.number, float(covered.mean()), shot.camera)
        losses.tell(some=bool(outputs.written))
    outputs.tell("frames", "their depth is out of view", seen)


def _read(
    source: Source, depths: DepthReader, pictures: Iterator[Color | None] | None, exposure: Exposure, far: float
) -> Iterator[_Given]:
    """Usable frames with their depth nearer than `far`, and with their pictures, if any."""
    for shot in source.shots:
        picture = None if pictures is None else next(pictures)
        depth = depths.read(shot)
        if depth is not None and (pictures is None or picture is not None):
            near = np.where(depth < far, depth, np.float32(np.nan))
            yield shot, near, None if picture is None else exposure.shown(picture, shot.color)


def _registered(
    depths: DepthReader, shot: Shot, depth: Depth, picture: Color | None
) -> tuple[dict[Kind, NDArray[Any]], NDArray[np.bool_]]:
    """Register a frame; return the images to write and the mask of covered pixels."""
    with depths.naming(shot):
        if picture is None:
            made = depths.registered(shot, depth)
            return {"depth": made}, np.isfinite(made)
        if depths.is_blank(depth):
            seen = np.zeros(depth.shape, np.bool_)
            return {"color": np.zeros((*depth.shape, 3), picture.dtype), "mask": seen}, seen
        noise = depths.noise_of(shot)
        found = ibr.register_color(depth, shot.depth_camera or shot.camera, shot.camera, picture, noise=noise)
        return {"color": found.color, "mask": found.seen}, found.seen
