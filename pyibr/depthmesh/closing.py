"""Closing of holes: surfaces that show where segmentation leaves holes (Pajarola, Sainz & Meng 2003, section 4.5)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pyibr.core.checks import Float64
from pyibr.depthmesh.far_sides import FarSides, far_sides_of
from pyibr.depthmesh.segmentation import Segmentation
from pyibr.depthmesh.selection import active_within
from pyibr.depthmesh.tree import Tree, build_tree
from pyibr.depthmesh.triangulation import Triangles, list_triangles
from pyibr.depthmesh.viewpoints import DrawnViews
from pyibr.images import DepthImage
from pyibr.opencl.memory import upload

Closed = Literal["sheets"] | bool
"""Ways of closing holes; False leaves holes open."""

Missing = Literal["unknown", "empty"]
"""Meanings of a sample without depth: its ray is not known, or meets no surface."""

_COARSE_ERROR = 0.001  # relative to the largest extent: error of the coarse meshes
_BACK_ERROR = 0.003  # relative to the largest extent: error of the back sides, which are not shown
_SHEET_STEP = 4  # samples along the sides of sheets' cells
_SIDES_ANGLE = 30.0  # degrees between the directions of two views that show a thing from different sides
_WHOLE = 0.98  # fraction of the surface that a view of the whole thing shows; the rest is noise
_PROBES = 5000  # points of the surface that are looked up in each view
_STRIDE = 0.015  # relative to the largest extent: distance between points along rays that look for empty space


@dataclass(frozen=True)
class CoarseMesh:
    """Triangles of a view, independent of the viewer: points, and corners as indices of points, as in `Triangles`."""

    points: NDArray[np.float32]
    corners: NDArray[np.int32]

    @classmethod
    def of(cls, tree: Tree, max_error: float) -> CoarseMesh:
        """Make the coarse mesh of a tree within a vertical error."""
        found = list_triangles([tree], [active_within(tree, max_error)], rated=True)
        return cls(found.points.to_host(), found.corners.to_host())

    @property
    def reversed(self) -> CoarseMesh:
        """The same mesh with front and back sides exchanged."""
        return CoarseMesh(self.points, self.corners[:, ::-1])


@dataclass
class Closing:
    """Surfaces that close holes, and the free space that each view has seen in front of surfaces.

    If sheets close holes, only `surfaces` is not empty, and contains the sheets.
    """

    surfaces: list[CoarseMesh]  # a coarse mesh of each view, which shows in holes
    backs: list[CoarseMesh] = field(default_factory=list[CoarseMesh])  # back sides of the surfaces
    sheets: list[CoarseMesh] = field(default_factory=list[CoarseMesh])  # coarse triangles in place of rubber sheets
    far_sides: list[FarSides] = field(default_factory=list[FarSides])
    arguments: dict[str, Any] = field(default_factory=dict[str, Any])  # FreeSpace of kernels/depthmesh/closing.h
    latest: tuple[DrawnViews, Triangles] | None = None  # cache: the most recent triangles, and their views

    def underlay(self, drawn: DrawnViews) -> Triangles:
        """List the triangles that precede the chosen views' meshes: sheets, back sides, surfaces of other views."""
        latest = self.latest
        if latest is not None and latest[0] == drawn:
            return latest[1]
        parts = [self.sheets[number] for number in drawn.sheets]
        parts += [self.backs[number] for number in drawn.around]
        parts += [self.surfaces[number] for number in drawn.others]
        point_firsts = np.cumsum([0, *(len(part.points) for part in parts)]).tolist()
        firsts = np.cumsum([0, *(len(part.corners) for part in parts)]).tolist()
        points = np.concatenate([part.points for part in parts])
        corners = np.concatenate([part.corners + first for part, first in zip(parts, point_firsts[:-1], strict=True)])
        made = Triangles(upload(points), upload(corners.astype(np.int32)), point_firsts, firsts)
        self.latest = drawn, made
        return made


def closing_of(trees: Sequence[Tree], extent: float, closed: Closed, missing: Missing) -> Closing:
    """Make the surfaces that close the holes of the trees' meshes; `extent` is the largest edge of their box."""
    views = [tree.view for tree in trees]
    if closed == "sheets":
        whole = [build_tree(view, Segmentation("none")) for view in views]
        return Closing([CoarseMesh.of(tree, _COARSE_ERROR * extent) for tree in whole])
    surfaces = [CoarseMesh.of(tree, _COARSE_ERROR * extent) for tree in trees]
    backs = [CoarseMesh.of(tree, _BACK_ERROR * extent).reversed for tree in trees]
    sheets = list(map(_sheets_of, trees))
    limits = list[NDArray[np.float32]]()
    for view in views:
        unseen = np.where((view.depth >= view.far) | (missing == "empty"), np.float32(np.inf), np.float32(0))
        limits.append(np.where(view.valid, view.depth, unseen))
    far_sides = list(map(far_sides_of, trees, limits))
    depths = [one.depth for one in far_sides]
    starts = np.cumsum([0, *(limit.size for limit in limits[:-1])])
    sizes = [(*view.camera.size, start) for view, start in zip(views, starts, strict=True)]
    images = {
        "free_depths": limits,
        "extended_depths": depths,
        "cell_free_depths": map(_least_in_cells, limits),
        "cell_extended_depths": map(_least_in_cells, depths),
    }
    arguments: dict[str, Any] = {
        name: upload(np.concatenate([image.ravel() for image in each])) for name, each in images.items()
    }
    arguments |= {
        "view_sizes": upload(np.array(sizes, np.int32)),
        "perspectives": upload(np.array([view.camera.projection == "perspective" for view in views], np.int32)),
        "view_count": len(views),
        "stride": _STRIDE * extent,
        "enclosed": _are_enclosed(views, limits),
    }
    return Closing(surfaces, backs, sheets, far_sides, arguments)


def _are_enclosed(views: Sequence[DepthImage], limits: Sequence[NDArray[np.float32]]) -> bool:
    """Tell whether every ray must meet a surface, as in a room: no view saw background.

    A thing whose views show all of it, from several sides, is not enclosed, though its views lack the background.
    """
    if not all(bool(np.isfinite(limit).all()) for limit in limits):
        return False
    directions = np.array([view.camera.forward for view in views])
    if all(view.valid.all() for view in views) or (directions @ directions.T).min() > np.cos(np.radians(_SIDES_ANGLE)):
        return True
    each = -(-_PROBES // len(views))
    probes = list[Float64]()
    for view in views:
        y, x = np.nonzero(view.valid)
        y, x = (part[:: -(-len(part) // each)] for part in (y, x))
        probes.append(view.camera.unproject(np.column_stack([x, y]).astype(np.float64), view.depth[y, x]))
    for view in views:
        pixels, depth = view.camera.project(np.concatenate(probes))
        in_picture = (pixels >= -0.5) & (pixels <= np.subtract(view.camera.size, 0.5))
        if np.mean(in_picture.all(axis=1) & (depth > 0)) < _WHOLE:
            return True
    return False


def _least_in_cells(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """Minimum of each cell's four samples, at its upper left sample; 0 in the last row and column."""
    least = np.zeros_like(values)
    rows = np.minimum(values[1:], values[:-1])
    least[:-1, :-1] = np.minimum(rows[:, 1:], rows[:, :-1])
    return least


def _sheets_of(tree: Tree) -> CoarseMesh:
    """Cover the cells that are not fully drawn with coarser triangles, which find rays that pass between surfaces."""
    camera, (width, height) = tree.view.camera, tree.view.camera.size
    rows, columns = (np.unique([*range(0, count, _SHEET_STEP), count - 1]) for count in (height, width))
    upper, lower = tree.drawn_cells()
    holed = np.logical_or.reduceat(np.logical_or.reduceat(~(upper & lower), rows[:-1]), columns[:-1], axis=1)
    sample = rows[:, None] * width + columns
    a, b, c, d = (at[holed] for at in (sample[:-1, :-1], sample[:-1, 1:], sample[1:, :-1], sample[1:, 1:]))
    corners = np.concatenate([np.column_stack([a, c, b]), np.column_stack([b, c, d])])
    used, numbers = np.unique(corners[tree.view.valid.ravel()[corners].all(axis=1)], return_inverse=True)
    pixels, depth = tree.vertices_of(used.astype(np.int32))
    scale, third = (depth, depth) if camera.projection == "perspective" else (np.ones_like(depth), -depth)
    points = np.column_stack([pixels * scale[:, None], third, np.zeros_like(depth)])
    return CoarseMesh(points.astype(np.float32), numbers.reshape(-1, 3).astype(np.int32))
