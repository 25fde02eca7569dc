"""`pyibr convert`: cameras, depth, recordings and meshes in other formats."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

import pyibr as ibr
from pyibr.app.commands.beside import Behind, read_ahead
from pyibr.app.commands.command import tell_written
from pyibr.app.commands.exposure import Exposure
from pyibr.app.commands.outputs import Outputs, VideoOptions, check_outputs
from pyibr.app.commands.progress import with_progress
from pyibr.app.commands.series import depths_in
from pyibr.app.commands.sources import InputOptions, Losses, open_sources
from pyibr.app.commands.views import DepthOptions, DepthRange, views_of
from pyibr.app.options import (
    CameraFile,
    DeviceName,
    ExposureOption,
    StoredDepth,
    Take,
    device_of,
)
from pyibr.core.camera import Camera
from pyibr.core.errors import ArgumentError
from pyibr.core.files import check_exists
from pyibr.io import CameraForm, DepthKind, read_cameras, write_cameras
from pyibr.io.camera_files import nerf_frame
from pyibr.io.layouts import find_recording, may_be_recording
from pyibr.io.layouts.transforms import write_frames
from pyibr.io.recordings import cameras_of, posed
from pyibr.meshes.files import check_mesh_file, is_mesh_file

_MILLIMETRES = 1000.0
_OF_INTEGERS = (".png", ".mkv")

_Source = Annotated[
    Path,
    typer.Argument(
        metavar="SOURCE", help="Cameras of any kind; depth: an image, a folder, a video; a recording; or a mesh"
    ),
]
_Output = Annotated[
    Path,
    typer.Option(
        "--output",
        "-o",
        help="Cameras: .json, or a folder (COLMAP); depth by its suffix; a recording: a folder; a mesh",
    ),
]


def convert(
    source: _Source,
    output: _Output,
    form: Annotated[
        CameraForm | None, typer.Option("--as", help="Cameras' form; default: pyibr's JSON, of a folder COLMAP's text")
    ] = None,
    size: Annotated[
        tuple[int, int] | None, typer.Option(metavar="W H", help="Of the pictures, where a calibration tells none")
    ] = None,
    camera: CameraFile = None,
    to_scale: Annotated[
        float | None,
        typer.Option(help="Stored units per scene unit of what is written; default: of integers as read, or 1000"),
    ] = None,
    to_kind: Annotated[DepthKind, typer.Option(help="The kind of depth that is written")] = "z",
    take: Take = None,
    *,
    stored: StoredDepth,
    exposure: ExposureOption = 0.0,
    video: VideoOptions,
    device: DeviceName = None,
) -> None:
    """Convert cameras, depth, a recording or a mesh to another format, which the output's name tells."""
    check_exists(source)
    suffix = output.suffix.lower()
    if to_scale is None and suffix in _OF_INTEGERS:
        to_scale = stored.depth_scale
    if is_mesh_file(source):
        _convert_mesh(source, output)
    elif form is not None or suffix == ".json":
        _convert_cameras(source, output, form or _form_of(output), size)
    elif suffix:
        if to_scale is None and suffix in _OF_INTEGERS:
            raise ArgumentError("--to-scale", f"stored units per scene unit, for the integers of {output}", "none")
        _convert_depth(source, output, camera, stored, stored._replace(depth_scale=to_scale, depth_kind=to_kind), video)
    elif may_be_recording(source) and find_recording(source) is not None:
        options = InputOptions([source], [] if camera is None else [camera], [], [], take)
        with device_of(device), Exposure(exposure) as exposed:
            _convert_recording(options, output, stored, to_scale or _MILLIMETRES, exposed)
    else:
        _convert_cameras(source, output, "colmap", size)


def _convert_mesh(source: Path, output: Path) -> None:
    check_outputs({"SOURCE": [source]}, {"--output": [output]})
    mesh = ibr.Mesh.load(source)
    check_mesh_file(output, mesh.texture is not None, mesh.colors is not None)
    mesh.save(output)
    tell_written([output], f"{len(mesh.faces)} triangles", triangles=len(mesh.faces))


def _form_of(output: Path) -> CameraForm:
    return "nerfstudio" if output.name.lower().startswith("transforms") else "pyibr"


def _convert_cameras(source: Path, output: Path, form: CameraForm, size: tuple[int, int] | None) -> None:
    if form == "colmap" and output.suffix:
        raise ArgumentError("--output", "a folder, for a COLMAP model", str(output))
    if form != "colmap" and output.suffix.lower() != ".json":
        raise ArgumentError("--output", f"a file that ends in .json, as {form}", str(output))
    check_outputs({"SOURCE": [source]}, {"--output": [output / "cameras.txt" if form == "colmap" else output]})
    cameras = _cameras_in(source, size)
    write_cameras(output, cameras, form)
    tell_written([output], f"{len(cameras)} {'camera' if len(cameras) == 1 else 'cameras'}, as {form}")


def _cameras_in(source: Path, size: tuple[int, int] | None) -> dict[str, Camera]:
    """The cameras of a recording's pictures that have a pose, or of anything else."""
    recording = find_recording(source) if may_be_recording(source) else None
    if recording is None:
        return read_cameras(source, size=size)
    pairs = zip(recording.colors, cameras_of(recording), strict=True)
    named = [(color.name, posed(camera, pose)) for color, (camera, pose) in pairs if pose is not None]
    found = dict(named)
    return found if len(found) == len(named) else {f"{k:06d}.png": camera for k, (_, camera) in enumerate(named)}


def _convert_depth(
    source: Path, output: Path, camera: Path | None, stored: StoredDepth, written: StoredDepth, video: VideoOptions
) -> None:
    own = None if camera is None else Camera.load(camera)
    if own is None and "distance" in (stored.depth_kind, written.depth_kind):
        raise ArgumentError("--camera", "the depth's, of whose distances to or from is converted", "none")
    depths = depths_in(source, stored, own)
    count, seen = len(depths.names), DepthRange()
    video = video._replace(fps=video.fps or depths.fps) if output.suffix.lower() == ".mkv" else video
    outputs = Outputs({"--output": (output, "depth")}, written, None if depths.is_single else range(count), video, None)
    outputs.check({"SOURCE": depths.files, "--camera": [] if camera is None else [camera]})
    shape = 0, 0
    with outputs:
        for number, depth in enumerate(with_progress(read_ahead(depths.read(range(count))), count, "Converting")):
            seen.add(depth)
            known = np.isfinite(depth) & (depth > 0) & (depth < stored.empty_from)
            outputs.write({"depth": np.where(known, depth, np.float32(np.nan))}, number, float(known.mean()), own)
            shape = depth.shape
    outputs.tell((shape[1], shape[0]), "frames", "it has no depth", seen)


def _convert_recording(
    options: InputOptions, output: Path, stored: StoredDepth, scale: float, exposure: Exposure
) -> None:
    """Pictures, their depth in the pictures' cameras, and transforms.json, which pyibr and nerfstudio read."""
    (source,), is_still = open_sources(options)
    folder = options.inputs[0].resolve()
    if folder in (output.resolve(), *output.resolve().parents):
        raise ArgumentError("--output", "a place outside of the recording that is read", str(output))
    shots, losses, seen = source.shots, Losses(recorded=not is_still), DepthRange()
    names = [(f"color/{shot.number:06d}.png", f"depth/{shot.number:06d}.png") for shot in shots]
    check_outputs({**options.read([source])}, {"--output": [output / name for pair in names for name in pair]})
    how = DepthOptions(stored, None, None, None, steady=False, recorded=not is_still, seen=seen)
    entries = list[dict[str, Any]]()
    views = zip(names, views_of(source, how, losses, exposure), strict=True)
    with Behind(in_order=False) as behind:
        for (color, depth), view in with_progress(read_ahead(views), len(shots), "Converting"):
            if view is not None:
                behind.add(functools.partial(ibr.write_color, output / color, view.shown_color))
                known = np.where(view.valid, view.depth, np.float32(np.nan))
                behind.add(functools.partial(ibr.write_depth, output / depth, known, depth_scale=scale))
                entries.append({"file_path": color, "depth_file_path": depth, **nerf_frame(view.camera)})
    losses.tell(some=bool(entries))
    write_frames(output, entries, 1 / scale)
    tell_written([output], f"{len(entries)} frames; {seen}", frames=len(entries))
