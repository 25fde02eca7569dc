"""`pyibr doctor`: checks the OpenCL devices of this machine, and builds their kernels."""

from __future__ import annotations

from typing import Annotated

import typer

from pyibr.app.commands.pictures import PICTURES
from pyibr.app.commands.progress import with_progress
from pyibr.opencl.doctor import print_report
from pyibr.opencl.program import keeping_binaries


def doctor(
    build: Annotated[
        bool, typer.Option("--build", help="Build the kernels of all systems now, so that first pictures are fast")
    ] = False,
) -> None:
    """List the OpenCL devices, whether each works, and how to repair devices that do not."""
    if not print_report():
        raise typer.Exit(1)
    if build:
        build_kernels()


def build_kernels() -> None:
    """Draw each small picture, which builds its kernels, and keep their binaries."""
    with keeping_binaries():
        for draw in with_progress(PICTURES, len(PICTURES), "building kernels"):
            draw()
    typer.echo(f"The kernels of {len(PICTURES)} kinds of pictures are built.")
