"""`pyibr clean`: cleaned depth of depth cameras, for single frames and for recordings."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import repeat
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray

import pyibr as ibr
from pyibr.app.commands.beside import read_ahead
from pyibr.app.commands.cameras import LensOptions
from pyibr.app.commands.exposure import Exposure
from pyibr.app.commands.outputs import Kind, Outputs, VideoOptions
from pyibr.app.commands.progress import with_progress
from pyibr.app.commands.sources import InputOptions, Losses, Source, open_depths
from pyibr.app.commands.views import Depth, DepthOptions, DepthRange, DepthReader
from pyibr.app.options import (
    Baseline,
    CameraFile,
    Cleaning,
    DepthFiles,
    DeviceName,
    ExposureOption,
    NoiseOption,
    StoredDepth,
    Take,
    device_of,
    noise_of,
)
from pyibr.core.camera import Camera
from pyibr.core.errors import ArgumentError
from pyibr.io import DepthReading
from pyibr.io.depth_frames import frames_in
from pyibr.io.layouts import find_recording
from pyibr.io.recordings import Shot, Stored

_ANY = LensOptions(fov=60.0)  # cleaning the planar depth of a static camera does not depend on the lens


def clean(
    depth: DepthFiles,
    output: Annotated[
        Path,
        typer.Option("--output", "-o", help="The depth; several: OUT_0000, or a folder to keep the file names"),
    ],
    color: Annotated[
        Path | None, typer.Option(help="Its image, to locate edges: a file, a folder or a video, matching DEPTH")
    ] = None,
    camera: CameraFile = None,
    *,
    lens: LensOptions,
    take: Take = None,
    cleaning: Cleaning,
    noise: NoiseOption = None,
    baseline: Baseline = None,
    stored: StoredDepth,
    exposure: ExposureOption = 0.0,
    invented_out: Annotated[
        Path | None, typer.Option(help="Also write the mask of filled holes and replaced samples")
    ] = None,
    device: DeviceName = None,
) -> None:
    """Remove flying pixels, speckle, small holes and noise from depth; in a recording, with the last frame's help."""
    given = InputOptions([depth], [camera] if camera else [], [], [], take, lens, stored.how.get("channel"))
    told = noise_of(noise, baseline)
    source, is_still = _opened(given, color, stored, "the depth for --noise" if told else None)
    own = {shot.number: shot.depth.name for shot in source.shots} if output.is_dir() or not output.suffix else None
    if own is not None and len({*own.values()}) < len(own):
        raise ArgumentError("--output", f"a name to number, or .mkv, for the frames of {depth}", str(output))
    written = stored if own is None else _as_read(stored, source.shots[0].stored)
    numbers = None if is_still and own is None else [shot.number for shot in source.shots]
    files: dict[str, tuple[Path | None, Kind]] = {
        "--output": (output, "depth"),
        "--invented-out": (invented_out, "mask"),
    }
    outputs = Outputs(files, written, numbers, VideoOptions(), own=own)
    outputs.check({**source.files(), "--camera": [camera] if camera else []}, [depth, *([color] if color else [])])
    losses, seen = Losses(recorded=not is_still), DepthRange()
    reader = DepthReader(DepthOptions(stored, None, cleaning, told, not is_still, not is_still, seen), losses)
    with device_of(device), outputs, Exposure(exposure) as exposed:
        frames = read_ahead(_cleaned(source, reader, losses, exposed, stored.empty_from))
        for shot, made, invented in with_progress(frames, len(source.shots), "Cleaning"):
            share, of_depth = float(np.isfinite(made).mean()), shot.depth_camera or shot.camera
            outputs.write({"depth": made, "mask": invented}, shot.number, share, of_depth)
        losses.tell(some=bool(outputs.written))
    outputs.tell("frames", "it has no depth", seen)


def _opened(options: InputOptions, color: Path | None, stored: StoredDepth, needed: str | None) -> tuple[Source, bool]:
    """The frames, and whether there is a single one; with any camera if none is given and none is needed.

    needed: whose camera must be given, in the words of the error; None if only distances need one.
    """
    (place,), camera = options.inputs, next(iter(options.cameras), None)
    recording = find_recording(place, options.channel) if color is None else None
    if options.lens == LensOptions() and not (camera or (recording and (recording.cameras or recording.known))):
        needed = "the depth for --depth-kind distance" if stored.depth_kind == "distance" else needed
        if needed is not None:
            raise ArgumentError("--camera", f"the camera of {needed}, or --fov", "none")
        options = options._replace(lens=_ANY)

    def alone(first: Path, _: Stored) -> tuple[Camera, None]:
        how: DepthReading = {**stored.how, "depth_kind": "relative" if stored.depth_kind == "relative" else "z"}
        frames = frames_in(first, options.channel)
        values = ibr.read_depth(first, **how) if frames is None else frames.read_one(0, None, how)
        height, width = values.shape
        return options.lens.camera_of(first, camera, (width, height)), None

    return open_depths(options, color, alone)


def _as_read(stored: StoredDepth, layout: Stored) -> StoredDepth:
    """Options that write depth in the recording's unit and kind."""
    kind = layout.kind if stored.depth_kind == "z" else stored.depth_kind
    scale, offset = stored.depth_scale or layout.scale, stored.depth_offset or layout.offset
    return stored._replace(depth_scale=scale, depth_offset=offset, depth_kind=kind)


def _cleaned(
    source: Source, reader: DepthReader, losses: Losses, exposure: Exposure, far: float
) -> Iterator[tuple[Shot, Depth, NDArray[np.bool_]]]:
    """Usable frames, their depth nearer than `far`, and the mask of invented samples."""
    pictures = repeat(None) if source.shots[0].color is None else source.colors(losses)
    for shot, picture in zip(source.shots, pictures, strict=False):
        color: NDArray[Any] | None = None if picture is None else exposure.shown(picture, shot.color)
        depth = reader.read(shot, color)
        if depth is not None and reader.invented is not None:
            near = depth < far
            yield shot, np.where(near, depth, np.float32(np.nan)), reader.invented & near
