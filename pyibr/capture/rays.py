"""Exact intersection of a camera's rays with triangles: each ray is tested against the triangles over its cell.

Without a lens, each pixel is a cell, and triangles are processed row by row, as in a scan converter. With a lens,
pixels are sorted into cells by their positions in the image of the pinhole without the lens. All in float64, on the
host.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera
from pyibr.core.checks import Float64

Int64 = NDArray[np.int64]

NOTHING = -1
"""Index instead of a triangle where a ray meets none."""

_NUDGE = 1e-3  # pixels by which a ray that hits no triangle may miss one: it may pass exactly through an edge
_NEAR = 1e-6  # nearest depth that counts, as a share of the depth of the farthest vertex
_AT_ONCE = 1 << 18  # triangles, rows of them, or rays on these in one batch


@dataclass(frozen=True)
class Rays:
    """Rays of a camera's pixels, sorted into cells.

    Attributes
    ----------
    camera : Camera
    places : (N, 2)
        Positions of the pixels in the image of the pinhole without the lens.
    columns, rows : (2, n)
        Lowest and highest position of each column and row of cells, in ascending order.
    order : (n,)
        Pixels whose rays are defined, cell by cell, row by row.
    starts : (rows * columns + 1,)
        Start of each cell's part of `order`.
    """

    camera: Camera
    places: Float64
    columns: Float64
    rows: Float64
    order: Int64
    starts: Int64

    @classmethod
    def of(cls, camera: Camera) -> Rays:
        """Return the rays through all pixel centres."""
        width, height = camera.size
        pixels = pixel_centers(camera)
        if camera.lens is None:
            columns, rows = (np.stack([np.arange(count, dtype=np.float64)] * 2) for count in camera.size)
            every = np.arange(len(pixels) + 1)
            return cls(camera, pixels, columns, rows, every[:-1], every)
        places = camera.ideal_positions(pixels) @ camera.K[:2, :2].T + camera.K[:2, 2]
        seen = np.flatnonzero(np.isfinite(places).all(axis=1))  # pixels whose rays the lens defines
        if not len(seen):
            return cls(camera, places, np.zeros((2, 0)), np.zeros((2, 0)), seen, np.zeros(1, np.int64))
        columns, column = _strips(places[seen, 0], width)
        rows, row = _strips(places[seen, 1], height)
        cell = row * width + column
        order = np.argsort(cell, kind="stable")
        starts = np.searchsorted(cell[order], np.arange(width * height + 1))
        return cls(camera, places, columns, rows, seen[order], starts)

    def meet(self, vertices: Float64, faces: Int64, last: bool = False) -> Int64:
        """Return the first or last triangle that each ray meets in front of the camera, or `NOTHING`: (N,).

        Among equally distant triangles, the lowest index wins. A ray that meets no triangle gets one that it passes
        within a thousandth of a pixel.
        """
        corners, depths = self._in_pixels(vertices)
        found = _Met(len(self.places), -1.0 if last else 1.0)
        near = _NEAR * max(float(depths.max()), 0.0)
        if near > 0 and len(self.order):
            for first in range(0, len(faces), _AT_ONCE):
                part = faces[first : first + _AT_ONCE]
                some = np.flatnonzero((depths[part] > near).any(axis=1))
                if len(some):
                    self._meet_some(corners[part[some]], depths[part[some]], first + some, near, found)
        return found.triangle

    def _in_pixels(self, vertices: Float64) -> tuple[Float64, Float64]:
        """Return vertices as homogeneous positions in the pinhole's image, (N, 3), and their depths, (N,)."""
        local = (vertices - self.camera.center) @ self.camera.world_from_camera[:3, :3]
        depths = local[:, 2].copy()
        if self.camera.projection == "orthographic":
            local[:, 2] = 1
        return local @ self.camera.K.T, depths

    def _meet_some(self, corners: Float64, depths: Float64, names: Int64, near: float, found: _Met) -> None:
        """Test triangles by their homogeneous corners (n, 3, 3) and depths (n, 3); `names` are their indices."""
        for ray, candidate in self._candidates(*_before(corners, depths, near)):
            tried, triangle = np.unique(candidate, return_inverse=True)
            corner, z_of_corner = corners[tried], depths[tried]
            edges = np.cross(corner[:, [1, 2, 0]], corner[:, [2, 0, 1]])  # opposite to each corner
            turned = np.sign(np.einsum("nc,nc->n", edges[:, 0], corner[:, 0]))
            edges *= turned[:, None, None]
            within = _NUDGE * np.hypot(edges[..., 0], edges[..., 1])
            x, y = self.places[ray].T
            a, b, c = np.moveaxis(edges[triangle], 2, 0)
            inside = a * x[:, None] + b * y[:, None] + c  # edge functions; 0 on the edge
            with np.errstate(divide="ignore", invalid="ignore"):
                z = np.sum(inside * z_of_corner[triangle], axis=1) / np.sum(inside, axis=1)
            meets = (turned[triangle] != 0) & (inside >= -within[triangle]).all(axis=1) & (z > 0)
            exact = (inside >= 0).all(axis=1)
            found.add(ray[meets], names[candidate[meets]], z[meets], exact[meets])

    def _candidates(self, corners: Float64, number: Int64) -> Iterator[tuple[Int64, Int64]]:
        """Yield pairs of a ray and a triangle over its cell, from triangles (n, 3, 2) in the image."""
        low, high = corners[..., 1].min(axis=1) - _NUDGE, corners[..., 1].max(axis=1) + _NUDGE
        first = cast("Int64", np.searchsorted(self.rows[1], low))
        end = cast("Int64", np.searchsorted(self.rows[0], high, side="right"))
        for one, row in _ranges(first, end):
            left, right = _across(corners[one], self.rows[0, row] - _NUDGE, self.rows[1, row] + _NUDGE)
            row_start = row * self.columns.shape[1]
            first_cell = row_start + np.searchsorted(self.columns[1], left - _NUDGE)
            end_cell = row_start + np.searchsorted(self.columns[0], right + _NUDGE, side="right")
            for span, place in _ranges(self.starts[first_cell], self.starts[np.maximum(end_cell, first_cell)]):
                yield self.order[place], number[one[span]]


def pixel_centers(camera: Camera) -> Float64:
    """Pixel centres, (H * W, 2), row by row."""
    grid = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    return np.stack(grid, axis=-1).reshape(-1, 2).astype(np.float64)


class _Met:
    """Nearest, or farthest, triangle that each ray has met so far."""

    def __init__(self, count: int, sense: float) -> None:
        self._sense = sense
        self._depth = np.full((2, count), np.inf)  # exact hits, and hits within _NUDGE
        self._triangle = np.full((2, count), NOTHING)

    @property
    def triangle(self) -> Int64:
        """Triangle of each ray, (N,)."""
        exact, nudged = self._triangle
        return np.where(exact == NOTHING, nudged, exact)

    def add(self, ray: Int64, triangle: Int64, z: Float64, exact: NDArray[np.bool_]) -> None:
        """Update rays whose new triangle is nearer, or farther, than the one so far."""
        for kind, mine in enumerate((exact, ~exact)):
            at, key, name = ray[mine], self._sense * z[mine], triangle[mine]
            before = self._depth[kind, at]
            np.minimum.at(self._depth[kind], at, key)
            won = np.flatnonzero((key < before) & (key == self._depth[kind, at]))[::-1]  # reversed: the first wins
            self._triangle[kind, at[won]] = name[won]


def _strips(values: Float64, count: int) -> tuple[Float64, Int64]:
    """Sort values into `count` strips of about equal number: their bounds (2, count), and each value's strip."""
    bounds = np.quantile(values, np.linspace(0, 1, count + 1))
    strip = cast("Int64", np.searchsorted(bounds[1:-1], values, side="right"))
    return np.stack([bounds[:-1], bounds[1:]]), strip


def _ranges(first: Int64, end: Int64) -> Iterator[tuple[Int64, Int64]]:
    """Yield ranges' indices and numbers, from `first` to `end`, exclusive, in batches."""
    counts = np.maximum(end - first, 0)
    total: Int64 = np.concatenate([[0], np.cumsum(counts)])
    begin = 0
    while begin < len(counts):
        enough = cast("int", np.searchsorted(total, total[begin] + _AT_ONCE, side="right"))
        stop = max(enough - 1, begin + 1)
        owner = np.repeat(np.arange(begin, stop), counts[begin:stop])
        yield owner, first[owner] + np.arange(total[begin], total[stop]) - total[owner]
        begin = stop


def _across(corners: Float64, low: Float64, high: Float64) -> tuple[Float64, Float64]:
    """Least and greatest x of triangles, (n, 3, 2), each within a range of y; inf, -inf if there is none."""
    left, right = np.full(len(corners), np.inf), np.full(len(corners), -np.inf)
    for k in range(3):
        (x, y), (to_x, to_y) = corners[:, k].T, corners[:, (k + 1) % 3].T
        down = np.where(to_y == y, 1e-30, to_y - y)
        with np.errstate(over="ignore"):
            one, other = (low - y) / down, (high - y) / down
        enters, leaves = np.maximum(np.minimum(one, other), 0), np.minimum(np.maximum(one, other), 1)
        within = enters <= leaves
        for part in (enters, leaves):
            at = np.where(within, x + np.clip(part, 0, 1) * (to_x - x), np.nan)
            left, right = np.fmin(left, at), np.fmax(right, at)
    return left, right


def _before(corners: Float64, depths: Float64, near: float) -> tuple[Float64, Int64]:
    """Clip triangles (n, 3, 3) at a near plane: image positions (m, 3, 2), and indices of the original triangles.

    A triangle that the plane cuts becomes one or two smaller ones.
    """
    ahead = depths > near
    count = ahead.sum(axis=1)
    whole = np.flatnonzero(count == 3)
    parts, numbers = [corners[whole]], [whole]
    for alone in (1, 2):  # corners in front of the plane
        cut = np.flatnonzero(count == alone)
        lone = (ahead[cut] == (alone == 1)).argmax(axis=1)[:, None]  # the corner that is alone on its side
        turn = (lone + np.arange(3)) % 3
        tip, second, third = np.moveaxis(np.take_along_axis(corners[cut], turn[..., None], axis=1), 1, 0)
        z = np.take_along_axis(depths[cut], turn, axis=1)
        share = ((near - z[:, :1]) / (z[:, 1:] - z[:, :1]))[..., None]
        on_second, on_third = tip + share[:, 0] * (second - tip), tip + share[:, 1] * (third - tip)
        if alone == 1:
            parts.append(np.stack([tip, on_second, on_third], axis=1))
            numbers.append(cut)
        else:
            parts += [np.stack([second, third, on_third], axis=1), np.stack([second, on_third, on_second], axis=1)]
            numbers += [cut, cut]
    every = np.concatenate(parts)
    return every[..., :2] / every[..., 2:], np.concatenate(numbers)
