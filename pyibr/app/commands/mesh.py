"""`pyibr mesh`: a triangle mesh of an image with depth."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import pyibr as ibr
from pyibr.app.commands.command import tell_written
from pyibr.app.commands.exposure import Exposure
from pyibr.app.commands.outputs import check_outputs
from pyibr.app.commands.things import ImageOptions, UpOption, check_up, save_upright
from pyibr.app.options import DeviceName, device_of
from pyibr.depthmesh.segmentation import Segmentation, Test
from pyibr.meshes.files import check_mesh_file


def mesh(
    color: Annotated[Path, typer.Argument(metavar="COLOR", help="Image: PNG, JPEG, TIFF, EXR, PFM, NPY ...")],
    depth: Annotated[
        Path, typer.Argument(metavar="DEPTH", help="Its planar depth: PNG, TIFF, NPY, NPZ, PFM, EXR, COLMAP .bin")
    ],
    output: Annotated[Path, typer.Option("--output", "-o", help="The mesh: GLB, OBJ (with the image as texture), PLY")],
    max_error: Annotated[
        float | None, typer.Option(help="Largest error of the depths, in scene units; 0: exact")
    ] = None,
    count: Annotated[
        int | None, typer.Option(help="Largest number of triangles; the flattest are merged first")
    ] = None,
    segmentation: Annotated[
        Test, typer.Option(help="Test that detects triangles between two surfaces")
    ] = "orthogonality",
    up: UpOption = None,
    *,
    options: ImageOptions,
    device: DeviceName = None,
) -> None:
    """Turn an image with depth into a textured triangle mesh, simplified to an error or a number of triangles."""
    camera = [options.camera] if options.camera else []
    check_outputs({"COLOR": [color], "DEPTH": [depth], "--camera": camera}, {"--output": [output]})
    check_mesh_file(output)
    check_up(up, output)
    with device_of(device):
        with Exposure(options.exposure) as exposed:
            view = options.image(color, depth, exposed)
        made = ibr.DepthMesh(view, segmentation=Segmentation(segmentation)).simplify(max_error, count=count)
    remark = save_upright(made, output, up)
    triangles = len(made.faces)
    share = triangles / (2 * (view.camera.width - 1) * (view.camera.height - 1))
    tell_written([output], f"{triangles} triangles, {share:.1%} of the full grid's{remark}", triangles=triangles)
