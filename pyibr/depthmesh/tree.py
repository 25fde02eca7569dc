"""The restricted quadtree over a depth image on the device (kernels/depthmesh/)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pyibr.core.checks import Float64
from pyibr.core.errors import ArgumentError
from pyibr.core.pixelspace import pitch
from pyibr.depthmesh.segmentation import NOISE_MAX, Segmentation
from pyibr.images import DepthImage
from pyibr.opencl.headers import constant, struct
from pyibr.opencl.launch import Struct, launch
from pyibr.opencl.memory import DeviceArray, empty
from pyibr.opencl.program import kernel
from pyibr.picture.samples import samples_of

ErrorsBy = Literal["sum", "largest"]

_KERNELS = "depthmesh/tree.cl"
_DEPTHS = (1e-4, 1e8)  # for depths outside, products of four distances leave the range of float32
_COARSE = 8  # from this step on, one work-item processes all rows: they are too few to divide


@dataclass(frozen=True)
class Tree:
    """The quadtree of a view: device arrays that the kernels in kernels/depthmesh/ compute for samples and vertices."""

    view: DepthImage
    layout: Struct  # `Layout` of kernels/depthmesh/tree.h
    side: int  # cells along the side, a power of two
    nearness: DeviceArray  # (H, pitch) of the samples
    cells: DeviceArray  # (H, pitch) uint8 states of each cell's two triangles: drawn or not
    joined: ErrorsBy  # rule that joins a vertex's error with its children's

    def drawn_cells(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Masks, (H - 1, W - 1): the cells whose upper triangle is drawn, and the cells whose lower triangle is."""
        width, height = self.view.camera.size
        states = self.cells.to_host()[: height - 1, : width - 1]
        drawn, bits = (int(constant("depthmesh/tree.h", name)) for name in ("DRAWN", "SIDE_BITS"))
        return (states & drawn) > 0, (states & drawn << bits) > 0

    def vertices_of(self, samples: NDArray[np.int32]) -> tuple[Float64, Float64]:
        """(N, 2) pixels and (N,) depths at which the vertices of the samples y * width + x are drawn."""
        camera, (width, height) = self.view.camera, self.view.camera.size
        y, x = np.divmod(samples, width)
        beyond = [0.5 * ((at == count - 1) * 1.0 - (at == 0)) for at, count in ((x, width), (y, height))]
        placed = self.placed.to_host()[y, x].astype(np.float64)
        depth = self.view.depth[y, x].astype(np.float64)
        further = 1 / placed if camera.projection == "perspective" else -placed
        is_beyond = (beyond[0] != 0) | (beyond[1] != 0)
        return np.column_stack([x + beyond[0], y + beyond[1]]), np.where(is_beyond, further, depth)

    def sample_normals(self) -> NDArray[np.float32]:
        """Copy `normals` to the host, as (H, W, 3)."""
        found = self.normals.to_host()[..., : self.view.camera.width]
        return np.ascontiguousarray(np.moveaxis(found, 0, -1))

    @cached_property
    def normals(self) -> DeviceArray:
        """(3, H, pitch) normals of the samples in the camera frame of the view."""
        found = empty((3, *self.nearness.shape), np.float32)
        arguments = {"nearness": self.nearness, "cells": self.cells, "normals": found, "layout": self.layout}
        launch(kernel(_KERNELS, "find_normals"), (found.shape[1],), **arguments)
        return found

    @cached_property
    def smoothed(self) -> DeviceArray:
        """(H, pitch) nearness of the drawn vertices if the samples were denoised, for errors."""
        if not any(self.view.noise):
            return self.placed
        found = empty(self.nearness.shape, np.float32)
        arguments = {"nearness": self.nearness, "smoothed": found, "layout": self.layout}
        launch(kernel(_KERNELS, "smooth_nearness"), (found.shape[0],), **arguments)
        return self._placed(found)

    @cached_property
    def placed(self) -> DeviceArray:
        """(H, pitch) nearness of the drawn vertices; outermost vertices lie half a pixel beyond their samples."""
        return self._placed(self.nearness)

    def _placed(self, nearness: DeviceArray) -> DeviceArray:
        placed = empty(nearness.shape, np.float32)
        arguments = {"nearness": nearness, "cells": self.cells, "placed": placed, "layout": self.layout}
        launch(kernel(_KERNELS, "place_border"), (placed.shape[0],), **arguments)
        return placed

    @cached_property
    def states(self) -> DeviceArray:
        """(side + 1, row) uint8: states of the two triangles that each vertex splits, drawn or not."""
        side, layout = self.side, self.layout
        found = empty((side + 1, pitch(side + 1)), np.uint8)
        launch(kernel(_KERNELS, "find_finest_states"), (side + 1,), cells=self.cells, states=found, layout=layout)
        self._fine_to_coarse("states", states=found, layout=layout)
        return found

    @cached_property
    def errors(self) -> dict[str, DeviceArray]:
        """Errors, radii and depths of the vertices, each (side + 1, row), in scene units, by which cameras select them.

        Errors are -1 where nothing is drawn; radii and depths belong to the bounding spheres and their centres.
        """
        found = {name: empty(self.states.shape, np.float32) for name in ("errors", "radii", "depths")}
        shared: dict[str, Any] = found | {
            "below": empty(self.states.shape, np.float32),
            "sums": empty(self.states.shape, np.float32),
            "nearness": self.smoothed,
            "placed": self.placed,
            "states": self.states,
            "layout": self.layout,
            "largest": self.joined == "largest",
        }
        launch(kernel(_KERNELS, "find_finest_midpoints"), (self.side + 1,), **shared)
        if self.side > 1:
            launch(kernel(_KERNELS, "find_finest_centers"), (self.side // 2,), **shared)
        self._fine_to_coarse("errors", **shared)
        return found

    def _fine_to_coarse(self, kind: str, **shared: Any) -> None:
        """Launch the kernels for the vertices of each step from 2 on: midpoints, then centres."""
        of_step, of_coarse = (kernel(_KERNELS, name) for name in (f"find_{kind}", f"find_coarse_{kind}"))
        step, side, cells = 2, self.side, self.view.camera.height - 1
        while step < min(side, _COARSE):
            rows = -(-cells // step) + 1
            launch(of_step, (min(side // step + 1, rows),), **shared, s=step, centers=False)
            launch(of_step, (min(side // (2 * step), -(-rows // 2)),), **shared, s=step, centers=True)
            step *= 2
        if step < side:
            launch(of_coarse, (1,), **shared, finest=step)


def build_tree(view: DepthImage, segmentation: Segmentation, joined: ErrorsBy = "sum") -> Tree:
    """Segment a view's grid; the tree's other arrays are computed on first use."""
    width, height = view.camera.size
    samples = samples_of(view)
    perspective = view.camera.projection == "perspective"
    depths = (1 / samples.high, 1 / samples.low) if perspective else (-samples.high, -samples.low)
    if depths[1] > _DEPTHS[1] or (perspective and depths[0] < _DEPTHS[0]):
        least, most = _DEPTHS
        allowed = f"depths from {least:g} to {most:g} scene units (or `far`, if larger ones are no surface)"
        raise ArgumentError("view", allowed, f"{depths[0]:g} to {depths[1]:g}")
    side = 1 << (max(width, height) - 2).bit_length()
    nearness = samples.nearness
    layout = Struct("Layout", _layout(view, side, pitch(side + 1)))
    rule = Struct("Segmentation", segmentation.record(view, depths[1] - depths[0]))
    cells = empty((height, pitch(width)), np.uint8)
    launch(kernel(_KERNELS, "segment"), (height - 1,), nearness=nearness, cells=cells, layout=layout, rule=rule)
    return Tree(view, layout, side, nearness, cells, joined)


def _layout(view: DepthImage, side: int, row: int) -> np.ndarray[Any, np.dtype[np.void]]:
    values, camera = np.zeros((), struct("depthmesh/tree.h", "Layout")), view.camera
    values["ray"] = np.linalg.inv(camera.K)[:2].ravel()
    values["footprint"] = 1.0 / min(camera.K[0, 0], camera.K[1, 1])
    values["noise"] = np.minimum(view.noise, NOISE_MAX)
    values["perspective"] = camera.projection == "perspective"
    values["width"], values["height"] = camera.size
    values["pitch"], values["side"], values["row"] = pitch(camera.width), side, row
    return values
