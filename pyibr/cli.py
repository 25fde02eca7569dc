"""The command line: `pyibr warp`, `pyibr mesh` and `pyibr doctor`."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import typer
from typer.core import TyperGroup

import pyibr as ibr
from pyibr.core.camera import Camera
from pyibr.core.errors import ArgumentError, Error
from pyibr.depthmesh.segmentation import Segmentation, Test
from pyibr.images import DepthImage
from pyibr.opencl.doctor import print_report
from pyibr.picture.drawable import Edges, Fill, Sample, Side
from pyibr.warp.warp import Method

_OPTIONS = {
    "view": "DEPTH",
    "scale": "--depth-scale",
    "cut_ratio": "--cut-ratio",
    "far": "--far",
    "degrees": "--orbit",
    "max_error": "--max-error",
    "path": "--output",
    "device": "--device",
}
"""What users of the command line call the library's arguments."""


_Color = Annotated[Path, typer.Argument(metavar="COLOR", help="Image: PNG, JPEG, TIFF, EXR, PFM, NPY ...")]
_Depth = Annotated[
    Path, typer.Argument(metavar="DEPTH", help="Its planar depth: PNG16, NPY, NPZ, PFM, EXR, COLMAP .bin")
]
_Camera = Annotated[Path, typer.Option(help="Its camera: JSON with width, height, K, world_from_camera")]
_Far = Annotated[float, typer.Option(help="Depth from which on there is no surface")]
_Scale = Annotated[float | None, typer.Option(help="Stored depth units per scene unit: 1000 for millimetres to metres")]
_DeviceName = Annotated[str | None, typer.Option(help="OpenCL device: part of its name, or its number")]


class _OneLineErrors(TyperGroup):
    """Shows what pyibr raises on purpose as one line, without a traceback."""

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except Error as error:
            text = str(error)
            if isinstance(error, ArgumentError) and error.argument in _OPTIONS:
                text = _OPTIONS[error.argument] + text.removeprefix(error.argument)
            typer.secho(f"pyibr: {text}", err=True, fg="red")
            raise typer.Exit(2) from error


app = typer.Typer(
    cls=_OneLineErrors,
    help="New views from images with depth, on any OpenCL device.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"pyibr {ibr.__version__}")
        raise typer.Exit


@app.callback()
def _main(  # pyright: ignore[reportUnusedFunction]
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    pass


@app.command(
    epilog="Example: [bold]pyibr warp color.png depth.png --depth-scale 1000 --camera camera.json "
    "--orbit 10 -o new.png[/bold]"
)
def warp(
    color: _Color,
    depth: _Depth,
    camera: _Camera,
    output: Annotated[Path, typer.Option("--output", "-o", help="The new view")],
    to: Annotated[Path | None, typer.Option(help="The new view's camera: JSON")] = None,
    move: Annotated[
        tuple[float, float, float] | None,
        typer.Option(metavar="X Y Z", help="Move the camera right, down and forward, in scene units"),
    ] = None,
    orbit: Annotated[
        float | None,
        typer.Option(
            metavar="DEGREES",
            help="Turn to the right about the point at the median depth on the optical axis",
        ),
    ] = None,
    frames: Annotated[
        int, typer.Option(min=1, help="Views along --move or --orbit, the source's first: OUT_0000, ...")
    ] = 1,
    method: Annotated[Method, typer.Option(help="How the surface is searched")] = "epipolar",
    sample: Annotated[Sample, typer.Option(help="How depth and colour are read")] = "linear",
    edges: Annotated[Edges, typer.Option(help="Neighbours are cut apart at depth edges, or one surface")] = "cut",
    cut_ratio: Annotated[float, typer.Option(help="Cut where neighbours' depths differ by more")] = 1.05,
    fill: Annotated[Literal["none", Fill], typer.Option(help="Fill holes from their farther side")] = "none",
    side: Annotated[Side, typer.Option(help="Sides of the surface that are shown")] = "front",
    far: _Far = math.inf,
    depth_scale: _Scale = None,
    depth_out: Annotated[Path | None, typer.Option(help="Write the new view's depth too")] = None,
    valid_out: Annotated[Path | None, typer.Option(help="Write the mask of what is no hole too")] = None,
    device: _DeviceName = None,
) -> None:
    """Render a new view of an image with depth.

    Give the new camera by exactly one of --to, --move and --orbit.
    """
    given = [name for name, value in (("--to", to), ("--move", move), ("--orbit", orbit)) if value is not None]
    if len(given) != 1:
        raise ArgumentError("new camera", "one of --to, --move, --orbit", " and ".join(given) or "none")
    if frames > 1 and to is not None:
        raise ArgumentError("--frames", "1 with --to (a path needs --move or --orbit)", str(frames))
    if depth_out is not None and depth_out.suffix.lower() == ".png" and depth_scale is None:
        raise ArgumentError("--depth-scale", f"stored units per scene unit, for the integers of {depth_out}", "none")
    source = Camera.load(camera)
    view = DepthImage(ibr.read_color(color), ibr.read_depth(depth, depth_scale), source, far)
    targets = [Camera.load(to)] if to is not None else list(_path(view, move, orbit, frames))
    with ibr.use_device(device) if device else nullcontext():
        for number, target in enumerate(_with_progress(targets)):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", UserWarning)  # an empty view is told below, with the file's name
                filled = None if fill == "none" else fill
                frame = ibr.warp(view, target, method, sample, edges, filled, cut_ratio=cut_ratio, side=side)
            name = _numbered(output, number, frames)
            ibr.write_color(name, frame.color)
            if depth_out is not None:
                ibr.write_depth(_numbered(depth_out, number, frames), frame.depth, depth_scale)
            if valid_out is not None:
                ibr.write_mask(_numbered(valid_out, number, frames), frame.valid)
            if not frame.valid.any():
                typer.secho(f"{name} is empty: its camera sees nothing of {color}", err=True, fg="yellow")
            elif frames == 1:
                typer.echo(f"{name}: {target.width}x{target.height}, {frame.valid.mean():.1%} covered")


@app.command(
    epilog="Example: [bold]pyibr mesh color.png depth.png --depth-scale 1000 --camera camera.json "
    "--max-error 0.005 -o scene.glb[/bold]"
)
def mesh(
    color: _Color,
    depth: _Depth,
    camera: _Camera,
    output: Annotated[Path, typer.Option("--output", "-o", help="The mesh: GLB, OBJ (with the image as texture), PLY")],
    max_error: Annotated[float, typer.Option(help="Depths may be off by that, in scene units; 0: by nothing")],
    segmentation: Annotated[Test, typer.Option(help="How triangles between two surfaces are told")] = "orthogonality",
    far: _Far = math.inf,
    depth_scale: _Scale = None,
    device: _DeviceName = None,
) -> None:
    """Turn an image with depth into a textured triangle mesh, simplified within an error."""
    view = DepthImage(ibr.read_color(color), ibr.read_depth(depth, depth_scale), Camera.load(camera), far)
    with ibr.use_device(device) if device else nullcontext():
        made = ibr.DepthMesh(view, segmentation=Segmentation(segmentation)).simplify(max_error)
    made.save(output)
    share = len(made.faces) / (2 * (view.camera.width - 1) * (view.camera.height - 1))
    typer.echo(f"{output}: {len(made.faces)} triangles, {share:.1%} of the full grid's")


@app.command(epilog="Example: [bold]pyibr doctor[/bold]")
def doctor() -> None:
    """Show the OpenCL devices, whether each works, and what mends those that do not."""

    if not print_report():
        raise typer.Exit(1)


def _path(
    view: DepthImage, move: tuple[float, float, float] | None, orbit: float | None, frames: int
) -> Iterator[Camera]:
    """Cameras from the source's to the last, or the last alone if `frames` is 1."""
    source = view.camera
    if not view.valid.any():
        raise ArgumentError("depth", "at least one valid sample", "none")
    pivot = source.center + source.forward * float(np.median(view.depth[view.valid]))
    for part in np.linspace(0, 1, frames) if frames > 1 else [1.0]:
        if move is not None:
            yield source.moved(*(part * np.array(move)))
        elif orbit is not None:
            yield source.orbited(part * orbit, pivot)


def _numbered(path: Path, number: int, frames: int) -> Path:
    return path if frames == 1 else path.with_name(f"{path.stem}_{number:04d}{path.suffix}")


def _with_progress(targets: list[Camera]) -> Iterable[Camera]:
    if len(targets) == 1:
        return targets
    from rich.console import Console
    from rich.progress import track

    return track(targets, "Warping", console=Console(stderr=True))
