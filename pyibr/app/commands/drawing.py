"""Frames drawn by the warp, and pictures joined from several of them."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray

import pyibr as ibr
from pyibr.app.commands.beside import read_ahead
from pyibr.app.commands.outputs import Outputs, VideoOptions
from pyibr.app.commands.progress import with_progress
from pyibr.app.commands.reading import Inputs
from pyibr.app.options import StoredDepth, printable_text
from pyibr.capture.rigs import Rig
from pyibr.core.camera import Camera
from pyibr.images import DepthImage, Frame
from pyibr.warp.view import WarpOptions

OutputOrFolder = Annotated[
    Path,
    typer.Option(
        "--output",
        "-o",
        help="The picture; a recording: OUT_0000, ... or a video; or a folder, for a name that displays recognise",
    ),
]


def drawn_views(
    views: Sequence[DepthImage], cameras: Sequence[Camera], samples: int, how: WarpOptions
) -> list[ibr.Frame]:
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


def picture_outputs(
    inputs: Inputs, sources: Sequence[Path], output: Path, suffix: str, stored: StoredDepth, video: VideoOptions
) -> Outputs:
    """The outputs; in a folder, files have the source's name with a suffix that displays recognise."""
    kind = ".png" if inputs.numbers is None else ".mp4"
    main = output / f"{sources[0].stem}{suffix}{kind}" if output.is_dir() else output
    outputs = Outputs({"--output": (main, "color")}, stored, inputs.numbers, video, inputs.film)
    outputs.check(inputs.files, sources)
    return outputs


def write_pictures(
    inputs: Inputs,
    outputs: Outputs,
    rig: Rig,
    joined: Callable[[Sequence[NDArray[Any]]], NDArray[Any]],
    samples: int,
    how: WarpOptions,
) -> None:
    """Write a joined picture of each frame as a rig's cameras see it, and report the files.

    rig: will be fitted to the first frame that has depth. joined: joins the cameras' pictures to one picture.
    """
    size = 0, 0
    with outputs:
        for place, views in with_progress(read_ahead(inputs.frames()), inputs.count, "Drawing"):
            first = views[0]
            rig = rig.fitted(lambda first=first: first.depth[first.valid])
            made = drawn_views(views, rig.cameras(first.camera), samples, how)
            picture = joined([one.color for one in made])
            covered = float(np.mean([one.valid.mean() for one in made]))
            outputs.write({"color": picture}, inputs.numbers[place] if inputs.numbers else 0, covered, made[0].camera)
            size = picture.shape[1], picture.shape[0]
    outputs.tell(size, "pictures", f"{printable_text(inputs.name)} is out of view", inputs.seen)
