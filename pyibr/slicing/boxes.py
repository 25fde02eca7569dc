"""Bounding boxes of objects, from their views' samples or silhouettes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from weakref import WeakKeyDictionary, ref

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera
from pyibr.core.checks import Float64
from pyibr.core.errors import ArgumentError
from pyibr.images import DepthImage
from pyibr.images.silhouette import Silhouette

_FIRST = 8  # cells per side of the first grid in the search for a hull's box
_DEPTH_RATIO_MAX = 64  # largest cube in the search, in widths of the silhouettes
_CARVED = 64  # smallest number of cells along the longest edge of the found box


@dataclass(frozen=True)
class Box:
    """An oriented box around an object, in the world."""

    axes: Float64  # (3, 3) unit vectors along the edges, as rows
    low: Float64  # (3,) extent along `axes`
    high: Float64

    @property
    def edges(self) -> Float64:
        """(3,) lengths of the edges."""
        return self.high - self.low

    @property
    def corners(self) -> Float64:
        """(8, 3) in the world."""
        grid = np.array(np.meshgrid(*zip(self.low, self.high, strict=True))).reshape(3, -1).T
        return grid @ self.axes

    @property
    def bounds(self) -> tuple[Float64, Float64]:
        """(low, high), each (3,), in the world: the box around this one along the world's axes."""
        return self.corners.min(axis=0), self.corners.max(axis=0)

    @property
    def center(self) -> Float64:
        """(3,) in the world."""
        return 0.5 * (self.low + self.high) @ self.axes

    def grown(self, by: float) -> Box:
        """Return the box with all sides moved outwards by a distance."""
        return Box(self.axes, self.low - by, self.high + by)

    @property
    def from_world(self) -> Float64:
        """(3, 4) matrix from the world to the unit cube of the box."""
        return np.column_stack([self.axes, -self.low]) / self.edges[:, None]


class DepthExtent:
    """Extent of an object, from the samples of a depth image."""

    def __init__(self, view: DepthImage) -> None:
        self._view = ref(view)
        self._extents: dict[bytes, tuple[Float64, Float64]] = {}
        some = np.flatnonzero(view.valid)
        few = len(some) // 100
        depth = view.depth[view.valid]
        # The nearest hundredth of the samples may be wrong. A hull may lie between the samples of a view.
        self.nearest = float(np.partition(depth, few)[few]) if len(depth) else math.inf
        self.least, self.farthest = float(depth.min(initial=math.inf)), float(depth.max(initial=0.0))
        some = some[:: max(len(some) // 500, 1)]
        y, x = np.divmod(some, view.camera.width)
        # (N, 3) some 500 to 1000 of the samples, in the world
        self.some = view.camera.unproject(np.column_stack([x, y]), view.depth.ravel()[some])

    def extent(self, axes: Float64) -> tuple[Float64, Float64]:
        """Return the extent of all samples along axes, (3, 3) in rows, as (low, high), each (3,)."""
        view, key = self._view(), axes.tobytes()
        if key not in self._extents:
            assert view is not None
            self._extents = {key: view.bounds_of(view.valid, axes)}
        return self._extents[key]


_DEPTH_EXTENTS: WeakKeyDictionary[DepthImage, DepthExtent] = WeakKeyDictionary()


def depth_extent_of(view: DepthImage) -> DepthExtent:
    """Return an image's extent, computed once for all objects with this image."""
    if view not in _DEPTH_EXTENTS:
        _DEPTH_EXTENTS[view] = DepthExtent(view)
    return _DEPTH_EXTENTS[view]


def box_of_samples(views: list[DepthImage], missing_is_empty: bool) -> Box:
    """Return the box of all samples along the first view's axes; raise if no sample lies in all views' volumes."""
    axes = views[0].camera.world_from_camera[:3, :3].T
    extents = [depth_extent_of(view).extent(axes) for view in views]
    low, high = np.min([low for low, _ in extents], axis=0), np.max([high for _, high in extents], axis=0)
    # A flat box has no inside; far from the world's origin, tiny margins are rounded away.
    margin = max(1e-3 * float((high - low).max()), 1e-15, 8 * float(np.spacing(np.abs([low, high]).max())))
    box = Box(axes, low - margin, high + margin)
    some = np.concatenate([depth_extent_of(view).some for view in views])
    reach = 0.05 * float(box.edges.max())  # samples lie slightly off the surfaces of other views
    for few in (some[::16], some):  # for most objects a few samples suffice
        inside = np.ones(len(few), bool)
        for view in views:
            x, y, z, on_image = _seen_from(view.camera, few)
            nearest = _nearest_around(view, missing_is_empty, x, y)
            inside &= (on_image & (nearest <= z + reach)) | (~on_image & (not missing_is_empty))
        if inside.any():
            return box
    raise ArgumentError("views", "views of one object with overlapping volumes", "volumes without overlap")


def _nearest_around(view: DepthImage, missing_is_empty: bool, x: NDArray[np.intp], y: NDArray[np.intp]) -> Float64:
    """Return the least depth of 3x3 pixels around x, y, as points may lie on outlines; empty space counts as far."""
    down, across = np.divmod(np.arange(9)[:, None], 3)
    height, width = view.depth.shape
    at = np.clip(y + down - 1, 0, height - 1), np.clip(x + across - 1, 0, width - 1)
    depth = view.depth[at].astype(np.float64)
    empty = missing_is_empty | (depth >= view.far)
    return np.where(view.valid[at], depth, np.where(empty, 1e38, -1e38)).min(axis=0)


def _seen_from(
    camera: Camera, points: Float64
) -> tuple[NDArray[np.intp], NDArray[np.intp], Float64, NDArray[np.bool_]]:
    """Return nearest pixels x, y and depths of world points, and a mask of points on the image (else x = y = 0)."""
    u, v, w, _ = camera.pixel_matrix @ camera.camera_from_world @ np.column_stack([points, np.ones(len(points))]).T
    z = camera.camera_from_world[2, :3] @ points.T + camera.camera_from_world[2, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        x, y = np.rint(u / w), np.rint(v / w)
        on_image = (w > 0) & (z > 0) & (x >= 0) & (x < camera.width) & (y >= 0) & (y < camera.height)
    return np.where(on_image, x, 0).astype(np.intp), np.where(on_image, y, 0).astype(np.intp), z, on_image


class Outline:
    """Tests of points against a silhouette's outline.

    The bounding rectangle of the silhouette has its centre at `middle`, (2,), and a diagonal `across` samples long.
    """

    def __init__(self, view: Silhouette | DepthImage) -> None:
        self.camera = view.camera
        x, y = (np.flatnonzero(view.valid.any(axis=axis))[[0, -1]].astype(np.float64) for axis in (0, 1))
        self.middle = 0.5 * np.array([x.sum(), y.sum()])
        self.across = float(np.hypot(np.ptp(x) + 1, np.ptp(y) + 1))
        # Summed-area table: the number of samples in a rectangle follows from the sums at its corners.
        self._before = np.pad(np.cumsum(np.cumsum(view.valid, axis=0, dtype=np.int32), axis=1), ((1, 0), (1, 0)))

    def holds(self, points: Float64) -> NDArray[np.bool_]:
        """Tell which of (N, 3) points surely lie within the outline, surrounded by the object's samples."""
        u, v, w = self._seen(points)
        with np.errstate(divide="ignore", invalid="ignore"):
            return (w > 0) & (self._count(u / w, v / w, 1.0) == 9)

    def touches(self, points: Float64, reach: float) -> NDArray[np.bool_]:
        """Tell whether balls of radius `reach` around (N, 3) points may lie partly within the outline."""
        u, v, w = self._seen(points)
        K = self.camera.K
        pixels = np.float64(max(abs(K[0, 0]) + abs(K[0, 1]), K[1, 1]))  # longest image of a scene unit at depth 1
        with np.errstate(divide="ignore", invalid="ignore"):
            u, v = u / w, v / w
            around = pixels * reach
            if self.camera.projection == "perspective":  # w is z; near parts of the ball project farther out
                slope = np.hypot(u - K[0, 2], v - K[1, 2]) / pixels
                around = np.where(w > reach, around * (1 + slope) / (w - reach), np.inf)
        # A mask is interpolated bilinearly from samples up to one sample away; rounding (u, v) adds half a sample.
        return (w > -reach) & (self._count(u, v, np.floor(around + 1.5)) > 0)

    def _seen(self, points: Float64) -> Float64:
        """Return the world points' homogeneous pixels, (3, N)."""
        to_pixels = (self.camera.pixel_matrix @ self.camera.camera_from_world)[:3]
        return to_pixels[:, :3] @ points.T + to_pixels[:, 3:]

    def _count(self, u: Float64, v: Float64, around: Float64 | float) -> NDArray[np.int32]:
        """Count the object's samples up to `around` away, in x and y, from the sample nearest to (u, v); inf: all."""
        width, height = self.camera.size
        x, y = np.nan_to_num(np.rint(u)), np.nan_to_num(np.rint(v))
        ends = (x - around, width), (x + around + 1, width), (y - around, height), (y + around + 1, height)
        left, right, top, bottom = (np.clip(at, 0, end).astype(np.intp) for at, end in ends)
        before = self._before
        return before[bottom, right] - before[top, right] - before[bottom, left] + before[top, left]


_OUTLINES: WeakKeyDictionary[Silhouette | DepthImage, Outline] = WeakKeyDictionary()


def outline_of(view: Silhouette | DepthImage) -> Outline:
    """Return a silhouette's outline, computed once for all hulls with this silhouette."""
    if view not in _OUTLINES:
        _OUTLINES[view] = Outline(view)
    return _OUTLINES[view]


def box_of_silhouettes(views: Sequence[Silhouette | DepthImage]) -> Box:
    """Return the box, along the world's axes, around the space within all silhouettes.

    Along the lines of sight the hull may be longer than any silhouette is wide. So cubes of growing size are searched,
    until a cube contains the box, or the next cube would contain a camera. For views along one line, the box is as
    long as it is wide.
    """
    outlines = [outline_of(view) for view in views]
    center, radius, radius_max = _where_they_look(outlines)
    while True:
        box = _carved(outlines, center, radius)
        holds = box is not None and (np.abs([box.low - center, box.high - center]) < 0.999 * radius).all()
        if holds or 2 * radius > radius_max:
            break
        radius *= 2
    if box is None:
        raise ArgumentError("views", "silhouettes of one object that overlap in space", "no overlap")
    return box


def _carved(outlines: Sequence[Outline], center: Float64, radius: float) -> Box | None:
    """Return the box around the cells of a cube that may lie partly within all silhouettes; None if no cell may.

    Cells are halved until the longest edge has `_CARVED` of them. Cells inside the extent of the points that surely
    lie within all silhouettes cannot change the box, and are dropped.
    """
    low, cell = center - radius, 2 * radius / _FIRST
    cells = np.indices((_FIRST, _FIRST, _FIRST)).reshape(3, -1).T
    while True:
        for outline in outlines:
            cells = cells[outline.touches(low + (cells + 0.5) * cell, 0.5 * float(np.sqrt(3)) * cell)]
        if not len(cells):
            return None
        first, last = cells.min(axis=0), cells.max(axis=0) + 1
        if (last - first).max() >= _CARVED:
            return Box(np.eye(3), low + first * cell, low + last * cell)
        held = cells
        for outline in outlines:
            held = held[outline.holds(low + (held + 0.5) * cell)]
        if len(held):
            cells = cells[((cells <= held.min(axis=0)) | (cells >= held.max(axis=0))).any(axis=1)]
        cells = (2 * cells[:, None] + np.indices((2, 2, 2)).reshape(3, -1).T).reshape(-1, 3)
        cell *= 0.5


def _where_they_look(outlines: Sequence[Outline]) -> tuple[Float64, float, float]:
    """Return the point closest to the rays through the silhouettes' middles, and two radii of the object around it.

    The first radius is estimated from the width of the silhouettes; the second is the largest that may be tried.
    """
    origins, directions = np.zeros((len(outlines), 3)), np.zeros((len(outlines), 3))
    for number, outline in enumerate(outlines):
        camera = outline.camera
        to_world = camera.world_from_camera @ np.linalg.inv(camera.pixel_matrix)
        middle = to_world[:3, :3] @ (*outline.middle, 1.0)
        if camera.projection == "perspective":
            origins[number], directions[number] = camera.world_from_camera[:3, 3], middle
        else:
            origins[number], directions[number] = middle, camera.world_from_camera[:3, 2]
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    across = np.eye(3) - directions[:, :, None] * directions[:, None, :]
    # The solution is relative to the mean origin: along parallel rays any point is closest, and the mean is a good one.
    mean = origins.mean(axis=0)
    right: Float64 = np.einsum("nij,nj->i", across, origins - mean)
    system: Float64 = across.sum(axis=0)
    offset: Float64 = np.linalg.lstsq(system, right, rcond=1e-9)[0].astype(np.float64)
    perspective = any(outline.camera.projection == "perspective" for outline in outlines)
    turned = directions @ directions[0]
    if perspective and (turned > 1 - 1e-9).all():
        raise ArgumentError("views", "silhouettes from more than one direction", "all from one side")
    center, radius = mean + offset, 0.0
    radius_max = math.inf if (np.abs(turned) < 1 - 1e-9).any() else 0.0
    for outline in outlines:
        camera = outline.camera
        z = float(camera.camera_from_world[2, :3] @ center + camera.camera_from_world[2, 3])
        scale = float(min(camera.K[0, 0], camera.K[1, 1]))
        far = abs(z) if camera.projection == "perspective" else 1.0
        radius = max(radius, 0.5 * outline.across / scale * far)
        if camera.projection == "perspective":
            radius_max = min(radius_max, float(np.abs(camera.center - center).max()))
    radius = 1.5 * max(radius, 1e-15, 64 * _CARVED * float(np.spacing(np.abs(center).max())))
    return center, radius, min(radius_max, _DEPTH_RATIO_MAX * radius)
