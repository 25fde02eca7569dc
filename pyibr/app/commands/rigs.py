"""`pyibr stereo` and `pyibr quilt`: pictures of several cameras in one, from images with depth and recordings."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
import typer
from numpy.typing import NDArray

from pyibr.app.commands.beside import read_ahead
from pyibr.app.commands.outputs import Outputs, VideoOptions
from pyibr.app.commands.progress import with_progress
from pyibr.app.commands.reading import Inputs, Reading, Sources
from pyibr.app.commands.warp import drawn_views
from pyibr.app.options import DeviceName, FillOption, Samples, device_of, fill_of, printable_text
from pyibr.capture.quilt import QuiltRig, suffix_of, tiled
from pyibr.capture.rigs import Rig, with_background
from pyibr.capture.stereo import SUFFIXES, Layout, StereoRig, SyntheticView, joined

_Output = Annotated[
    Path,
    typer.Option(
        "--output",
        "-o",
        help="The picture; a recording: OUT_0000, ... or a video; or a folder, for a name that displays recognise",
    ),
]


class DrawingOptions(NamedTuple):
    """Options of the inputs and of their drawing."""

    fill: FillOption = "background"
    samples: Samples = 1
    reading: Reading = Reading()
    video: VideoOptions = VideoOptions()
    device: DeviceName = None


def stereo(
    sources: Sources,
    output: _Output,
    layout: Annotated[
        Layout,
        typer.Option(help="Side by side (sbs) or top and bottom (tb), full or half; or an anaglyph: dubois, gray"),
    ] = "full-sbs",
    divergence: Annotated[
        float, typer.Option(help="Shift of the nearest relative to the farthest, in per cent of the width")
    ] = 2.0,
    convergence: Annotated[
        float, typer.Option(help="Depth in the screen's plane: 0, the farthest, to 1, the nearest")
    ] = 0.5,
    synthetic_view: Annotated[
        SyntheticView, typer.Option(help="Eyes that are rendered beside the camera; any other eye is at the camera")
    ] = "both",
    depth_range: Annotated[
        tuple[float, float] | None,
        typer.Option(metavar="NEAR FAR", help="Nearest and farthest depth; default: by the first frame"),
    ] = None,
    *,
    drawing: DrawingOptions,
) -> None:
    """Draw an image with depth, or each frame of a recording, for two eyes."""
    rig = StereoRig(divergence, convergence, synthetic_view, depth_range)
    _draw(rig, drawing, sources, output, lambda _: SUFFIXES[layout], functools.partial(joined, layout=layout))


def quilt(
    sources: Sources,
    output: _Output,
    grid: Annotated[
        tuple[int, int], typer.Option(metavar="COLUMNS ROWS", help="Views side by side, and rows of views")
    ] = (8, 6),
    size: Annotated[
        tuple[int, int] | None,
        typer.Option(metavar="W H", help="Size of each view, cut from the picture's middle; default: the picture's"),
    ] = None,
    cone: Annotated[
        float, typer.Option(metavar="DEGREES", help="Angle between the outermost views, seen from the focus")
    ] = 20.0,
    focus: Annotated[
        float | None, typer.Option(metavar="DEPTH", help="Depth that appears in the display's plane; default: median")
    ] = None,
    *,
    drawing: DrawingOptions,
) -> None:
    """Draw an image with depth, or each frame of a recording, as a quilt for multi-view displays."""
    rig = QuiltRig(grid, size, cone, focus)
    _draw(rig, drawing, sources, output, lambda own: suffix_of(grid, size or own), functools.partial(tiled, grid=grid))


def _draw(
    rig: Rig,
    drawing: DrawingOptions,
    sources: list[Path],
    output: Path,
    suffix: Callable[[tuple[int, int]], str],
    joined: Callable[[Sequence[NDArray[Any]]], NDArray[Any]],
) -> None:
    """Write a joined picture of each frame as a rig's cameras see it, and report the files.

    rig: will be fitted to the first frame that has depth. suffix: in a folder, files have the source's name and the
    suffix for its size. joined: joins the cameras' pictures to one picture.
    """
    inputs = Inputs(sources, drawing.reading)
    kind = ".png" if inputs.numbers is None else ".mp4"
    main = output / f"{sources[0].stem}{suffix(inputs.size)}{kind}" if output.is_dir() or not output.suffix else output
    outputs = Outputs({"--output": (main, "color")}, drawing.reading.stored, inputs.numbers, drawing.video, inputs.film)
    outputs.check(inputs.files, sources)
    with device_of(drawing.device), outputs:
        for place, views in with_progress(read_ahead(inputs.frames()), inputs.count, "Drawing"):
            first = views[0]
            rig = rig.fitted(lambda first=first: first.depth[first.valid])
            cameras, fill = rig.cameras(first.camera), fill_of(drawing.fill)
            made = drawn_views(with_background(views, cameras, fill), cameras, drawing.samples, {"fill": fill})
            covered = float(np.mean([one.valid.mean() for one in made]))
            picture, number = joined([one.color for one in made]), inputs.numbers[place] if inputs.numbers else 0
            outputs.write({"color": picture}, number, covered, made[0].camera)
    outputs.tell("pictures", f"{printable_text(inputs.name)} is out of view", inputs.seen)
