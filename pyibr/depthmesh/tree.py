"""The restricted quadtree over a depth image on the device, and triangulations of it (kernels/depthmesh/)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pyibr.camera import Camera
from pyibr.depthmesh.segmentation import TESTS, Segmentation
from pyibr.images import DepthImage
from pyibr.pixelspace import PixelMap, pitch
from pyibr.samples import samples_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from pyibr.opencl.launch import Struct
    from pyibr.opencl.memory import DeviceArray

_LAYOUT = np.dtype(
    [
        ("ray", np.float32, 6),
        ("footprint", np.float32),
        ("perspective", np.int32),
        ("width", np.int32),
        ("height", np.int32),
        ("pitch", np.int32),
        ("side", np.int32),
        ("row", np.int32),
    ]
)
"""The struct Layout of kernels/depthmesh/tree.h."""

_VIEWER = np.dtype(
    [
        ("eye", np.float32, 3),
        ("planes", np.float32, (5, 4)),
        ("scale", np.float32),
        ("tolerance", np.float32),
        ("perspective", np.int32),
    ]
)
_COARSE = 8  # from this step on, all rows are one work-item's: they are too few to share
_CHUNK = 1024  # points of a work-item, kernels/depthmesh/select.cl


@dataclass(frozen=True)
class Tree:
    """The quadtree of a view: what kernels/depthmesh/ tells of its samples and vertices.

    Attributes
    ----------
    view : DepthImage
    layout : Struct
        Of kernels/depthmesh/tree.h.
    side : int
        Cells along the side, a power of two.
    nearness : DeviceArray (H, pitch)
    cells : DeviceArray (H, pitch) uint8
        Whether each cell's two triangles are drawn.
    normals : DeviceArray (3, H, pitch)
        In the view's frame.
    states : DeviceArray (side + 1, row) uint8
        Which of the two triangles that a vertex splits are drawn.
    """

    view: DepthImage
    layout: Struct
    side: int
    nearness: DeviceArray
    cells: DeviceArray
    normals: DeviceArray
    states: DeviceArray

    @cached_property
    def errors(self) -> Errors:
        """What selection for a viewer needs to know of the vertices."""
        return _find_errors(self)


@dataclass(frozen=True)
class Errors:
    """Of a tree's vertices, (side + 1, row): errors, -1 where nothing is drawn, and bounding spheres; scene units.

    Attributes
    ----------
    errors, radii, depths : DeviceArray
        The depths are those of the spheres' centres.
    """

    errors: DeviceArray
    radii: DeviceArray
    depths: DeviceArray


def build_tree(view: DepthImage, segmentation: Segmentation) -> Tree:
    """Segment a view's grid, and find its normals and what its tree's triangles are made of."""
    from pyibr.opencl.launch import Struct, launch
    from pyibr.opencl.memory import empty
    from pyibr.opencl.program import kernel

    width, height = view.camera.size
    side = 1 << (max(width, height) - 2).bit_length()
    row = pitch(side + 1)
    nearness = samples_of(view).nearness
    layout = Struct("Layout", _layout(view.camera, side, row))
    rule = Struct("Segmentation", segmentation.record(view))
    cells, normals = empty((height, pitch(width)), np.uint8), empty((3, height, pitch(width)), np.float32)
    test = TESTS[segmentation.test]
    launch(
        kernel("depthmesh/samples.cl", "segment", TEST=test),
        (height - 1,),
        nearness=nearness,
        cells=cells,
        layout=layout,
        rule=rule,
    )
    launch(
        kernel("depthmesh/samples.cl", "find_normals", TEST=test),
        (height,),
        nearness=nearness,
        normals=normals,
        layout=layout,
        rule=rule,
    )
    file, states = "depthmesh/states.cl", empty((side + 1, row), np.uint8)
    launch(kernel(file, "find_midpoint_states"), (side + 1,), cells=cells, states=states, layout=layout)
    if side > 1:
        launch(kernel(file, "find_center_states"), (side // 2,), states=states, layout=layout)
    _fine_to_coarse(file, "find_states", "find_coarse_states", side, height, states=states, layout=layout)
    return Tree(view, layout, side, nearness, cells, normals, states)


def _find_errors(tree: Tree) -> Errors:
    from pyibr.opencl.launch import launch
    from pyibr.opencl.memory import empty
    from pyibr.opencl.program import kernel

    file, side = "depthmesh/errors.cl", tree.side
    errors, radii, depths = (empty(tree.states.shape, np.float32) for _ in range(3))
    shared: dict[str, Any] = {
        "nearness": tree.nearness,
        "states": tree.states,
        "errors": errors,
        "radii": radii,
        "depths": depths,
        "layout": tree.layout,
    }
    launch(kernel(file, "find_finest_midpoints"), (side + 1,), **shared)
    if side > 1:
        launch(kernel(file, "find_finest_centers"), (side // 2,), **shared)
    _fine_to_coarse(file, "find_errors", "find_coarse_errors", side, tree.view.camera.height, **shared)
    return Errors(errors, radii, depths)


def _fine_to_coarse(file: str, of_step: str, of_coarse: str, side: int, height: int, **shared: Any) -> None:
    """Launch kernels for the vertices of each step from 2 on: midpoints, then centres."""
    from pyibr.opencl.launch import launch
    from pyibr.opencl.program import kernel

    step = 2
    while step < min(side, _COARSE):
        rows = -(-(height - 1) // step) + 1
        one = kernel(file, of_step)
        launch(one, (min(side // step + 1, rows),), **shared, s=step, centers=False)
        launch(one, (min(side // (2 * step), -(-rows // 2)),), **shared, s=step, centers=True)
        step *= 2
    if step < side:
        launch(kernel(file, of_coarse), (1,), **shared, finest=step)


def _layout(camera: Camera, side: int, row: int) -> np.ndarray[Any, np.dtype[np.void]]:
    values = np.zeros((), _LAYOUT)
    values["ray"] = np.linalg.inv(camera.K)[:2].ravel()
    values["footprint"] = 1.0 / min(camera.K[0, 0], camera.K[1, 1])
    values["perspective"] = camera.projection == "perspective"
    values["width"], values["height"] = camera.size
    values["pitch"], values["side"], values["row"] = pitch(camera.width), side, row
    return values


def active_for(tree: Tree, camera: Camera, tolerance: float) -> DeviceArray:
    """Mark the vertices that a camera needs for a tolerance in pixels (equation 5): (side + 1, row) uint8."""
    from pyibr.opencl.launch import Struct, launch
    from pyibr.opencl.memory import empty
    from pyibr.opencl.program import kernel

    known, active = tree.errors, empty(tree.states.shape, np.uint8)
    launch(
        kernel("depthmesh/select.cl", "activate"),
        (tree.side + 1,),
        errors=known.errors,
        radii=known.radii,
        depths=known.depths,
        active=active,
        layout=tree.layout,
        viewer=Struct("Viewer", _viewer(tree.view.camera, camera, tolerance)),
    )
    return active


def _viewer(src: Camera, dst: Camera, tolerance: float) -> np.ndarray[Any, np.dtype[np.void]]:
    dst_from_src = dst.camera_from_world @ src.world_from_camera
    u, v, w, q = dst.pixel_matrix @ dst_from_src
    before = w if dst.projection == "perspective" else -q
    planes = np.array(
        [u + 0.5 * w, (dst.width - 0.5) * w - u, v + 0.5 * w, (dst.height - 0.5) * w - v, before], np.float64
    )
    planes /= np.linalg.norm(planes[:, :3], axis=1, keepdims=True)
    values = np.zeros((), _VIEWER)
    values["eye"] = np.linalg.inv(dst_from_src)[:3, 3]
    values["planes"] = planes
    values["scale"] = max(dst.K[0, 0], dst.K[1, 1])
    values["tolerance"] = tolerance
    values["perspective"] = dst.projection == "perspective"
    return values


def active_within(tree: Tree, max_error: float) -> DeviceArray:
    """Mark the vertices that a vertical error of at most `max_error`, in scene units, needs: (side + 1, row) uint8."""
    from pyibr.opencl.launch import launch
    from pyibr.opencl.memory import empty
    from pyibr.opencl.program import kernel

    active = empty(tree.states.shape, np.uint8)
    active.fill(0)
    launch(
        kernel("depthmesh/simplify.cl", "refine"),
        (1,),
        nearness=tree.nearness,
        states=tree.states,
        active=active,
        queue=empty(tree.states.shape, np.int32),
        layout=tree.layout,
        max_error=max_error,
    )
    return active


@dataclass(frozen=True)
class Triangles:
    """Triangles of several trees, one tree's after the other's.

    Attributes
    ----------
    points : DeviceArray (P, 4) float32
        Where in its view each lies, kernels/depthmesh/tree.h, and its quality.
    corners : DeviceArray (T, 3) int32
        Numbers of points.
    point_firsts, firsts : list of int
        Numbers of each tree's first point and first triangle; P and T.
    """

    points: DeviceArray
    corners: DeviceArray
    point_firsts: list[int]
    firsts: list[int]


def list_triangles(trees: Sequence[Tree], active: Sequence[DeviceArray], before: Triangles | None = None) -> Triangles:
    """List the triangles of each tree's active vertices, after those of `before`, in a fixed order."""
    from pyibr.opencl.launch import launch
    from pyibr.opencl.memory import copy, empty, upload
    from pyibr.opencl.program import kernel

    found: list[tuple[DeviceArray, DeviceArray]] = []
    for tree, marks in zip(trees, active, strict=True):
        drawn, counts = empty(marks.shape, np.uint8), empty((tree.side + 1, 2), np.int32)
        launch(
            kernel("depthmesh/select.cl", "find_triangles"),
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
            kernel("depthmesh/select.cl", "list_points"),
            (tree.view.camera.height,),
            active=marks,
            nearness=tree.nearness,
            normals=tree.normals,
            firsts=firsts,
            numbers=numbers,
            points=points,
            layout=tree.layout,
        )
        launch(
            kernel("depthmesh/select.cl", "list_triangles"),
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
    """(..., 2) the samples x and y of a view that points (..., 4) of its triangles lie at."""
    x, y, z = np.moveaxis(points[..., :3].astype(np.float64), -1, 0)
    scale = 1 / z if view.camera.projection == "perspective" else np.ones_like(z)
    return np.rint(np.stack([x * scale, y * scale], -1)).astype(np.int64)


def project_points(target: Camera, views: Sequence[DepthImage], triangles: Triangles) -> DeviceArray:
    """(P, 4) the triangles' points in a target's pixel space; views: each mesh's."""
    from pyibr.opencl.launch import launch
    from pyibr.opencl.memory import empty, upload
    from pyibr.opencl.program import kernel

    maps = np.array([PixelMap(view.camera, target, 0.0, 0.0).dst_from_src for view in views], np.float32)
    for view, one in zip(views, maps, strict=True):
        if view.camera.projection == "orthographic":
            one[:, 2:] = one[:, :1:-1]  # points hold nearness third, not 1
    projected = empty(triangles.points.shape, np.float32)
    launch(
        kernel("depthmesh/select.cl", "project_points"),
        (-(-triangles.point_firsts[-1] // _CHUNK),),
        points=triangles.points,
        firsts=upload(np.array(triangles.point_firsts, np.int32)),
        maps=upload(maps),
        meshes=len(views),
        projected=projected,
    )
    return projected
