"""`pyibr doctor`: checks the OpenCL devices of this machine, and builds their kernels."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Annotated

import numpy as np
import typer

import pyibr as ibr
from pyibr.app.commands.progress import with_progress
from pyibr.opencl.doctor import print_report
from pyibr.opencl.program import keeping_binaries

_SIZE = (40, 30)
_CAMERA = ibr.Camera([[40, 0, 20], [0, 40, 15], [0, 0, 1]], _SIZE)
_ASIDE, _BEYOND = _CAMERA.moved(0.2, 0, 0), _CAMERA.moved(0.2, 0.1, 0.2)
_HEIGHTS, _COLORS = np.full((8, 8), 0.5, np.float32), np.zeros((8, 8, 3), np.uint8)


@functools.cache
def _view(step: float = 0.0) -> ibr.DepthImage:
    """A box in front of a wall, seen from `step` scene units to the right."""
    depth = np.full(_SIZE[::-1], 4.0, np.float32)
    depth[8:20, 10:24] = 3.0
    return ibr.DepthImage(np.zeros((*depth.shape, 3), np.uint8), depth, _CAMERA.moved(step, 0, 0))


@functools.cache
def _square() -> ibr.Mesh:
    corners = np.array([[-1, -1, 4], [1, -1, 4], [1, 1, 4], [-1, 1, 4]], np.float32)
    uv = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float32)
    return ibr.Mesh(corners, np.array([[0, 2, 1], [0, 3, 2]]), uv=uv, texture=np.zeros((4, 4, 3), np.uint8))


PICTURES: tuple[Callable[[], object], ...] = (
    lambda: ibr.warp(_view(), _BEYOND),
    lambda: ibr.warp(_view(), _ASIDE, fill="background"),
    lambda: ibr.warp(_view(), _BEYOND, edges="connect"),
    lambda: ibr.warp(_view(), _ASIDE, edges="connect"),
    lambda: ibr.warp(_view(), _BEYOND, classes=True),
    lambda: ibr.warp([_view(), _view(0.3)], _BEYOND),
    lambda: ibr.warp(_view(), _BEYOND, fill="smooth", samples=4),
    lambda: ibr.render(_view(), _BEYOND),
    lambda: ibr.clean_depth(_view().depth, np.zeros((*_SIZE[::-1], 3), np.uint8)),
    lambda: ibr.render([_square(), ibr.Mesh(_square().vertices, _square().faces)], _BEYOND),
    lambda: ibr.render(_square(), _BEYOND, ibr.Light(direction=(0, 0, 1))),
    lambda: ibr.render([_view(), _square()], _BEYOND, ibr.Light(direction=(0, 0, 1))),
    lambda: ibr.render(ibr.SlicedSurface(_square(), _HEIGHTS, _COLORS, scale=0.1), _BEYOND),
    lambda: ibr.render(ibr.ReliefSurface(_square(), _HEIGHTS, _COLORS, scale=0.1), _BEYOND),
    lambda: ibr.render(ibr.DepthObject([_view(), _view(0.3)]), _BEYOND),
    lambda: ibr.render(ibr.DepthMesh(_view()), _BEYOND),
    lambda: ibr.render(ibr.DepthMeshObject([_view(), _view(0.3)]), _BEYOND),
)
"""Small pictures, one for each common way of drawing: drawing them all builds their kernels."""


def doctor(
    build: Annotated[
        bool, typer.Option("--build", help="Build the kernels of all systems now, so that first pictures are fast")
    ] = False,
) -> None:
    """List the OpenCL devices, whether each works, and how to repair devices that do not."""
    if not print_report():
        raise typer.Exit(1)
    if not build:
        return
    with keeping_binaries():
        for draw in with_progress(PICTURES, len(PICTURES), "building kernels"):
            draw()
    typer.echo(f"The kernels of {len(PICTURES)} kinds of pictures are built.")
