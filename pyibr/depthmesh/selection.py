"""Selection of the quadtree vertices for a triangulation, with limits of the camera's motion (kernels/depthmesh/)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from pyibr.core.camera import Camera
from pyibr.core.checks import Float64
from pyibr.core.pixelspace import frustum
from pyibr.depthmesh.tree import Tree
from pyibr.opencl.headers import struct
from pyibr.opencl.launch import Struct, launch
from pyibr.opencl.memory import DeviceArray, empty, to_host, zeros
from pyibr.opencl.program import kernel

REUSE_MAX = 0.5

_SHARES = 16  # blocks along a tree's side into which simplification is divided
CHUNK = 64  # ints in a chunk of memory that a work-item of kernels/depthmesh/simplify.cl reserves
_ROUNDING = 0.999  # fraction of the motion limits that is used, because the limits are rounded


@dataclass(frozen=True)
class Selection:
    """Vertices of trees that a camera needs, with a reserve for its motion if `reuse` is not 0.

    `reuse` is the fraction by which the selection is finer than the tolerance, and the distance that it extends beyond
    the camera's view, as a fraction of the distance from the camera. For each vertex, errors are drawn as large as at
    any place that it may then reach in the view.
    """

    active: list[DeviceArray]  # of each tree: (side + 1, row) uint8 marks of kernels/depthmesh/tree.h
    camera: Camera
    tolerance: float  # pixels of the camera: largest error of the triangulation
    reuse: float
    motion_limits: list[DeviceArray]  # of each tree: (side + 1, 2), kernels/depthmesh/select.cl

    @cached_property
    def motion_limit(self) -> Float64:
        """(2,) minimum of the motion limits over all rows of all trees."""
        return np.concatenate(to_host(self.motion_limits)).min(axis=0).astype(np.float64)

    def holds_for(self, camera: Camera) -> bool:
        """Tell whether the selected vertices still meet the tolerance for a camera that has moved."""
        own = self.camera
        if camera.projection != own.projection or camera.size != own.size or not np.array_equal(camera.K, own.K):
            return False
        if camera.projection == "orthographic":  # errors are the same everywhere, and with `reuse` nothing is culled
            return True
        moved = float(np.linalg.norm(camera.center - own.center))
        turned = float(np.linalg.norm((frustum(camera) - frustum(own))[:, :3], axis=1).max())
        room, nearest = self.motion_limit
        # A vertex that is out of view by `reuse` times its distance stays out until the view's planes move as far. Nor
        # can an inactive vertex in view move farther from the axis, where its error is drawn larger, until then.
        stays = not np.isfinite(nearest) or turned + moved / nearest <= _ROUNDING * self.reuse
        return moved <= _ROUNDING * room and stays


def select_for(trees: Sequence[Tree], camera: Camera, tolerance: float, reuse: float = 0.0) -> Selection:
    """Find the vertices of trees that a camera needs for a tolerance in pixels (equation 5)."""
    viewer = np.zeros((), struct("depthmesh/select.cl", "Viewer"))
    viewer["scale"] = np.linalg.norm(camera.K[:2, :2], 2)
    viewer["allowed"] = tolerance
    viewer["tolerance"] = (1.0 - reuse) * tolerance
    viewer["least_cosine"] = _least_cosine(camera)
    perspective = camera.projection == "perspective"
    viewer["perspective"], viewer["widening"] = perspective, reuse if perspective else 0.0
    planes = frustum(camera) if perspective or not reuse else np.zeros((5, 4))
    active, motion_limits = list[DeviceArray](), list[DeviceArray]()
    for tree in trees:
        src = tree.view.camera
        viewer["eye"] = (src.camera_from_world @ camera.world_from_camera)[:3, 3]
        viewer["planes"] = planes @ src.world_from_camera
        active.append(empty(tree.states.shape, np.uint8))
        motion_limits.append(empty((tree.side + 1, 2), np.float32))
        launch(
            kernel("depthmesh/tree.cl", "activate"),
            (tree.side + 1,),
            **tree.errors,
            active=active[-1],
            motion_limits=motion_limits[-1],
            layout=tree.layout,
            viewer=Struct("Viewer", viewer.copy()),
        )
    return Selection(active, camera, tolerance, reuse, motion_limits)


def active_within(tree: Tree, max_error: float) -> DeviceArray:
    """Mark the vertices needed for a vertical error of at most `max_error` scene units: (side + 1, row) uint8."""
    active = zeros(tree.states.shape, np.uint8)
    coarse = max(tree.side // _SHARES, 1)
    grid = (tree.side // coarse + 1,) * 2
    # Room for all vertices, and for one partly filled chunk of each work-item.
    chunks = int(np.prod(active.shape)) // (CHUNK - 2) + int(np.prod(grid)) + 1
    shared: dict[str, Any] = {
        "nearness": tree.nearness,
        "placed": tree.placed,
        "states": tree.states,
        "active": active,
        "pool": empty((chunks, CHUNK), np.int32),
        "used": empty((1,), np.int32),
        "layout": tree.layout,
        "max_error": max_error,
        "coarse": coarse,
    }
    launch(kernel("depthmesh/simplify.cl", "refine_coarse", CHUNK=CHUNK), (1,), **shared)
    if coarse > 1:
        launch(kernel("depthmesh/simplify.cl", "refine", CHUNK=CHUNK), grid, **shared)
    return active


def _least_cosine(camera: Camera) -> float:
    """Cosine of the largest angle between the camera's axis and a line of sight in its picture."""
    x, y = (np.array([-0.5, count - 0.5]) for count in camera.size)
    corners = np.linalg.inv(camera.K) @ [np.tile(x, 2), np.repeat(y, 2), np.ones(4)]
    return 1.0 / float(np.linalg.norm(corners, axis=0).max())
