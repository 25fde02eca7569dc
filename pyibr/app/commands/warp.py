"""`pyibr warp`: new views of images with depth, and of recordings of depth cameras."""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import typer
from numpy.typing import NDArray

import pyibr as ibr
from pyibr.app.commands.beside import read_ahead
from pyibr.app.commands.cameras import LensOptions
from pyibr.app.commands.exposure import Exposure
from pyibr.app.commands.outputs import Kind, Outputs, VideoOptions
from pyibr.app.commands.progress import with_progress
from pyibr.app.commands.sources import InputOptions, Losses, Source, open_sources
from pyibr.app.commands.targets import Job, Move, Targets
from pyibr.app.commands.views import DepthOptions, DepthRange, views_of
from pyibr.app.options import (
    Baseline,
    Clean,
    Cleaning,
    DefaultDepthText,
    DeviceName,
    ExposureOption,
    NoiseOption,
    StoredDepth,
    Take,
    default_depth_of,
    device_of,
    noise_of,
    printable_text,
)
from pyibr.core.camera import Camera
from pyibr.core.errors import ArgumentError
from pyibr.images import DepthImage
from pyibr.images.depth_image import Side
from pyibr.warp.blending import Blend
from pyibr.warp.filling import Fill
from pyibr.warp.view import Edges, Interpolation, Method, WarpOptions

_Draw = Callable[[Sequence[DepthImage], Camera], ibr.Frame]

_Sources = Annotated[
    list[Path],
    typer.Argument(
        metavar="COLOR DEPTH",
        help="Image and planar depth; several such pairs; or recordings: a folder of images or a video, and a folder "
        "of depth; or one folder with both (TUM RGB-D, 7-Scenes, Redwood, COLMAP's dense workspace)",
    ),
]
_Cameras = Annotated[
    list[Path] | None,
    typer.Option(
        metavar="FILE[#NAME]",
        help="The camera, or one for each pair: a calibration of any kind; a list, a folder of such, a COLMAP model",
    ),
]
_DepthCameras = Annotated[
    list[Path] | None, typer.Option(help="The depth's camera, if it is not registered to the colours: JSON")
]
_Poses = Annotated[
    list[Path] | None,
    typer.Option(help="Where the camera was in each frame: TUM, KITTI, Redwood, 4 x 4 matrices, cameras as JSON"),
]
_To = Annotated[Path | None, typer.Option(help="The new view's camera, or several: as --camera")]
_MoveOption = Annotated[
    Move | None, typer.Option(metavar="X Y Z", help="Move the camera right, down and forward, in scene units")
]
_Orbit = Annotated[
    float | None,
    typer.Option(metavar="DEGREES", help="Turn to the right about the point at the median depth on the optical axis"),
]
_Frames = Annotated[
    int,
    typer.Option(
        min=1, max=100_000, help="Views along --move or --orbit, the source's first: OUT_0000, ... or a video"
    ),
]
_CutRatio = Annotated[
    float | None,
    typer.Option(metavar="R", help="Cut where neighbours' depths differ by more; default: by shape and noise"),
]


def warp(
    sources: _Sources,
    output: Annotated[Path, typer.Option("--output", "-o", help="The new view; of several: OUT_0000, ... or a video")],
    camera: _Cameras = None,
    *,
    lens: LensOptions,
    to: _To = None,
    move: _MoveOption = None,
    orbit: _Orbit = None,
    frames: _Frames = 1,
    together: Annotated[bool, typer.Option("--together", help="All frames of a recording show one scene")] = False,
    take: Take = None,
    poses: _Poses = None,
    depth_camera: _DepthCameras = None,
    clean: Clean = False,
    noise: NoiseOption = None,
    baseline: Baseline = None,
    method: Annotated[Method, typer.Option(help="How the surface is searched")] = "epipolar",
    interpolation: Annotated[Interpolation, typer.Option(help="How depth and colour are read")] = "linear",
    edges: Annotated[Edges, typer.Option(help="Neighbours are cut apart at depth edges, or one surface")] = "cut",
    cut_ratio: _CutRatio = None,
    thin: Annotated[bool, typer.Option("--thin", help="Things one sample thin as wide as their samples")] = False,
    fill: Annotated[Literal["none", Fill], typer.Option(help="Fill holes: from behind, from all around")] = "none",
    side: Annotated[Side, typer.Option(help="Sides of the surface that are shown")] = "front",
    samples: Annotated[int, typer.Option(help="A pixel: 1, 4, 9, 16 ...; several make silhouettes smooth")] = 1,
    blend: Annotated[Blend, typer.Option(help="Several views: by how well each saw it; the nearest")] = "quality",
    stored: StoredDepth,
    default_depth: DefaultDepthText = "none",
    exposure: ExposureOption = 0.0,
    depth_out: Annotated[Path | None, typer.Option(help="Write the new view's depth too")] = None,
    valid_out: Annotated[Path | None, typer.Option(help="Write the mask of what is no hole too")] = None,
    skip_existing: Annotated[bool, typer.Option("--skip-existing", help="Leave out views that are there")] = False,
    video: VideoOptions,
    device: DeviceName = None,
) -> None:
    """Render a new view of an image with depth, of several, or of each frame of a recording.

    Give the new camera by exactly one of --to, --move and --orbit.
    """
    targets = Targets(to, move, orbit, frames)
    options = InputOptions(
        sources, camera or [], depth_camera or [], poses or [], take, lens, stored.how.get("channel")
    )
    opened, are_stills = _opened(options, together)
    is_scene, shots = are_stills or together, opened[0].shots
    count = targets.count(None if is_scene else len(shots))
    numbers = None if count is None else range(count) if is_scene else [shot.number for shot in shots]
    film = None if is_scene else opened[0].video
    outputs = Outputs(_files(output, depth_out, valid_out), stored, numbers, video, film)
    outputs.check({**options.read(opened), "--to": [] if to is None else [to]}, sources)
    seen = DepthRange()
    reading = stored, default_depth_of(default_depth), Cleaning() if clean else None, noise_of(noise, baseline)
    depth_options = DepthOptions(*reading, steady=not is_scene, recorded=not are_stills, seen=seen)
    done = _done(outputs, count, output) if skip_existing else set[int]()
    how: WarpOptions = {"method": method, "interpolation": interpolation, "edges": edges, "cut_ratio": cut_ratio}
    how |= {"side": side, "fill": None if fill == "none" else fill, "thin": thin, "blend": blend}
    draw = functools.partial(_drawn, samples=samples, how=how)
    with device_of(device), outputs, Exposure(exposure) as exposed:
        size = _write(_jobs(opened, depth_options, exposed, targets, (count, numbers), done), draw, outputs, count)
    outputs.tell(size, "views", f"its camera sees nothing of {printable_text(sources[0])}", seen)


def _opened(options: InputOptions, together: bool) -> tuple[list[Source], bool]:
    """The sources, and whether they are single pictures; those that are together at places that are known."""
    opened, are_stills = open_sources(options)
    if together and not all(source.is_placed for source in opened):
        got = f"{len(opened[0].shots)} at one place"
        raise ArgumentError("--together", "frames whose places are known, as by --poses", got)
    return opened, are_stills


def _files(output: Path, depth_out: Path | None, valid_out: Path | None) -> dict[str, tuple[Path | None, Kind]]:
    """Files to write, by their options, and what they hold."""
    return {"--output": (output, "color"), "--depth-out": (depth_out, "depth"), "--valid-out": (valid_out, "mask")}


def _done(outputs: Outputs, count: int | None, output: Path) -> set[int]:
    """Numbers of the frames that are there; if all are, the command ends."""
    done = outputs.done()
    if len(done) == (count or 1):
        typer.echo(f"{printable_text(output)}: all of it is there already")
        raise typer.Exit
    return done


def _jobs(
    sources: Sequence[Source],
    depth_options: DepthOptions,
    exposure: Exposure,
    targets: Targets,
    numbered: tuple[int | None, Sequence[int] | None],
    done: set[int],
) -> Iterator[Job]:
    """The views to draw, without those that are done, and in the end a word on frames that are lost."""
    losses, (count, numbers) = Losses(recorded=depth_options.recorded), numbered
    skipped = done if depth_options.steady else ()
    each = [views_of(source, depth_options, losses, exposure, skipped) for source in sources]
    if depth_options.steady:
        jobs = targets.of_frames(zip(*each, strict=True), numbers or [])
    else:
        known = [view for views in each for view in views if view is not None]
        jobs = targets.of_scene(known, count) if known else ()
    some = False
    for job in jobs:
        if job.number not in done:
            yield job
            some = True
    losses.tell(some=some or bool(done))


def _write(jobs: Iterable[Job], draw: _Draw, outputs: Outputs, count: int | None) -> tuple[int, int]:
    """Draw and write the views; returns the last one's size."""
    size = 0, 0
    for views, target, number in with_progress(read_ahead(jobs), count or 1, "Warping"):
        frame = draw(views, target)
        images: dict[Kind, NDArray[Any]] = {"color": frame.color, "depth": frame.depth, "mask": frame.valid}
        outputs.write(images, number, float(frame.valid.mean()), target)
        size = target.size
    return size


def _drawn(views: Sequence[DepthImage], target: Camera, samples: int, how: WarpOptions) -> ibr.Frame:
    """The new view; what is empty is told at the end, with the file's name."""
    seen = [view for view in views if view.valid.any()]
    if not seen:
        shape = target.height, target.width
        color: Any = np.zeros((*shape, 3), views[0].color.dtype)
        return ibr.Frame(color, np.full(shape, np.nan, np.float32), np.zeros(shape, np.bool_), target)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        return ibr.warp(seen, target, samples=samples, **how)
