"""`pyibr register`: depth and colour of two cameras."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

import pyibr as ibr
from pyibr.app.commands.outputs import check_outputs
from pyibr.app.words import Clean, Depth, DepthScale, DeviceName, device_of, printable
from pyibr.core.camera import Camera
from pyibr.core.errors import ArgumentError
from pyibr.io import check_output


def register(
    depth: Depth,
    depth_camera: Annotated[Path, typer.Option(help="The camera of the depth: JSON")],
    color_camera: Annotated[Path, typer.Option(help="The camera of the colours, in the same world: JSON")],
    output: Annotated[Path, typer.Option("--output", "-o", help="The registered depth; with --color, the colours")],
    color: Annotated[Path | None, typer.Option(help="Its image: write colours for the depth, black if unseen")] = None,
    clean: Clean = False,
    depth_scale: DepthScale = None,
    seen_out: Annotated[Path | None, typer.Option(help="With --color: write the mask of what has one, too")] = None,
    device: DeviceName = None,
) -> None:
    """Bring depth into a colour camera's image, or colours to the samples of depth."""
    if seen_out is not None and color is None:
        raise ArgumentError("--seen-out", "--color with it", "none")
    if color is None and output.suffix.lower() == ".png" and depth_scale is None:
        raise ArgumentError("--depth-scale", f"stored units per scene unit, for the integers of {output}", "none")
    check_output(output, "depth" if color is None else "color")
    if seen_out is not None:
        check_output(seen_out, "mask")
    inputs = {"DEPTH": [depth], "--depth-camera": [depth_camera], "--color-camera": [color_camera]}
    inputs["--color"] = [] if color is None else [color]
    check_outputs(inputs, {"--output": [output], "--seen-out": [] if seen_out is None else [seen_out]})
    given = ibr.read_depth(depth, depth_scale)
    given = ibr.clean_depth(given).depth if clean else given
    cameras = Camera.load(depth_camera), Camera.load(color_camera)
    with device_of(device):
        if color is None:
            made = ibr.register(given, *cameras)
            ibr.write_depth(output, made, depth_scale)
            size, covered = cameras[1].size, np.isfinite(made)
        else:
            found = ibr.register(given, *cameras, ibr.read_color(color), to="depth")
            ibr.write_color(output, found.color)
            if seen_out is not None:
                ibr.write_mask(seen_out, found.seen)
            size, covered = cameras[0].size, found.seen
    typer.echo(f"{printable(output)}: {size[0]}x{size[1]}, {covered.mean():.1%} covered")
