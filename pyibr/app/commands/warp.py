"""`pyibr warp`: new views of images with depth, and of recordings."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
import typer
from numpy.typing import NDArray

import pyibr as ibr
from pyibr.app.commands.beside import read_ahead
from pyibr.app.commands.outputs import Kind, Outputs, VideoOptions
from pyibr.app.commands.progress import with_progress
from pyibr.app.commands.reading import Inputs, Reading, Sources
from pyibr.app.commands.targets import Job, Move, Targets
from pyibr.app.options import DeviceName, FillOption, Samples, device_of, fill_of, printable_text
from pyibr.capture.rigs import with_background
from pyibr.core.camera import Camera
from pyibr.images import DepthImage, Frame
from pyibr.images.depth_image import Side
from pyibr.warp.blending import Blend
from pyibr.warp.filling import Fill
from pyibr.warp.view import Edges, Interpolation, Method, WarpOptions


class TargetOptions(NamedTuple):
    """Options of the new cameras, for `Targets`."""

    to: Annotated[Path | None, typer.Option(help="The new view's camera, or several: as --camera")] = None
    move: Annotated[
        Move | None, typer.Option(metavar="X Y Z", help="Move the camera right, down and forward, in scene units")
    ] = None
    orbit: Annotated[
        float | None,
        typer.Option(
            metavar="DEGREES", help="Turn to the right about the point at the median depth on the optical axis"
        ),
    ] = None
    frames: Annotated[
        int,
        typer.Option(
            min=1, max=100_000, help="Views along --move or --orbit, starting at the source: OUT_0000, ... or a video"
        ),
    ] = 1


def warp(
    sources: Sources,
    output: Annotated[Path, typer.Option("--output", "-o", help="The new view; several: OUT_0000, ... or a video")],
    *,
    reading: Reading,
    target: TargetOptions,
    together: Annotated[bool, typer.Option("--together", help="All frames of a recording show one scene")] = False,
    method: Annotated[Method, typer.Option(help="How surfaces are found")] = "epipolar",
    interpolation: Annotated[Interpolation, typer.Option(help="Interpolation of depth and colour")] = "linear",
    edges: Annotated[Edges, typer.Option(help="Cut neighbours at depth edges, or connect them to one surface")] = "cut",
    cut_ratio: Annotated[
        float | None,
        typer.Option(
            metavar="R", help="Cut between neighbours whose depths differ by more; default: by shape and noise"
        ),
    ] = None,
    thin: Annotated[bool, typer.Option("--thin", help="Draw objects one sample wide as wide as their samples")] = False,
    fill: FillOption = "none",
    side: Annotated[Side, typer.Option(help="Visible sides of the surface")] = "front",
    samples: Samples = 1,
    blend: Annotated[Blend, typer.Option(help="Several views: weighted by quality, or the nearest")] = "quality",
    depth_out: Annotated[Path | None, typer.Option(help="Also write the new view's depth")] = None,
    valid_out: Annotated[Path | None, typer.Option(help="Also write the mask of pixels that are not holes")] = None,
    skip_existing: Annotated[bool, typer.Option("--skip-existing", help="Skip views whose files exist")] = False,
    video: VideoOptions,
    device: DeviceName = None,
) -> None:
    """Render a new view of an image with depth, of several, or of each frame of a recording.

    Give the new camera by exactly one of --to, --move and --orbit.
    """
    targets = Targets(*target)
    inputs = Inputs(sources, reading, together)
    count = targets.count(None if inputs.is_scene else inputs.count)
    numbers = inputs.numbers or (None if count is None else range(count))
    files: dict[str, tuple[Path | None, Kind]] = {
        "--output": (output, "color"),
        "--depth-out": (depth_out, "depth"),
        "--valid-out": (valid_out, "mask"),
    }
    outputs = Outputs(files, reading.stored, numbers, video, inputs.film)
    outputs.check({**inputs.files, "--to": [] if target.to is None else [target.to]}, sources)
    done = _done(outputs, count, output) if skip_existing else set[int]()
    how: WarpOptions = {"method": method, "interpolation": interpolation, "edges": edges, "cut_ratio": cut_ratio}
    how |= {"side": side, "fill": fill_of(fill), "thin": thin, "blend": blend}
    with device_of(device), outputs:
        jobs = read_ahead(_jobs(inputs, targets, count, done, fill_of(fill)))
        for views, camera, number in with_progress(jobs, count or 1, "Warping"):
            (frame,) = drawn_views(views, [camera], samples, how)
            images: dict[Kind, NDArray[Any]] = {"color": frame.color, "depth": frame.depth, "mask": frame.valid}
            outputs.write(images, number, float(frame.valid.mean()), camera)
    outputs.tell("views", f"{printable_text(sources[0])} is out of view", inputs.seen)


def drawn_views(views: Sequence[DepthImage], cameras: Sequence[Camera], samples: int, how: WarpOptions) -> list[Frame]:
    """A frame for each camera, black if no view has depth; without warnings, as the command reports empty frames."""
    seen = [view for view in views if view.valid.any()]
    if not seen:
        return [_black(camera, views[0].color.dtype) for camera in cameras]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        return ibr.warp(seen, cameras, samples=samples, **how)


def _black(camera: Camera, dtype: np.dtype[Any]) -> Frame:
    shape = camera.height, camera.width
    return Frame(np.zeros((*shape, 3), dtype), np.full(shape, np.nan, np.float32), np.zeros(shape, np.bool_), camera)


def _done(outputs: Outputs, count: int | None, output: Path) -> set[int]:
    """Numbers of the frames whose files exist; exit if all do."""
    done = outputs.done()
    if len(done) == (count or 1):
        typer.echo(f"{printable_text(output)}: all files exist already")
        raise typer.Exit
    return done


def _jobs(inputs: Inputs, targets: Targets, count: int | None, done: set[int], fill: Fill | None) -> Iterator[Job]:
    """Yield the views to draw, except finished ones."""
    if inputs.numbers is None:
        for _, views in inputs.frames():
            every = list(targets.of_scene(views, count))
            shown = with_background(views, [job.target for job in every], fill)
            yield from (job._replace(views=shown) for job in every if job.number not in done)
    else:
        for place, views in inputs.frames(done):
            yield targets.of_frame(views, place, inputs.numbers[place])
