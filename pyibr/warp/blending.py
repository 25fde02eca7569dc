"""Several views of one scene in one picture: each shows the more the better it saw what is there."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np

from pyibr.core.checks import Float64
from pyibr.core.pixelspace import longer_side
from pyibr.images.depth_image import DepthImage
from pyibr.images.exposure import Overlap, matching_gains
from pyibr.opencl.device import current
from pyibr.opencl.headers import constant, struct
from pyibr.opencl.launch import Struct, launch
from pyibr.opencl.memory import empty, to_host
from pyibr.opencl.program import kernel
from pyibr.picture.deferred import NO_ENTRY, Entry
from pyibr.picture.target import Target

Blend = Literal["quality", "nearest"]

_STRIDE = 3  # pixels: every third one of each third row tells the exposures
_SAME_DEPTH = 0.02  # of the depth, or of what an orthographic camera sees


def blend(layers: Sequence[Target], views: Sequence[DepthImage], target: Target, entry: Entry = NO_ENTRY) -> None:
    """Draw the picture that the views' layers, each drawn from one of them alone, make together.

    `entry` is that of a picture in a light; if it draws normals, the layers have them.
    """
    camera = target.camera
    width, height = camera.size
    lanes, margin = current().profile.lanes, int(constant("warp/blend.cl", "FEATHER"))
    pitch = -(-width // lanes) * lanes + 2 * margin
    best = empty((2, height, width), np.float32)
    sums = empty((9 if entry.normals else 6, height, width), np.float32)
    edges, in_row = (empty((height + 2 * margin, pitch), np.float32) for _ in range(2))
    grid = current().profile.packets(width, height)
    size = {"width": width, "height": height}
    defines = {**target.color_defines, **entry.defines, "ORIGINS": int(target.origin is not None)}
    seeing = [Struct("LayerView", _layer_view(view, target)) for view in views]
    for number, (layer, saw) in enumerate(zip(layers, seeing, strict=True)):
        made = kernel("warp/blend.cl", "nearest_layer", **defines)
        launch(made, grid, depth=layer.depth, best=best, first=number == 0, layer_view=saw, **size)
    for number, (layer, saw, gains) in enumerate(zip(layers, seeing, exposures(layers), strict=True)):
        padded = current().profile.packets(width + 2 * margin, height + 2 * margin)
        of_edges: dict[str, Any] = {**size, "pitch": pitch, "from_edge": edges}
        launch(kernel("warp/blend.cl", "mark_edges", **defines), padded, depth=layer.depth, layer_view=saw, **of_edges)
        rows = (grid[0], height + 2 * margin)
        launch(kernel("warp/blend.cl", "row_distances", **defines), rows, in_row=in_row, **of_edges)
        of_layer: dict[str, Any] = {}
        if target.origin is not None:
            of_layer = {"layer_origin": layer.origin, "origin": target.origin}
        if entry.normals and layer.gbuffer is not None:
            of_layer["normals"] = layer.gbuffer.normal
        launch(
            kernel("warp/blend.cl", "add_layer", **defines),
            grid,
            depth=layer.depth,
            color=layer.color,
            best=best,
            in_row=in_row,
            sums=sums,
            screen=Struct("Screen", target.screen(0.5, camera.center)),
            layer_view=saw,
            density=float(camera.K[0, 0] * camera.K[1, 1]),
            pitch=pitch,
            first=number == 0,
            red=gains[0],
            green=gains[1],
            blue=gains[2],
            **of_layer,
        )
    into: dict[str, Any] = {"merge": not target.blank, **size, **target.outputs(), **entry.arguments}
    launch(kernel("warp/blend.cl", "write_blend", **defines), grid, sums=sums, **into)
    target.blank = False


def exposures(layers: Sequence[Target]) -> Float64:
    """(N, 3) what each layer's colours are to be multiplied by, so that they agree where layers show one surface."""
    if layers[0].color.shape[2] == 0:
        return np.ones((len(layers), 3))
    most = 255.0 if layers[0].color.dtype == np.uint8 else 1.0
    hosts = to_host([array for layer in layers for array in (layer.color, layer.depth)])
    colors = [host[::_STRIDE, ::_STRIDE] / np.float32(most) for host in hosts[::2]]
    depths = [host[::_STRIDE, ::_STRIDE] for host in hosts[1::2]]
    overlaps: list[Overlap] = []
    camera = layers[0].camera
    for a in range(len(layers)):
        unit = longer_side(camera) if camera.projection == "orthographic" else depths[a]
        for b in range(a):
            same = np.abs(depths[a] - depths[b]) < _SAME_DEPTH * unit
            overlaps.append(Overlap(a, b, colors[a][same], colors[b][same]))
    return matching_gains(len(layers), overlaps)


def _layer_view(view: DepthImage, target: Target) -> np.ndarray[Any, np.dtype[np.void]]:
    """A record of the kernels' struct LayerView."""
    camera = view.camera
    values = np.zeros((), struct("warp/blend.cl", "LayerView"))
    values["forward"], values["centre"] = camera.forward, camera.center - target.camera.center
    values["density"] = camera.K[0, 0] * camera.K[1, 1]
    values["perspective"] = camera.projection == "perspective"
    values["noise_2"], values["noise_1"], values["noise_0"] = view.noise
    if target.camera.projection == "orthographic":
        values["unit"] = longer_side(target.camera)
    return values
