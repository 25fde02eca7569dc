"""`pyibr convert`: cameras, depth, recordings, meshes and 3D Gaussians in other formats."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

import pyibr as ibr
from pyibr.app.commands.beside import Behind, read_ahead
from pyibr.app.commands.command import tell_written
from pyibr.app.commands.outputs import Outputs, VideoOptions, check_outputs
from pyibr.app.commands.progress import waiting, with_progress
from pyibr.app.commands.reading import Inputs, Reading
from pyibr.app.commands.series import depths_in
from pyibr.app.commands.things import Up, UpOption, check_up, save_upright
from pyibr.app.commands.views import DepthRange
from pyibr.app.options import DeviceName, StoredDepth, device_of, printable_text
from pyibr.core.calibrations import file_and_name
from pyibr.core.camera import Camera
from pyibr.core.errors import ArgumentError
from pyibr.core.files import check_exists
from pyibr.gaussians.files import check_gaussian_file
from pyibr.io import CameraForm, DepthKind, read_cameras, write_cameras
from pyibr.io.camera_files import nerf_frame
from pyibr.io.gaussian_files import is_gaussian_file
from pyibr.io.layouts import find_recording
from pyibr.io.layouts.transforms import write_frames
from pyibr.io.recordings import Recording, cameras_of, posed
from pyibr.meshes.files import check_mesh_file, is_mesh_file

_MILLIMETRES = 1000.0
_OF_INTEGERS = (".png", ".mkv")


def convert(
    sources: Annotated[
        list[Path],
        typer.Argument(
            metavar="SOURCE",
            help="Cameras of any kind; depth: image, folder, video; a recording, also COLOR DEPTH; a mesh; Gaussians",
        ),
    ],
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            help="Cameras: .json, or a folder (COLMAP); depth by its suffix; a recording: a folder; a mesh; "
            "Gaussians: .ply, .compressed.ply, .splat, .spz, .ksplat, .sog",
        ),
    ],
    form: Annotated[
        CameraForm | None,
        typer.Option("--as", help="Form of the cameras; default: pyibr's JSON, or COLMAP's text for a folder"),
    ] = None,
    size: Annotated[
        tuple[int, int] | None, typer.Option(metavar="W H", help="Size of the pictures, if a calibration lacks it")
    ] = None,
    to_scale: Annotated[
        float | None,
        typer.Option(help="Stored units per scene unit of the output; default: as read for integers, or 1000"),
    ] = None,
    to_kind: Annotated[DepthKind, typer.Option(help="The kind of the written depth")] = "z",
    up: UpOption = None,
    *,
    reading: Reading,
    video: VideoOptions,
    device: DeviceName = None,
) -> None:
    """Convert cameras, depth, a recording, a mesh or 3D Gaussians to another format, selected by the output's name."""
    for path in sources:
        check_exists(file_and_name(path)[0])
    source, suffix = sources[0], output.suffix.lower()
    is_model = is_gaussian_file(source) or is_mesh_file(source)
    recording = None if is_model else find_recording(source, reading.stored.how.get("channel"))
    if is_model:
        (_convert_gaussians if is_gaussian_file(source) else _convert_mesh)(_only(sources), output, up)
    elif form is None and (recording or len(sources) > 1) and not suffix:
        with device_of(device):
            _convert_recording(Inputs(sources, reading), sources, output, to_scale or _MILLIMETRES)
    elif len(sources) > 1:
        raise ArgumentError("--output", "a folder, for a recording of COLOR and DEPTH", str(output))
    elif form is not None or suffix in ("", ".json"):
        _convert_cameras(source, output, form or _form_of(output), size, recording)
    elif recording is not None and source.is_dir():
        raise ArgumentError("--output", "a folder for a recording, or .json for its cameras", str(output))
    else:
        stored, of_integers = reading.stored, suffix in _OF_INTEGERS
        scale = stored.depth_scale if to_scale is None and of_integers else to_scale
        if scale is None and of_integers:
            expected = f"stored units per scene unit, for the integers of {output} ({source} is read as depth)"
            raise ArgumentError("--to-scale", expected, "none")
        camera = next(iter(reading.camera or ()), None)
        written = stored._replace(depth_scale=scale, depth_offset=0.0, depth_kind=to_kind)
        _convert_depth(source, output, camera, stored, written, video)


def _only(models: list[Path]) -> Path:
    if len(models) > 1:
        raise ArgumentError("SOURCE", "one file of a mesh or of Gaussians", f"{len(models)} files")
    return models[0]


def _convert_mesh(source: Path, output: Path, up: Up | None) -> None:
    check_outputs({"SOURCE": [source]}, {"--output": [output]})
    check_mesh_file(output)
    check_up(up, source, output)
    mesh = ibr.Mesh.load(source, axes="gltf")
    remark = save_upright(mesh, output, up, source)
    tell_written([output], f"{len(mesh.faces)} triangles{remark}", triangles=len(mesh.faces))


def _convert_gaussians(source: Path, output: Path, up: Up | None) -> None:
    check_outputs({"SOURCE": [source]}, {"--output": [output]})
    check_gaussian_file(output)
    if up:
        raise ArgumentError("--up", "none for 3D Gaussians", up)
    with waiting(f"Loading {printable_text(source.name)}"):
        cloud = ibr.Gaussians.load(source)
    with waiting(f"Writing {printable_text(output.name)}"):
        cloud.save(output)
    tell_written([output], f"{len(cloud)} Gaussians")


def _form_of(output: Path) -> CameraForm:
    if not output.suffix:
        return "colmap"
    return "nerfstudio" if output.name.lower().startswith("transforms") else "pyibr"


def _convert_cameras(
    source: Path, output: Path, form: CameraForm, size: tuple[int, int] | None, recording: Recording | None
) -> None:
    if form == "colmap" and output.suffix:
        raise ArgumentError("--output", "a folder, for a COLMAP model", str(output))
    if form != "colmap" and output.suffix.lower() != ".json":
        raise ArgumentError("--output", f"a file that ends in .json, as {form}", str(output))
    read = [file_and_name(source)[0]]
    check_outputs({"SOURCE": read}, {"--output": [output / "cameras.txt" if form == "colmap" else output]})
    cameras = read_cameras(source, size=size) if recording is None else _cameras_of(recording)
    write_cameras(output, cameras, form)
    tell_written([output], f"{len(cameras)} {'camera' if len(cameras) == 1 else 'cameras'}, as {form}")


def _cameras_of(recording: Recording) -> dict[str, Camera]:
    """The cameras of a recording's pictures with a pose."""
    pairs = zip(recording.colors, cameras_of(recording), strict=True)
    named = [(color.name, posed(camera, pose)) for color, (camera, pose) in pairs if pose is not None]
    found = dict(named)
    return found if len(found) == len(named) else {f"{k:06d}.png": camera for k, (_, camera) in enumerate(named)}


def _convert_depth(
    source: Path, output: Path, camera: Path | None, stored: StoredDepth, written: StoredDepth, video: VideoOptions
) -> None:
    own = None if camera is None else Camera.load(camera)
    if own is None and "distance" in (stored.depth_kind, written.depth_kind):
        raise ArgumentError("--camera", "the camera of the depth, to convert distances", "none")
    depths = depths_in(source, stored, own)
    count, seen = len(depths.names), DepthRange()
    video = video._replace(fps=video.fps or depths.fps) if output.suffix.lower() == ".mkv" else video
    outputs = Outputs({"--output": (output, "depth")}, written, None if depths.is_single else range(count), video)
    outputs.check({"SOURCE": depths.files, "--camera": [] if camera is None else [camera]})
    with outputs:
        for number, depth in enumerate(with_progress(read_ahead(depths.read(range(count))), count, "Converting")):
            seen.add(depth)
            known = np.isfinite(depth) & (depth > 0) & (depth < stored.empty_from)
            outputs.write({"depth": np.where(known, depth, np.float32(np.nan))}, number, float(known.mean()), own)
    outputs.tell("frames", "it has no depth", seen)


def _convert_recording(inputs: Inputs, sources: Sequence[Path], output: Path, scale: float) -> None:
    """Write pictures, depth registered to them, and transforms.json, which pyibr and nerfstudio read."""
    if any(path.resolve() in (output.resolve(), *output.resolve().parents) for path in sources):
        raise ArgumentError("--output", "a path outside of the recording that is read", str(output))
    check_outputs(inputs.files, {"--output": [output / "transforms.json"]})
    entries, shares = list[dict[str, Any]](), list[float]()
    with Behind(in_order=False) as behind:
        for place, views in with_progress(read_ahead(inputs.frames()), inputs.count, "Converting"):
            for view in views:
                number = len(entries) if inputs.numbers is None else inputs.numbers[place]
                color, depth = f"color/{number:06d}.png", f"depth/{number:06d}.png"
                behind.add(functools.partial(ibr.write_color, output / color, view.shown_color))
                known = np.where(view.valid, view.depth, np.float32(np.nan))
                behind.add(functools.partial(ibr.write_depth, output / depth, known, depth_scale=scale))
                entries.append({"file_path": color, "depth_file_path": depth, **nerf_frame(view.camera)})
                shares.append(float(view.valid.mean()))
    write_frames(output, entries, 1 / scale)
    covered = float(np.mean(shares))
    words = f"{len(entries)} frames, {covered:.1%} covered; {inputs.seen}"
    tell_written([output], words, frames=len(entries), size=inputs.size, covered=covered)
