"""Sort primitives into bins on the device, for every system that draws triangles or prisms (kernels/raster/)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pyibr.core.errors import OutOfMemoryError
from pyibr.meshes.mesh import Sides
from pyibr.opencl.device import current
from pyibr.opencl.headers import constant
from pyibr.opencl.launch import Struct, launch
from pyibr.opencl.memory import DeviceArray, empty
from pyibr.opencl.program import kernel
from pyibr.picture.target import Target

_UNSYNCHRONIZED = 1 << 22  # longest list that is allocated without asking the device for the length
_COUNTS_MAX = 1 << 24  # largest number of counts, one for each chunk and bin
_NUMBERED_MAX = (1 << 31) - 1  # kernels index lists in 32 bits
_CULLED = {"both": "CULLS_NONE", "front": "CULLS_BACKS", "back": "CULLS_FRONTS"}


@dataclass(frozen=True)
class Bins:
    """Primitives, sorted into a target's bins."""

    grid: tuple[int, int]  # work-items of the kernels that draw the bins
    region: int  # width and height in pixels of the region that a work-item draws
    arguments: dict[str, Any]  # BINS_PARAMETERS of these kernels (kernels/raster/fragment.h)
    culled: int  # triangles to cull, for kernels that do so: a constant of kernels/raster/triangle.h


def bin_defines(corners: int) -> dict[str, int]:
    """Return the defines of kernels that draw bins of primitives with this number of corners."""
    # A bin decides in which direction a prism is sliced, so bins of prisms have the same size on every device.
    return {"BIN": current().profile.bin if corners == 3 else int(constant("lib/screen.h", "BIN"))}


def project(target: Target, vertices: DeviceArray, near: float, corners: int = 3) -> DeviceArray:
    """Project vertices, (N, 3) in the world, to homogeneous pixel space, (N, 4); `corners` of them form a primitive.

    Positions are computed relative to the camera: even far from the world's origin, they are as exact as the vertices.
    """
    count = vertices.shape[0]
    origin = target.camera.center.astype(np.float32)  # the same for all things: no cracks between neighbours
    projected = empty((count, 4), np.float32)
    launch(
        kernel("raster/bins.cl", "project", CORNERS=corners, **bin_defines(corners)),
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
    target: Target,
    corners: DeviceArray,
    projected: DeviceArray,
    near: float,
    sides: Sides = "both",
    sort: bool = False,
    **defines: int,
) -> Bins:
    """Sort primitives, (P, 3) or (P, 6) indices of projected vertices, into the target's bins.

    Each bin lists its primitives in index order or, with `sort`, from front to back. Triangles that show a side other
    than `sides` are culled.
    """
    count, each = corners.shape
    profile, defines = current().profile, {"CORNERS": each} | bin_defines(each) | defines
    columns, rows = (-(-size // defines["BIN"]) for size in target.camera.size)
    boxes = empty((count, 4), np.uint16)
    view: dict[str, Any] = {"projected": projected, "screen": Struct("Screen", target.screen(near)), "nearest_w": near}
    culled = int(constant("raster/triangle.h", _CULLED[sides]))

    packets = profile.packets(count, 1, profile.strip)[:1]
    _run(defines, "bound_primitives", *packets, corners=corners, boxes=boxes, primitives=count, culled=culled, **view)
    found, starts = list_boxes(boxes, columns, rows, **defines)
    if sort:
        keys = empty(found.shape, np.float32)
        lists = {"keys": keys, "list": found, "starts": starts}
        bins = columns * rows
        _run(defines, "sort_bins", bins, corners=corners, projected=projected, bins=bins, **lists)
    arguments = {"list": found, "starts": starts, "bins_x": columns, **view}
    region = 1 if profile.lanes == 1 else defines["BIN"]
    return Bins(profile.grid((columns, rows), target.camera.size), region, arguments, culled)


def list_boxes(boxes: DeviceArray, columns: int, rows: int, **defines: int) -> tuple[DeviceArray, DeviceArray]:
    """List the boxes, (N, 4) uint16 of kernels/raster/boxes.h, that touch each bin, in their order, bin by bin.

    Returns the list of indices, and the (bins + 1,) starts of the bins in it.
    """
    count, bins = boxes.shape[0], columns * rows
    chunk = max(-(-count // min(current().profile.chunks, max(_COUNTS_MAX // bins, 1))), 1)
    chunks = max(-(-count // chunk), 1)
    counts = empty((chunks, bins), np.int32)
    shared: dict[str, Any] = {"boxes": boxes, "counts": counts, "primitives": count, "chunk": chunk}
    shared |= {"bins_x": columns, "bins_y": rows}
    counts.fill(0)
    _run(defines, "count_bins", chunks, **shared)
    starts, totals = place_counts(counts, columns, rows, **defines)
    # To read the lists' length from the device takes a wait for all earlier launches.
    longest = count * bins
    length = longest if longest <= _UNSYNCHRONIZED else int(totals.to_host().sum(dtype=np.int64))
    if length > _NUMBERED_MAX:
        raise OutOfMemoryError(f"the picture's parts list {length} primitives in all, more than {_NUMBERED_MAX}")
    found = empty((max(length, 1),), np.int32)
    _run(defines, "fill_bins", chunks, list=found, **shared)
    return found, starts


def place_counts(counts: DeviceArray, columns: int, rows: int, **defines: int) -> tuple[DeviceArray, DeviceArray]:
    """Replace each chunk's count of elements in each bin, (chunks, bins), by the place where they begin in a list.

    Bins follow each other in the list, and in a bin the chunks. Returns the starts of the bins, (bins + 1,), and their
    numbers of elements, (bins,).
    """
    chunks, bins = counts.shape
    starts, totals, row_totals = (empty((size,), np.int32) for size in (bins + 1, bins, rows))
    sums = {"counts": counts, "totals": totals, "chunks": chunks}
    grid = {"bins_x": columns, "bins_y": rows}
    _run(defines, "total_bins", bins, **sums, bins=bins)
    _run(defines, "total_rows", rows, totals=totals, row_totals=row_totals, **grid)
    _run(defines, "start_bins", columns, rows, **sums, row_totals=row_totals, starts=starts, **grid)
    return starts, totals


def _run(defines: dict[str, int], name: str, *items: int, **arguments: Any) -> None:
    chosen = defines or {"CORNERS": 3, **bin_defines(3)}  # kernels that list boxes are the same in all builds
    launch(kernel("raster/bins.cl", name, **chosen), items, **arguments)
