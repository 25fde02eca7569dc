"""Primitives to bins on the device, for every system that draws triangles or tetrahedra (kernels/raster/)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pyibr.meshes.mesh import Sides
from pyibr.opencl.device import current
from pyibr.opencl.headers import constant
from pyibr.opencl.launch import Struct, launch
from pyibr.opencl.memory import DeviceArray, empty
from pyibr.opencl.program import Kernel, kernel
from pyibr.picture.target import Target

_UNSYNCHRONIZED = 1 << 22  # numbers that a list may have room for unasked, though few of them may be written
_CULLED = {"both": "CULLS_NONE", "front": "CULLS_BACKS", "back": "CULLS_FRONTS"}


@dataclass(frozen=True)
class Bins:
    """Primitives of a target's bins.

    Attributes
    ----------
    grid : (int, int)
        Work-items of kernels that draw the bins.
    arguments : dict
        What these take: `list`, numbers of primitives, bin by bin; `starts`, where each bin's part begins; the view.
    """

    grid: tuple[int, int]
    arguments: dict[str, Any]


def bin_side() -> int:
    """Pixels along the side of a bin."""
    return int(constant("raster/region.h", "BIN"))


def _kernel(name: str, corners: int) -> Kernel:
    return kernel("raster/bins.cl", name, CORNERS=corners, BIN=bin_side())


def region_side() -> int:
    """Pixels along the side of what a work-item draws: REGION of kernels/raster/region.h."""
    return 1 if current().profile.lanes == 1 else bin_side()


def culled(sides: Sides) -> int:
    """Triangles that kernels cull so that these sides are drawn."""
    return int(constant("raster/triangle.h", _CULLED[sides]))


def project(target: Target, vertices: DeviceArray, near: float, corners: int = 3) -> DeviceArray:
    """(N, 4) homogeneous pixel-space positions of (N, 3) vertices of the world, `corners` of which are a primitive.

    As exact as float32 vertices are, even far from the world's origin: they are taken relative to the camera.
    """
    count = vertices.shape[0]
    origin = target.camera.center.astype(np.float32)  # the same for all things: no cracks between neighbours
    projected = empty((count, 4), np.float32)
    launch(
        _kernel("project", corners),
        (count,),
        vertices=vertices,
        projected=projected,
        count=count,
        origin_x=float(origin[0]),
        origin_y=float(origin[1]),
        origin_z=float(origin[2]),
        screen=Struct("Screen", target.screen(near, origin)),
    )
    return projected


def bin_primitives(
    target: Target, corners: DeviceArray, projected: DeviceArray, near: float, sides: Sides = "both", sort: bool = False
) -> Bins:
    """Sort primitives, (P, 3) or (P, 4) indices of projected vertices, into the target's bins.

    Each bin's are in the order of their numbers or, with `sort`, from front to back. Of triangles, those that only show
    another of their `sides` are left out.
    """
    profile = current().profile
    count, each = corners.shape
    columns, rows = (-(-size // bin_side()) for size in target.camera.size)
    bins = columns * rows
    chunk = max(-(-count // profile.chunks), 1)
    chunks = max(-(-count // chunk), 1)
    boxes, counts, starts = empty((count, 4), np.int16), empty((chunks, bins), np.int32), empty((bins + 1,), np.int32)
    totals, row_totals = empty((bins,), np.int32), empty((rows,), np.int32)
    view: dict[str, Any] = {"projected": projected, "screen": Struct("Screen", target.screen(near)), "nearest_w": near}
    grid = {"bins_x": columns, "bins_y": rows}
    shared = {"primitives": count, "chunk": chunk, **grid}
    sums = {"counts": counts, "totals": totals, "chunks": chunks}

    def run(name: str, *items: int, **arguments: Any) -> None:
        launch(_kernel(name, each), items, **arguments)

    run("count_bins", chunks, corners=corners, boxes=boxes, counts=counts, culled=culled(sides), **view, **shared)
    run("total_bins", bins, **sums, bins=bins)
    run("total_rows", rows, totals=totals, row_totals=row_totals, **grid)
    run("start_bins", columns, rows, **sums, row_totals=row_totals, starts=starts, **grid)
    # Whoever asks how long the list is waits for all that is drawn before.
    longest = count * bins
    length = longest if longest <= _UNSYNCHRONIZED else int(starts.to_host()[-1])
    found = empty((max(length, 1),), np.int32)
    run("fill_bins", chunks, boxes=boxes, counts=counts, list=found, **shared)
    if sort:
        keys = empty(found.shape, np.float32)
        run("sort_bins", bins, corners=corners, projected=projected, keys=keys, list=found, starts=starts, bins=bins)
    arguments = {"list": found, "starts": starts, "bins_x": columns, **view}
    return Bins(profile.grid((columns, rows), target.camera.size), arguments)
