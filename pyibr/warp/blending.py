"""Several views of one scene in one picture: the better a view saw a surface, the greater its weight."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal
from weakref import ref

import numpy as np

from pyibr.core.checks import Float64
from pyibr.core.pixelspace import PixelMap, Rectangle, longer_side, pitch
from pyibr.images.depth_image import DepthImage
from pyibr.opencl.device import current
from pyibr.opencl.device_cache import cached_on_device
from pyibr.opencl.headers import constant, struct
from pyibr.opencl.launch import Struct, launch
from pyibr.opencl.memory import DeviceArray, empty, upload
from pyibr.opencl.program import kernel
from pyibr.picture.deferred import NO_ENTRY, Entry
from pyibr.picture.surface import Surface
from pyibr.picture.target import Target
from pyibr.warp.launches import map_of

Blend = Literal["quality", "nearest"]

_HELD_BYTES = 1 << 26  # layers are kept up to this total size; all further views are drawn twice
_HELD_MIN = 6  # number of layers that are kept in any case
_CUTS_MAX = 4  # a view caches its samples' distances to edges for this many edge tests
NOISE_MAX = 1e18  # scene units: products of greater noise and depths may exceed single precision


@dataclass(frozen=True)
class Layer:
    """One view in a picture of several views."""

    number: int  # the view's index
    view: DepthImage
    pixel_map: PixelMap  # from the view to the picture
    area: Rectangle  # the pixels of the picture that drawing the layer writes
    surface: Surface  # the view's surface, with its edges
    gains: Float64  # (3,) factors of the view's colours


def blend(
    layers: Sequence[Layer],
    target: Target,
    draw: Callable[[Layer, Target], None],
    own: Target,
    entry: Entry = NO_ENTRY,
) -> None:
    """Draw the blended picture of some layers, which are added in their order.

    draw: draws a layer alone into a target. own: the target for one layer after the other, with normals if `entry`
    draws them. entry: the result of `entry_for` for the picture.
    """
    making = _Blending(target, own, draw, entry, len(layers))
    held, *others = (layers[at : at + making.held] for at in range(0, len(layers), making.held))
    # The nearest surface of all layers must be known before any layer is added. So layers not kept are drawn twice.
    for batch in [*others, held] if others else []:
        making.draw_layers(batch)
        making.find_nearest(batch, first=batch is others[0])
    if not others:
        making.draw_layers(held)
    making.add_layers(held, first=True, last=not others)
    for batch in others:
        making.draw_layers(batch)
        making.add_layers(batch, first=False, last=batch is others[-1])
    target.blank = False


class _Blending:
    """A picture in progress, and the layers that are kept."""

    def __init__(
        self, target: Target, own: Target, draw: Callable[[Layer, Target], None], entry: Entry, count: int
    ) -> None:
        self._target, self._own, self._draw, self._entry = target, own, draw, entry
        profile, (width, height) = current().profile, target.camera.size
        self._defines = {**target.color_defines, **entry.defines}
        self._defines["ORIGINS"] = int(target.source is not None)
        self._grid = profile.packets(width, height, profile.strip)
        self._pitch = pitch(width)
        words = -(-target.color.shape[2] * target.color.dtype.itemsize // 4)
        normals, origins = _number("NORMAL_PLANES") * entry.normals, self._defines["ORIGINS"]
        planes = _number("COLOR") + words + _number("ORIGIN_PLANES") * origins + normals
        self.held = min(max(_HELD_BYTES // (4 * planes * height * self._pitch), _HELD_MIN), count)
        self._stack = empty((self.held, planes, height, self._pitch), np.float32)
        sums = _number("GREATEST") + _number("ORIGIN_SUMS") * origins + normals
        self._sums, self._best = (
            empty((planes if self.held < count else 0, height, self._pitch), np.float32) for planes in (sums, 2)
        )
        self._unit = longer_side(target.camera) if target.camera.projection == "orthographic" else 0.0

    def draw_layers(self, layers: Sequence[Layer]) -> None:
        """Draw and weigh some of the layers, and keep them."""
        camera = self._target.camera
        for place, layer in enumerate(layers):
            self._draw(layer, self._own)
            more: dict[str, Any] = {}
            if self._own.source is not None:
                more["layer_source"] = self._own.source
            if self._entry.normals and self._own.gbuffer is not None:
                more["normals"] = self._own.gbuffer.normal
            launch(
                kernel("warp/blend.cl", "weigh_layer", **self._defines),
                self._grid,
                depth=self._own.depth,
                color=self._own.color,
                edges=edges_of(layer.view, layer.surface),
                stack=self._stack,
                layer=place,
                pitch=self._pitch,
                map=map_of(layer.pixel_map.pair),
                screen=Struct("Screen", self._target.screen(0.5, camera.center)),
                view=Struct("LayerView", _layer_view(layer, self._target)),
                density=float(camera.K[0, 0] * camera.K[1, 1]),
                **more,
            )

    def find_nearest(self, layers: Sequence[Layer], *, first: bool) -> None:
        """Find each pixel's nearest surface among the kept layers and, unless `first`, the layers of earlier calls."""
        nearest_layers = kernel("warp/blend.cl", "nearest_layers", **self._defines)
        launch(nearest_layers, self._grid, first=first, **self._held(layers))

    def _held(self, layers: Sequence[Layer]) -> dict[str, Any]:
        """Arguments of the kernels that read the kept layers."""
        width, height = self._target.camera.size
        return {
            "stack": self._stack,
            "best": self._best,
            "views": upload(np.array([_blended_view(layer) for layer in layers])),
            "count": len(layers),
            "pitch": self._pitch,
            "unit": self._unit,
            "width": width,
            "height": height,
        }

    def add_layers(self, layers: Sequence[Layer], *, first: bool, last: bool) -> None:
        """Add the kept layers to the layers of earlier calls; with `last`, complete the picture."""
        launch(
            kernel("warp/blend.cl", "blend_layers", **self._defines),
            self._grid,
            sums=self._sums,
            first=first,
            last=last,
            **self._held(layers),
            merge=not self._target.blank,
            **self._target.origins,
            **self._target.outputs(),
            **self._entry.arguments,
        )


def edges_of(view: DepthImage, surface: Surface) -> DeviceArray:
    """(H * W + 1,) uint16 distances of the view's samples to its edges (kernels/warp/view_edges.cl), found once."""
    return cached_on_device(view, "edges", lambda: _found_edges(view, surface), ref(surface.nearness), _CUTS_MAX)


def edge_view(view: DepthImage) -> Struct:
    """The kernels' struct EdgeView: the size of a view, and its limits for steps of the surface."""
    camera = view.camera
    values = np.zeros((), struct("warp/view_edges.cl", "EdgeView"))
    values["width"], values["height"], values["pitch"] = *camera.size, pitch(camera.width)
    values["perspective"] = camera.projection == "perspective"
    values["density"] = camera.K[0, 0] * camera.K[1, 1]
    values["noise_2"], values["noise_1"], values["noise_0"] = np.minimum(view.noise, NOISE_MAX)
    values["unit"] = longer_side(camera) if camera.projection == "orthographic" else 0.0
    return Struct("EdgeView", values)


def _found_edges(view: DepthImage, surface: Surface) -> DeviceArray:
    camera, profile = view.camera, current().profile
    margins = 2 * int(constant("warp/view_edges.cl", "FEATHER"))
    mark_pitch = pitch(camera.width + margins)
    size = {"width": camera.width, "height": camera.height, "mark_pitch": mark_pitch}
    marks, in_row = (empty((camera.height, mark_pitch), np.float32) for _ in range(2))
    edges = empty((camera.height * camera.width + 1,), np.uint16)  # the kernel reads one value beyond each position
    grid = profile.packets(camera.width + margins, camera.height)
    shared = {"marks": marks, "mark_pitch": mark_pitch}
    launch(kernel("warp/view_edges.cl", "mark_edges"), grid, surface=surface.nearness, view=edge_view(view), **shared)
    grid = profile.packets(*camera.size)
    launch(kernel("warp/view_edges.cl", "row_distances"), grid, marks=marks, in_row=in_row, **size)
    found = {"surface": surface.nearness, "edges": edges, "pitch": surface.nearness.shape[1]}
    launch(kernel("warp/view_edges.cl", "edge_distances"), grid, marks=marks, in_row=in_row, **found, **size)
    return edges


def _layer_view(layer: Layer, target: Target) -> np.ndarray[Any, np.dtype[np.void]]:
    """Record of the kernels' struct LayerView."""
    camera, area = layer.view.camera, layer.area
    values = np.zeros((), struct("warp/blend.cl", "LayerView"))
    values["forward"], values["centre"] = camera.forward, camera.center - target.camera.center
    values["density"] = camera.K[0, 0] * camera.K[1, 1]
    values["perspective"] = camera.projection == "perspective"
    for end in ("low_x", "high_x", "low_y", "high_y"):
        values[end] = getattr(area, end)
    return values


def _blended_view(layer: Layer) -> np.ndarray[Any, np.dtype[np.void]]:
    """Record of the kernels' struct BlendedView."""
    values = np.zeros((), struct("warp/blend.cl", "BlendedView"))
    values["red"], values["green"], values["blue"] = layer.gains
    values["noise_2"], values["noise_1"], values["noise_0"] = np.minimum(layer.view.noise, NOISE_MAX)
    values["number"] = layer.number
    return values


def _number(name: str) -> int:
    return int(constant("warp/blend.cl", name))
