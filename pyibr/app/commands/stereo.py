"""`pyibr stereo`: pictures for two eyes, from images with depth and from recordings."""

from __future__ import annotations

import functools
from typing import Annotated

import typer

from pyibr.app.commands.cameras import LensOptions
from pyibr.app.commands.drawing import OutputOrFolder, picture_outputs, write_pictures
from pyibr.app.commands.outputs import VideoOptions
from pyibr.app.commands.reading import Inputs, Reading, Sources
from pyibr.app.options import DeviceName, FillOption, Samples, StoredDepth, device_of, fill_of
from pyibr.capture.stereo import SUFFIXES, Layout, StereoRig, SyntheticView, joined

_LAYOUT = "Side by side (sbs) or top and bottom (tb), full or half; or an anaglyph: dubois, gray"
_Divergence = Annotated[
    float, typer.Option(help="Shift of the nearest relative to the farthest, in per cent of the width")
]
_Convergence = Annotated[float, typer.Option(help="Depth in the screen's plane: 0, the farthest, to 1, the nearest")]
_Synthetic = Annotated[
    SyntheticView, typer.Option(help="Eyes that are rendered beside the camera; any other eye is at the camera")
]
_Range = Annotated[
    tuple[float, float] | None,
    typer.Option(metavar="NEAR FAR", help="Nearest and farthest depth; default: by the first frame"),
]


def stereo(
    sources: Sources,
    output: OutputOrFolder,
    layout: Annotated[Layout, typer.Option(help=_LAYOUT)] = "full-sbs",
    divergence: _Divergence = 2.0,
    convergence: _Convergence = 0.5,
    synthetic_view: _Synthetic = "both",
    depth_range: _Range = None,
    fill: FillOption = "background",
    samples: Samples = 1,
    *,
    reading: Reading,
    lens: LensOptions,
    stored: StoredDepth,
    video: VideoOptions,
    device: DeviceName = None,
) -> None:
    """Draw an image with depth, or each frame of a recording, for two eyes."""
    rig = StereoRig(divergence, convergence, synthetic_view, depth_range)
    inputs = Inputs(sources, reading, lens, stored)
    outputs = picture_outputs(inputs, sources, output, SUFFIXES[layout], stored, video)
    with device_of(device):
        write_pictures(inputs, outputs, rig, functools.partial(joined, layout=layout), samples, {"fill": fill_of(fill)})
