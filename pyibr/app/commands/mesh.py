"""`pyibr mesh`: a triangle mesh of an image with depth."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import pyibr as ibr
from pyibr.app.commands.cameras import LensOptions
from pyibr.app.commands.command import tell_written
from pyibr.app.commands.exposure import Exposure
from pyibr.app.commands.outputs import check_outputs
from pyibr.app.options import (
    Baseline,
    CameraFile,
    Clean,
    Color,
    DefaultDepthText,
    Depth,
    DeviceName,
    ExposureOption,
    Holes,
    NoiseOption,
    StoredDepth,
    cleaning_of,
    default_depth_of,
    deviation_of,
    device_of,
    noise_of,
)
from pyibr.depthmesh.segmentation import Segmentation, Test
from pyibr.images import DepthImage
from pyibr.meshes.files import check_mesh_file


def mesh(
    color: Color,
    depth: Depth,
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
    camera: CameraFile = None,
    *,
    lens: LensOptions,
    clean: Clean = False,
    holes: Holes = 8,
    noise: NoiseOption = None,
    baseline: Baseline = None,
    stored: StoredDepth,
    default_depth: DefaultDepthText = "none",
    exposure: ExposureOption = 0.0,
    device: DeviceName = None,
) -> None:
    """Turn an image with depth into a textured triangle mesh, simplified to an error or a number of triangles."""
    check_outputs({"COLOR": [color], "DEPTH": [depth], "--camera": [camera] if camera else []}, {"--output": [output]})
    check_mesh_file(output, textured=True, colored=True)
    own, how = lens.camera_of(color, camera), cleaning_of(clean, holes)
    with Exposure(exposure) as exposed:
        image = exposed.read(color)
    depths = stored.read(depth, own)
    told = deviation_of(noise_of(noise, baseline), own)
    if how is not None:
        depths, told = ibr.clean_depth(depths, image, noise=told, **how._asdict()).depth, None
    behind = default_depth_of(default_depth)
    view = DepthImage(image, depths, own, far=stored.empty_from, default_depth=behind, noise=told)
    with device_of(device):
        made = ibr.DepthMesh(view, segmentation=Segmentation(segmentation)).simplify(max_error, count=count)
    made.save(output)
    triangles = len(made.faces)
    share = triangles / (2 * (view.camera.width - 1) * (view.camera.height - 1))
    tell_written([output], f"{triangles} triangles, {share:.1%} of the full grid's", triangles=triangles)
