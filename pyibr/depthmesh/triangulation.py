"""Triangles of the active vertices of quadtrees (kernels/depthmesh/)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera
from pyibr.core.checks import Immutable
from pyibr.core.pixelspace import CameraPair
from pyibr.depthmesh.selection import Selection, select_for
from pyibr.depthmesh.tree import Tree
from pyibr.images import DepthImage
from pyibr.opencl.device_cache import cached_on_device
from pyibr.opencl.headers import constant
from pyibr.opencl.launch import launch
from pyibr.opencl.memory import DeviceArray, copy, empty, upload
from pyibr.opencl.program import kernel


@dataclass(frozen=True)
class Triangles:
    """Triangles of several trees, tree by tree."""

    points: DeviceArray  # (P, 4) float32 position in the view (kernels/depthmesh/tree.h), and quality if rated
    corners: DeviceArray  # (T, 3) int32 indices of points
    point_firsts: list[int]  # index of each tree's first point, followed by P
    firsts: list[int]  # index of each tree's first triangle, followed by T


def list_triangles(
    trees: Sequence[Tree], active: Sequence[DeviceArray], before: Triangles | None = None, *, rated: bool = False
) -> Triangles:
    """List the triangles of each tree's active vertices in a fixed order, after the triangles of `before`.

    With `rated`, the points also get their quality, which requires the normals.
    """
    found: list[tuple[DeviceArray, DeviceArray]] = []
    for tree, marks in zip(trees, active, strict=True):
        drawn, counts = empty(marks.shape, np.uint8), empty((tree.side + 1, 2), np.int32)
        launch(kernel("depthmesh/tree.cl", "list_border"), (tree.side + 1,), active=marks, layout=tree.layout)
        launch(
            kernel("depthmesh/tree.cl", "find_triangles"),
            (tree.side + 1,),
            active=marks,
            states=tree.states,
            cells=tree.cells,
            drawn=drawn,
            counts=counts,
            layout=tree.layout,
        )
        found.append((drawn, counts))
    of_rows = np.concatenate([np.zeros((1, 2), np.int32), *(counts.to_host() for _, counts in found)])
    if before is not None:
        of_rows[0] = before.point_firsts[-1], before.firsts[-1]
    row_firsts = np.cumsum(of_rows, axis=0, dtype=np.int32)
    ends = np.cumsum([0, *(tree.side + 1 for tree in trees)])
    points = empty((row_firsts[-1, 0], 4), np.float32)
    corners = empty((row_firsts[-1, 1], 3), np.int32)
    if before is not None:
        copy(before.points, points)
        copy(before.corners, corners)
    for tree, marks, (drawn, _), first in zip(trees, active, found, ends[:-1], strict=True):
        numbers, firsts = empty(marks.shape, np.int32), upload(row_firsts[first:])
        launch(
            kernel("depthmesh/tree.cl", "list_points"),
            (tree.view.camera.size[1],),
            active=marks,
            placed=tree.placed,
            firsts=firsts,
            numbers=numbers,
            points=points,
            layout=tree.layout,
            normals=tree.normals if rated else tree.nearness,
            rated=rated,
        )
        launch(
            kernel("depthmesh/tree.cl", "list_triangles"),
            (tree.side + 1,),
            active=marks,
            drawn=drawn,
            numbers=numbers,
            firsts=firsts,
            corners=corners,
            layout=tree.layout,
        )
    point_firsts, triangle_firsts = row_firsts[ends].T.tolist()
    if before is not None:
        point_firsts, triangle_firsts = before.point_firsts[:-1] + point_firsts, before.firsts[:-1] + triangle_firsts
    return Triangles(points, corners, point_firsts, triangle_firsts)


def pixels_of(points: NDArray[np.float32], view: DepthImage) -> NDArray[np.int64]:
    """(..., 2) coordinates x and y of the samples that belong to points (..., 4) of a view's triangles."""
    x, y, z = np.moveaxis(points[..., :3].astype(np.float64), -1, 0)
    scale = 1 / z if view.camera.projection == "perspective" else np.ones_like(z)
    last = np.subtract(view.camera.size, 1)  # outermost vertices lie half a pixel farther out
    return np.clip(np.rint(np.stack([x * scale, y * scale], -1)), 0, last).astype(np.int64)


def _projected(triangles: Triangles, pairs: Sequence[CameraPair]) -> DeviceArray:
    """(P, 4) points of the triangles in the target's pixel space; `pairs` join each mesh's camera with the target's."""
    maps = np.array([pair.dst_from_src for pair in pairs], np.float32)
    for pair, one in zip(pairs, maps, strict=True):
        if pair.src.projection == "orthographic":
            one[:, 2:] = one[:, :1:-1]  # the third coordinate of these points is nearness, not 1
    projected = empty(triangles.points.shape, np.float32)
    launch(
        kernel("depthmesh/tree.cl", "project_points"),
        (-(-triangles.point_firsts[-1] // int(constant("depthmesh/select.cl", "POINTS"))),),
        points=triangles.points,
        firsts=upload(np.array(triangles.point_firsts, np.int32)),
        maps=upload(maps),
        meshes=len(pairs),
        projected=projected,
    )
    return projected


@dataclass(frozen=True)
class _CachedTriangles:
    """Triangles, the trees and earlier triangles they were made for, and the selection that limits their reuse."""

    trees: list[Tree]
    before: Triangles | None
    selection: Selection
    triangles: Triangles

    def hold_for(self, trees: list[Tree], camera: Camera, before: Triangles | None) -> bool:
        same = [*map(id, trees)] == [*map(id, self.trees)] and before is self.before
        return same and self.selection.holds_for(camera)


def projected_triangles(
    thing: Immutable,
    trees: list[Tree],
    camera: Camera,
    pairs: Sequence[CameraPair],
    tolerance: float,
    before: Triangles | None,
    reuse: float,
) -> tuple[Triangles, DeviceArray]:
    """Triangles of an object's trees for a camera, after the triangles `before`, and their points in its pixel space.

    The latest triangles are reused as long as they meet the tolerance. `pairs` join each mesh's camera with `camera`.
    `tolerance` and `reuse` are as in `Selection`; with `reuse` 0, the triangles are listed each time.
    """
    latest = cached_on_device(thing, "latest triangles", list[_CachedTriangles]) if reuse else []
    # Another thread may draw the object for another camera, so the cache entry is replaced as a whole.
    found = latest[0] if latest else None
    if found is None or not found.hold_for(trees, camera, before):
        selection = select_for(trees, camera, tolerance, reuse)
        found = _CachedTriangles(trees, before, selection, list_triangles(trees, selection.active, before, rated=True))
        latest[:] = [found]
    return found.triangles, _projected(found.triangles, pairs)
