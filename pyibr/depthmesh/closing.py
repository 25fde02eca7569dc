"""Hole closing: surfaces behind the holes that segmentation leaves (Pajarola, Sainz & Meng 2003, section 4.5)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera
from pyibr.core.checks import Float64
from pyibr.depthmesh.far_sides import FarSides, ViewMesh, far_sides_of
from pyibr.depthmesh.segmentation import Segmentation
from pyibr.depthmesh.selection import active_within
from pyibr.depthmesh.tree import Tree, build_tree
from pyibr.depthmesh.triangulation import Triangles, list_triangles, pixels_of
from pyibr.opencl.memory import DeviceArray, upload

_COARSE_ERROR = 0.001  # of the largest extent: that of the coarse meshes
_STRIDE = 0.015  # of the largest extent: from point to point along rays that look for empty space


@dataclass(frozen=True)
class CoarseMesh:
    """Triangles of a view that do not depend on the viewer: points and their numbers, as of `Triangles`."""

    points: NDArray[np.float32]
    corners: NDArray[np.int32]

    @classmethod
    def of(cls, tree: Tree, max_error: float) -> CoarseMesh:
        """Those of a tree within a vertical error."""
        found = list_triangles([tree], [active_within(tree, max_error)], rated=True)
        return cls(found.points.to_host(), found.corners.to_host())

    @property
    def reversed(self) -> CoarseMesh:
        """The same with fronts and backs exchanged."""
        return CoarseMesh(self.points, self.corners[:, ::-1])


@dataclass
class Closing:
    """Surfaces that close holes, and the free space in front of them that each view has seen.

    Of each view: its `surfaces`, and the `sheets` over what segmentation took out; its `limits`, and how far it is
    taken to be empty `behind` them, and the least of both in each cell: `clear`, `open` (kernels/depthmesh/closing.h);
    `continued` tells the colours there. `stride` is how far apart points are along rays that look for what no view saw
    to be empty. `enclosed`: no view saw background. `latest` are the triangles that were drawn last: for other views
    they differ.
    """

    surfaces: list[CoarseMesh]
    sheets: list[CoarseMesh]
    limits: DeviceArray
    behind: DeviceArray
    continued: list[FarSides]
    clear: DeviceArray
    open: DeviceArray
    sizes: DeviceArray
    stride: float
    enclosed: bool
    latest: tuple[object, Triangles | None] = (None, None)


def closing_of(meshes: Sequence[ViewMesh], extent: float) -> Closing:
    """Make the surfaces that close the holes of meshes whose box has this largest edge."""
    limits = list[NDArray[np.float32]]()
    surfaces, sheets = list[CoarseMesh](), list[CoarseMesh]()
    for mesh in meshes:
        surfaces.append(CoarseMesh.of(mesh.tree, _COARSE_ERROR * extent))
        stretched = CoarseMesh.of(build_tree(mesh.view, Segmentation("none")), _COARSE_ERROR * extent)
        sheets.append(CoarseMesh(stretched.points, _over_holes(stretched, mesh)))
        view = mesh.view
        unseen = np.where(view.depth >= view.far, np.float32(np.inf), np.float32(0))
        limits.append(np.where(view.valid, view.depth, unseen))
    starts = np.cumsum([0, *(limit.size for limit in limits[:-1])])
    sizes = upload(np.array([(*m.view.camera.size, s) for m, s in zip(meshes, starts, strict=True)], np.int32))
    continued = list(map(far_sides_of, meshes, limits))
    depths = [one.depth for one in continued]
    cells = ([_least_in_cells(part) for part in each] for each in (limits, depths))
    limit, behind, clear, opened = (
        upload(np.concatenate([part.ravel() for part in each])) for each in (limits, depths, *cells)
    )
    enclosed = all(bool(np.isfinite(one).all()) for one in limits)
    return Closing(surfaces, sheets, limit, behind, continued, clear, opened, sizes, _STRIDE * extent, enclosed)


def _least_in_cells(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """The least of each cell's four samples, at its upper left one; 0 in the last row and column."""
    least = np.zeros_like(values)
    rows = np.minimum(values[1:], values[:-1])
    least[:-1, :-1] = np.minimum(rows[:, 1:], rows[:, :-1])
    return least


def _over_holes(coarse: CoarseMesh, mesh: ViewMesh) -> NDArray[np.int32]:
    """Those of a view's triangles, (T, 3), whose boxes hold a cell that is not drawn in full."""
    width, height = mesh.view.camera.size
    upper, lower = mesh.tree.drawn_cells()
    holes = np.zeros((height, width), np.int32)  # above and to the left of each sample
    holes[1:, 1:] = np.cumsum(np.cumsum(~(upper & lower), axis=0, dtype=np.int32), axis=1)
    x, y = np.moveaxis(pixels_of(coarse.points[coarse.corners], mesh.view), -1, 0)
    low_x, low_y, high_x, high_y = x.min(axis=1), y.min(axis=1), x.max(axis=1), y.max(axis=1)
    within = holes[high_y, high_x] - holes[low_y, high_x] - holes[high_y, low_x] + holes[low_y, low_x]
    return coarse.corners[within > 0]


@dataclass(frozen=True)
class DrawnViews:
    """Numbers of the views whose meshes are drawn.

    Attributes
    ----------
    chosen : list of int
        The closest ones, which are blended.
    others : list of int
        Those that show in their holes: the next closest.
    around : list of int
        Those whose backs tell of surface that nobody saw: the others, as many of the farthest, which see the thing from
        behind, and of the closest those that the camera may see the backs of, as of the wall of a cup that it is in.
    """

    chosen: list[int]
    others: list[int]
    around: list[int]

    @classmethod
    def of(cls, order: list[int], count: int, backs: list[int]) -> DrawnViews:
        """Of all views, the closest first, of which so many are blended. `backs`: of these, those that may show."""
        others = order[count : 2 * count]
        return cls(sorted(order[:count]), sorted(others), sorted({*others, *order[-count:], *backs}))

    @property
    def views(self) -> list[int]:
        """The view of each mesh that is drawn: sheets, backs, others' surfaces, then those of the chosen ones."""
        return [*self.chosen, *self.others, *self.around, *self.others, *self.chosen]


def may_show_its_back(view: Camera, camera: Camera, bounds: tuple[Float64, Float64]) -> bool:
    """Tell whether a camera may see behind a view's mesh: along the view's direction it is not before all of a box."""
    towards = -view.forward
    if camera.projection == "orthographic":
        return bool(camera.forward @ towards >= 0)
    return bool(camera.center @ towards <= np.maximum(bounds[0] * towards, bounds[1] * towards).sum())


def underlay_of(background: Closing, drawn: DrawnViews) -> Triangles:
    """List the triangles under the chosen views' meshes, in the order of `drawn`: sheets, backs, others' surfaces."""
    which, found = background.latest
    if found is not None and which == drawn:
        return found
    parts = [background.sheets[number] for number in (*drawn.chosen, *drawn.others)]
    parts += [background.surfaces[number].reversed for number in drawn.around]
    parts += [background.surfaces[number] for number in drawn.others]
    point_firsts = np.cumsum([0, *(len(part.points) for part in parts)]).tolist()
    firsts = np.cumsum([0, *(len(part.corners) for part in parts)]).tolist()
    points = np.concatenate([part.points for part in parts])
    corners = np.concatenate([part.corners + first for part, first in zip(parts, point_firsts[:-1], strict=True)])
    made = Triangles(upload(points), upload(corners.astype(np.int32)), point_firsts, firsts)
    background.latest = drawn, made
    return made
