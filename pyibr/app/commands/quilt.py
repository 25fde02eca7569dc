"""`pyibr quilt`: many views of an image with depth, or of a recording, in one picture."""

from __future__ import annotations

import functools
from typing import Annotated

import typer

from pyibr.app.commands.cameras import LensOptions
from pyibr.app.commands.drawing import OutputOrFolder, picture_outputs, write_pictures
from pyibr.app.commands.outputs import VideoOptions
from pyibr.app.commands.reading import Inputs, Reading, Sources
from pyibr.app.options import DeviceName, FillOption, Samples, StoredDepth, device_of, fill_of
from pyibr.capture.quilt import QuiltRig, suffix_of, tiled

_Grid = Annotated[tuple[int, int], typer.Option(metavar="COLUMNS ROWS", help="Views side by side, and rows of views")]
_Size = Annotated[
    tuple[int, int] | None,
    typer.Option(metavar="W H", help="Size of each view, cut from the picture's middle; default: the picture's"),
]
_Cone = Annotated[float, typer.Option(metavar="DEGREES", help="Angle between the outermost views, seen from the focus")]
_Focus = Annotated[
    float | None, typer.Option(metavar="DEPTH", help="Depth that appears in the display's plane; default: median")
]


def quilt(
    sources: Sources,
    output: OutputOrFolder,
    grid: _Grid = (8, 6),
    size: _Size = None,
    cone: _Cone = 20.0,
    focus: _Focus = None,
    fill: FillOption = "background",
    samples: Samples = 1,
    *,
    reading: Reading,
    lens: LensOptions,
    stored: StoredDepth,
    video: VideoOptions,
    device: DeviceName = None,
) -> None:
    """Draw an image with depth, or each frame of a recording, as a quilt for multi-view displays."""
    rig = QuiltRig(grid, size, cone, focus)
    inputs = Inputs(sources, reading, lens, stored)
    outputs = picture_outputs(inputs, sources, output, suffix_of(grid, size or inputs.size), stored, video)
    with device_of(device):
        write_pictures(inputs, outputs, rig, functools.partial(tiled, grid=grid), samples, {"fill": fill_of(fill)})
