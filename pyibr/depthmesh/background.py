"""What shows through the holes that segmentation leaves (Pajarola, Sainz & Meng 2003, section 4.5)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pyibr.depthmesh.segmentation import Segmentation
from pyibr.depthmesh.tree import Tree, build_tree
from pyibr.depthmesh.triangulation import Triangles, active_within, list_triangles, pixels_of
from pyibr.images.depth_image import DepthImage
from pyibr.opencl.memory import DeviceArray, upload

_COARSE_ERROR = 0.005  # of the largest extent: that of the coarse meshes


class ViewMesh(Protocol):
    """The mesh of a view."""

    @property
    def view(self) -> DepthImage:
        """What it is a mesh of."""
        ...

    @property
    def tree(self) -> Tree:
        """Its quadtree on the current device."""
        ...


@dataclass
class Background:
    """What shows through holes, and up to where each view has seen that there is nothing.

    `points` are each view's, of its coarse triangles `closed`, which segmentation took nothing from, and of those among
    them over what it took, `bridges`. `latest` are those that were drawn last: for other views they differ.
    """

    points: list[NDArray[np.float32]]
    closed: list[NDArray[np.int32]]
    bridges: list[NDArray[np.int32]]
    limits: DeviceArray
    sizes: DeviceArray
    latest: tuple[object, Triangles | None] = (None, None)


def background_of(meshes: Sequence[ViewMesh], extent: float) -> Background:
    """What shows through the holes of meshes whose box has this largest edge."""
    points, limits = list[NDArray[np.float32]](), list[NDArray[np.float32]]()
    closed, bridges = list[NDArray[np.int32]](), list[NDArray[np.int32]]()
    for mesh in meshes:
        tree = build_tree(mesh.view, Segmentation("none"))
        coarse = list_triangles([tree], [active_within(tree, _COARSE_ERROR * extent)], rated=True)
        points.append(coarse.points.to_host())
        closed.append(coarse.corners.to_host())
        bridges.append(_over_holes(closed[-1], points[-1], mesh))
        view = mesh.view
        unseen = np.where(view.depth >= view.far, np.float32(np.inf), np.float32(0))
        limits.append(np.where(view.valid, view.depth, unseen).ravel())
    starts = np.cumsum([0, *(limit.size for limit in limits[:-1])])
    sizes = [(*mesh.view.camera.size, start) for mesh, start in zip(meshes, starts, strict=True)]
    return Background(points, closed, bridges, upload(np.concatenate(limits)), upload(np.array(sizes, np.int32)))


def _over_holes(corners: NDArray[np.int32], points: NDArray[np.float32], mesh: ViewMesh) -> NDArray[np.int32]:
    """Those of a view's triangles whose boxes hold a cell that is not drawn in full."""
    width, height = mesh.view.camera.size
    upper, lower = mesh.tree.drawn_cells()
    holes = np.zeros((height, width), np.int32)  # above and to the left of each sample
    holes[1:, 1:] = np.cumsum(np.cumsum(~(upper & lower), axis=0, dtype=np.int32), axis=1)
    x, y = np.moveaxis(pixels_of(points[corners], mesh.view), -1, 0)
    low_x, low_y, high_x, high_y = x.min(axis=1), y.min(axis=1), x.max(axis=1), y.max(axis=1)
    within = holes[high_y, high_x] - holes[low_y, high_x] - holes[high_y, low_x] + holes[low_y, low_x]
    return corners[within > 0]


def underlay_of(background: Background, chosen: list[int], others: list[int]) -> Triangles:
    """What shows through the holes of the chosen views' meshes: their bridges, and the closed meshes of others."""
    which, found = background.latest
    if found is not None and which == (chosen, others):
        return found
    parts = [(number, background.bridges[number]) for number in chosen]
    parts += [(number, background.closed[number]) for number in others]
    point_firsts = np.cumsum([0, *(len(background.points[number]) for number, _ in parts)]).tolist()
    firsts = np.cumsum([0, *(len(corners) for _, corners in parts)]).tolist()
    points = np.concatenate([background.points[number] for number, _ in parts])
    corners = np.concatenate([part + first for (_, part), first in zip(parts, point_firsts[:-1], strict=True)])
    made = Triangles(upload(points), upload(corners.astype(np.int32)), point_firsts, firsts)
    background.latest = (chosen, others), made
    return made
