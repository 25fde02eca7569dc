"""`pyibr warp`: new views of images with depth, and of recordings."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
from numpy.typing import NDArray

import pyibr as ibr
from pyibr.app.commands.beside import read_ahead
from pyibr.app.commands.cameras import LensOptions
from pyibr.app.commands.drawing import drawn_views
from pyibr.app.commands.outputs import Kind, Outputs, VideoOptions
from pyibr.app.commands.progress import with_progress
from pyibr.app.commands.reading import Inputs, Reading, Sources
from pyibr.app.commands.targets import Job, Move, Targets
from pyibr.app.options import DeviceName, FillOption, Samples, StoredDepth, device_of, fill_of, printable_text
from pyibr.core.camera import Camera
from pyibr.images import DepthImage
from pyibr.images.depth_image import Side
from pyibr.warp.blending import Blend
from pyibr.warp.view import Edges, Interpolation, Method, WarpOptions

_Draw = Callable[[Sequence[DepthImage], Sequence[Camera]], list[ibr.Frame]]

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
        min=1, max=100_000, help="Views along --move or --orbit, starting at the source: OUT_0000, ... or a video"
    ),
]
_CutRatio = Annotated[
    float | None,
    typer.Option(metavar="R", help="Cut between neighbours whose depths differ by more; default: by shape and noise"),
]


def warp(
    sources: Sources,
    output: Annotated[Path, typer.Option("--output", "-o", help="The new view; several: OUT_0000, ... or a video")],
    *,
    reading: Reading,
    lens: LensOptions,
    stored: StoredDepth,
    to: _To = None,
    move: _MoveOption = None,
    orbit: _Orbit = None,
    frames: _Frames = 1,
    together: Annotated[bool, typer.Option("--together", help="All frames of a recording show one scene")] = False,
    method: Annotated[Method, typer.Option(help="How surfaces are found")] = "epipolar",
    interpolation: Annotated[Interpolation, typer.Option(help="Interpolation of depth and colour")] = "linear",
    edges: Annotated[Edges, typer.Option(help="Cut neighbours at depth edges, or connect them to one surface")] = "cut",
    cut_ratio: _CutRatio = None,
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
    targets = Targets(to, move, orbit, frames)
    inputs = Inputs(sources, reading, lens, stored, together)
    count = targets.count(None if inputs.is_scene else inputs.count)
    numbers = inputs.numbers or (None if count is None else range(count))
    outputs = Outputs(_files(output, depth_out, valid_out), stored, numbers, video, inputs.film)
    outputs.check({**inputs.files, "--to": [] if to is None else [to]}, sources)
    done = _done(outputs, count, output) if skip_existing else set[int]()
    how: WarpOptions = {"method": method, "interpolation": interpolation, "edges": edges, "cut_ratio": cut_ratio}
    how |= {"side": side, "fill": fill_of(fill), "thin": thin, "blend": blend}
    draw = functools.partial(drawn_views, samples=samples, how=how)
    with device_of(device), outputs:
        size = _write(_jobs(inputs, targets, count, done), draw, outputs, count)
    outputs.tell(size, "views", f"{printable_text(sources[0])} is out of view", inputs.seen)


def _files(output: Path, depth_out: Path | None, valid_out: Path | None) -> dict[str, tuple[Path | None, Kind]]:
    """Files to write and their kind, by option."""
    return {"--output": (output, "color"), "--depth-out": (depth_out, "depth"), "--valid-out": (valid_out, "mask")}


def _done(outputs: Outputs, count: int | None, output: Path) -> set[int]:
    """Numbers of the frames whose files exist; exit if all do."""
    done = outputs.done()
    if len(done) == (count or 1):
        typer.echo(f"{printable_text(output)}: all files exist already")
        raise typer.Exit
    return done


def _jobs(inputs: Inputs, targets: Targets, count: int | None, done: set[int]) -> Iterator[Job]:
    """Yield the views to draw, except finished ones."""
    if inputs.numbers is None:
        for _, views in inputs.frames():
            yield from (job for job in targets.of_scene(views, count) if job.number not in done)
    else:
        for place, views in inputs.frames(done):
            yield targets.of_frame(views, place, inputs.numbers[place])


def _write(jobs: Iterable[Job], draw: _Draw, outputs: Outputs, count: int | None) -> tuple[int, int]:
    """Draw and write the views; return the size of the last view."""
    size = 0, 0
    for views, target, number in with_progress(read_ahead(jobs), count or 1, "Warping"):
        (frame,) = draw(views, [target])
        images: dict[Kind, NDArray[Any]] = {"color": frame.color, "depth": frame.depth, "mask": frame.valid}
        outputs.write(images, number, float(frame.valid.mean()), target)
        size = target.size
    return size
