"""`pyibr doctor`: checks the OpenCL devices of this machine, and builds their kernels."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from pyibr.app.commands.pictures import PICTURES
from pyibr.opencl.binaries import read_all
from pyibr.opencl.doctor import print_report


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
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True, soft_wrap=True), disable=not sys.stderr.isatty()) as progress:
        drawing = progress.add_task("building kernels", total=len(PICTURES))
        for draw in PICTURES:
            draw()
            progress.advance(drawing)
        keeping = progress.add_task("keeping them", total=None)
        read_all(lambda left, total: progress.update(keeping, total=total, completed=total - left))
    typer.echo(f"The kernels of {len(PICTURES)} kinds of pictures are built.")
