"""Edges of a depth image, across which its surface is torn, and the surface beyond the image's border, in NumPy.

This is the readable form of `kernels/picture/edges.cl`. Nearness is 1/z for perspective views and -z for orthographic
views, and NaN where there is no sample. Edges are three masks (H, W): whether a sample is torn from its right
neighbour, from its lower neighbour, and whether these two neighbours are torn from each other.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.images import DepthImage

Array = NDArray[Any]

STEEPEST = 8.0
STEEP_MAX = 0.025
DEVIATIONS = 4.0 * np.sqrt(2.0)
KEEP, BEND, STEEP, SAME, LEAST = (np.float32(number) for number in (0.1, 0.6, 4.0, 2.05, 0.05))
LEAST_BEYOND = 1e-3


@dataclass(frozen=True)
class Edges:
    """Torn pairs of neighbours, each mask (H, W) bool."""

    right: Array
    below: Array
    diagonal: Array


def nearness_of(view: DepthImage) -> Array:
    """Nearness (H, W), float64; NaN where there is no sample."""
    z = np.where(view.valid, view.depth.astype(np.float64), np.nan)
    return 1 / z if view.camera.projection == "perspective" else -z


def edges_of(view: DepthImage, edges: str = "cut", cut_ratio: float | None = None) -> Edges:
    """Edges of a view, with options as for `WarpedView`; a missing sample is torn from all its neighbours."""
    near = nearness_of(view).astype(np.float32)
    if edges == "connect":
        return Edges(*(~np.isfinite(b - a) for a, b in _pairs(near)))
    if cut_ratio is not None:
        perspective, camera = view.camera.projection == "perspective", view.camera
        longer_side = max(camera.width / camera.K[0, 0], camera.height / camera.K[1, 1])

        def torn_by_ratio(a: Array, b: Array) -> Array:
            high, low = np.fmax(a, b).astype(np.float64), np.fmin(a, b).astype(np.float64)
            too_far = high > cut_ratio * low if perspective else high - low > (cut_ratio - 1) * longer_side
            return too_far | ~np.isfinite(a - b)

        return Edges(*(torn_by_ratio(a, b) for a, b in _pairs(near)))
    fx, fy = view.camera.K[0, 0], view.camera.K[1, 1]
    across = _torn_along_rows(near, view, 1 / fx, beside=True)
    down = _torn_along_rows(near.T, view, 1 / fy, beside=True).T
    # Each row is shifted by one sample more than the row above, so that diagonals become columns.
    height, width = near.shape
    sheared = np.full((height, width + height), np.nan, np.float32)
    for y in range(height):
        sheared[y, y : y + width] = near[y]
    along = _torn_along_rows(sheared.T, view, np.hypot(1 / fx, 1 / fy), beside=False).T
    diagonal = np.ones(near.shape, bool)
    for y in range(height - 1):
        diagonal[y, : width - 1] = along[y, y + 1 : y + width]
    return Edges(across, down, diagonal)


def _pairs(near: Array) -> list[tuple[Array, Array]]:
    """Nearness at both ends of the three kinds of pairs; NaN outside the image."""
    right, below = _shifted(near, 1), _shifted(near.T, 1).T
    return [(near, right), (near, below), (right, below)]


def _shifted(image: Array, by: int) -> Array:
    """The image moved to the left by `by` columns; NaN where it has no values."""
    padded = np.pad(image, ((0, 0), (abs(by), abs(by))), constant_values=np.nan)
    return padded[:, abs(by) + by : abs(by) + by + image.shape[1]]


def _torn_along_rows(near: Array, view: DepthImage, per_pixel: float, beside: bool) -> Array:
    """(H, W) bool: samples that are torn from the next sample in their row.

    Two samples are one surface if the slope on one side of the pair predicts the rise between them, or if the rise is
    so small that the surface faces the camera. `beside`: the mean slope of three rows may predict it, too.
    """
    perspective = view.camera.projection == "perspective"
    change, high, low = _shifted(near, 1) - near, np.fmax(near, _shifted(near, 1)), np.fmin(near, _shifted(near, 1))
    a, b, c = (np.float32(DEVIATIONS * noise) for noise in view.noise)
    constant, linear, square = (a, b, c) if perspective else (c, -b, a)
    noise = constant + high * (linear + high * square)
    facing = np.float32(min(STEEPEST * per_pixel, STEEP_MAX) if perspective else STEEPEST * per_pixel)
    rise, sign = np.abs(change), np.where(change < 0, np.float32(-1), np.float32(1))
    goes_on = rise <= np.fmax(facing * (low if perspective else np.ones_like(low)), noise)
    before, after = (_slopes(change, sign, side) for side in (-1, 1))
    for (nearest, agreed), (other, _) in ((before, after), (after, before)):
        bends = np.isnan(other) | (STEEP * other >= rise - noise)
        slope = np.where(bends, nearest, agreed)
        goes_on |= _follows(rise, slope, np.where(bends, BEND, KEEP), noise)
    with np.errstate(invalid="ignore"):
        goes_on |= rise <= noise + SAME * np.nan_to_num(np.minimum(before[1], after[1]))
    if not beside:
        goes_on |= np.isnan(before[0]) & np.isnan(after[0])  # other edges of the cell decide
    else:
        for side in (-1, 1):
            rows = np.stack([_slopes(np.roll(change, row, 0), sign, side)[1] for row in (-1, 0, 1)])
            rows[0, -1] = rows[2, 0] = np.nan  # outside the image
            count = np.isfinite(rows).sum(axis=0)
            mean = np.nansum(rows, axis=0).astype(np.float32) / np.fmax(count, 1).astype(np.float32)
            goes_on |= (count > 0) & _follows(rise, mean, KEEP, noise)
    return ~(goes_on & np.isfinite(change))


def _slopes(change: Array, sign: Array, side: int) -> tuple[Array, Array]:
    """For each pair, two slopes on one of its sides: from the two nearest samples, and from the three nearest.

    A slope is positive if nearness changes there in the same direction as within the pair. The slope from three samples
    is the lesser of the nearest slope and the mean of two slopes, but at least 0.
    """
    one, two = sign * _shifted(change, side), sign * _shifted(change, 2 * side)
    mean = np.where(np.isfinite(two), np.float32(0.5) * (one + two), one)
    return one, np.where(np.isfinite(one), np.fmax(np.fmin(one, mean), np.float32(0)), np.float32(np.nan))


def _follows(rise: Array, slope: Array, growth: Any, noise: Array) -> Array:
    """Tell whether a rise continues a slope; it may exceed the slope by the fraction `growth`."""
    with np.errstate(invalid="ignore"):
        sure = np.fmax(slope - noise, 0)
        return (rise <= slope + noise + growth * sure) & (rise >= LEAST * sure)


def with_ring(view: DepthImage, edges: Edges) -> tuple[Array, Edges]:
    """Nearness (H + 2, W + 2), float64, with a ring of extrapolated samples around the image, and its edges.

    A ring sample lies on the line through the border sample and the next sample inside, if both are one surface.
    """
    near = nearness_of(view)
    height, width = near.shape

    def slopes(values: Array, torn: Array) -> tuple[Array, Array]:
        """Differences of the first column from the second, and of the last from the last but one; 0 where torn."""
        if values.shape[1] == 1:
            return np.zeros(len(values)), np.zeros(len(values))
        first, last = values[:, 0] - values[:, 1], values[:, -1] - values[:, -2]
        return np.where(torn[:, 0], 0, first), np.where(torn[:, -2], 0, last)

    left, right = slopes(near, edges.right)
    top, bottom = slopes(near.T, edges.below.T)
    grown = np.pad(near, 1, mode="edge")
    grown[1:-1, 0] += left
    grown[1:-1, -1] += right
    grown[0, 1:-1] += top
    grown[-1, 1:-1] += bottom
    for row, beside in ((0, top), (-1, bottom)):
        grown[row, 0] += left[row] + beside[0]
        grown[row, -1] += right[row] + beside[-1]
    border = np.pad(near, 1, mode="edge")
    least, most = LEAST_BEYOND * border, 2 * border
    grown = np.clip(grown, np.minimum(least, most), np.maximum(least, most))
    grown[1:-1, 1:-1] = near

    torn_right, torn_below, torn_diagonal = (np.ones((height + 2, width + 2), bool) for _ in range(3))
    torn_right[1:-1, 1:-1], torn_below[1:-1, 1:-1], torn_diagonal[1:-1, 1:-1] = edges.right, edges.below, edges.diagonal
    # No border sample is torn from the ring; neighbours in the ring are torn if the border samples beside them are.
    torn_right[1:-1, 0] = torn_right[1:-1, -2] = torn_below[0, 1:-1] = torn_below[-2, 1:-1] = False
    torn_below[1:-1, 0], torn_below[1:-1, -1] = torn_below[1:-1, 1], torn_below[1:-1, -2]
    torn_right[0, 1:-1], torn_right[-1, 1:-1] = torn_right[1, 1:-1], torn_right[-2, 1:-1]
    torn_right[[0, 0, -1, -1], [0, -2, 0, -2]] = torn_below[[0, 0, -2, -2], [0, -1, 0, -1]] = False
    torn_diagonal[1:-1, 0], torn_diagonal[1:-1, -2] = torn_below[1:-1, 0], torn_below[1:-1, -2]
    torn_diagonal[0, 1:-1], torn_diagonal[-2, 1:-1] = torn_right[0, 1:-1], torn_right[-2, 1:-1]
    torn_diagonal[[0, 0, -2, -2], [0, -2, 0, -2]] = False
    missing = np.isnan(grown)
    missing[1:-1, 1:-1] = False  # edges between samples of the image are known
    torn_right[missing] = torn_below[missing] = torn_diagonal[missing] = True
    return grown, Edges(torn_right, torn_below, torn_diagonal)


def whole_triangles(torn: Edges) -> Array:
    """(H - 1, W - 1, 2) bool: whether each cell's two triangles have no torn edge."""
    lower = torn.right[:-1, :-1] | torn.below[:-1, :-1] | torn.diagonal[:-1, :-1]
    upper = torn.right[1:, :-1] | torn.below[:-1, 1:] | torn.diagonal[:-1, :-1]
    return ~np.stack([lower, upper], axis=-1)


def triangles_beyond_border(view: DepthImage, torn: Edges) -> tuple[Array, Array, Array, Array]:
    """Triangles between the outermost samples and the image's border, which is half a pixel farther out.

    They are the triangles between border samples and ring samples, clipped at the border. Ring samples have the colours
    of the border samples. Returns pixels (n, 2), nearness (n,), colours (n, c) and faces (m, 3).
    """
    height, width = view.depth.shape
    near, ring_torn = with_ring(view, torn)
    colors = np.pad(view.color, ((1, 1), (1, 1), (0, 0)), mode="edge").astype(np.float64)
    whole = whole_triangles(ring_torn)
    whole[1:height, 1:width] = False  # leave out the triangles between samples of the image
    corners, faces = list[Array](), list[Array]()
    for row, column, part in np.argwhere(whole):
        three = [(1, 1), (0, 1), (1, 0)] if part else [(0, 0), (1, 0), (0, 1)]
        at = [(column + i, row + j) for i, j in three]
        polygon = [np.array([x - 1, y - 1, near[y, x], *colors[y, x]]) for x, y in at]
        for axis, low, sign in ((0, -0.5, 1), (0, width - 0.5, -1), (1, -0.5, 1), (1, height - 0.5, -1)):
            polygon = _clipped(polygon, axis, low, sign)
        first = len(corners)
        corners += polygon
        faces += [np.array([first, first + i, first + i + 1]) for i in range(1, len(polygon) - 1)]
    all_corners = np.array(corners).reshape(-1, 3 + colors.shape[2])
    return all_corners[:, :2], all_corners[:, 2], all_corners[:, 3:], np.array(faces, np.int64).reshape(-1, 3)


def _clipped(polygon: list[Array], axis: int, at: float, sign: int) -> list[Array]:
    """Part of a convex polygon where sign * (corner[axis] - at) >= 0."""
    kept = list[Array]()
    for i, one in enumerate(polygon):
        other = polygon[(i + 1) % len(polygon)]
        a, b = sign * (one[axis] - at), sign * (other[axis] - at)
        if a >= 0:
            kept.append(one)
        if (a > 0 > b) or (a < 0 < b):
            kept.append(one + a / (a - b) * (other - one))
    return kept
