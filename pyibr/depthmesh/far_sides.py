"""Far sides of depth edges: surfaces extrapolated behind the near surfaces that occlude them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pyibr.core.checks import Float64
from pyibr.depthmesh.tree import Tree

_DEPTH_RATIO_MAX = 1.5  # largest ratio between the depths of a continued surface and of its edge, either way

Float32 = NDArray[np.float32]
Whole = NDArray[np.int64]


@dataclass(frozen=True)
class FarSides:
    """Depths behind a view's surface, each (H, W): the far sides of its depth edges, extrapolated."""

    depth: Float32  # of the continued surface, not less than the view's own
    hidden: NDArray[np.bool_]  # where `depth` lies behind the view's surface
    far: NDArray[np.bool_]  # surface samples on the far sides of edges; background is excluded: it has no colours

    def colored(self, words: NDArray[np.uint32]) -> NDArray[np.uint32]:
        """(H, W) RGBA words: spread from the edges where `hidden`, the given words of the view, (H, W), elsewhere."""
        if not self.far.any():
            return words
        shown = words.view(np.uint8).reshape(*words.shape, 4).astype(np.float32)
        spread = np.rint(_spread(self.far, shown, self.hidden)).astype(np.uint8).view(np.uint32)[..., 0]
        return np.where(self.hidden, spread, words)


def far_sides_of(tree: Tree, limit: Float32) -> FarSides:
    """Extrapolate the far sides of a view's edges; `limit`: the view's depths, infinite for background, 0 if unknown.

    Each sample continues the far side of the edge that is nearest in the image: it lies in the tangent plane of the
    surface there, or is background if the far side is background.
    """
    far = _far_sides(tree, limit)
    if not far.any():
        return FarSides(limit, far, far)
    number = np.arange(far.size).reshape(far.shape)
    behind = (limit > 0) & np.isfinite(limit)  # only surfaces occlude: other samples are empty or unknown
    origin = _nearest(np.where(far, number, -1), far.shape[1], behind)
    depth = _continued(tree, limit, origin, behind)
    hidden = (depth > limit) & (limit > 0)
    return FarSides(np.where(hidden, depth, limit), hidden, far & np.isfinite(limit))


def _far_sides(tree: Tree, limit: Float32) -> NDArray[np.bool_]:
    """Mask, (H, W) bool, of the samples on the far sides of depth edges, of surfaces or of background."""
    upper, lower = tree.drawn_cells()
    height, width = limit.shape
    parts = [np.s_[dy : height - 1 + dy, dx : width - 1 + dx] for dy in (0, 1) for dx in (0, 1)]
    corners: Float32 = np.stack([limit[part] for part in parts])
    drawn = upper & lower
    low, high = corners.min(axis=0), corners.max(axis=0)
    cut = ~drawn & (low > 0) & np.isfinite(low)
    half = np.float32(0.5)  # halves are added, as the sum may overflow
    twice = 2 * np.minimum(low, half * np.finfo(np.float32).max)
    middle = np.asarray(np.where(np.isinf(high), twice, half * low + half * high), np.float32)
    far, near, surface = (np.zeros(limit.shape, np.bool_) for _ in range(3))
    for part, corner in zip(parts, corners, strict=True):
        far[part] |= cut & (corner > middle)
        near[part] |= cut & (corner <= middle)
        surface[part] |= drawn
    return far & ~near & (surface | np.isinf(limit))


_NEIGHBOUR_WEIGHTS = (9, 3, 3, 1)  # bilinear weights, in sixteenths, of the elements that `_coarser` returns


def _nearest(origin: Whole, width: int, wanted: NDArray[np.bool_] | Literal[True] = True, step: int = 1) -> Whole:
    """Give each `wanted` element without an origin the origin of the approximately nearest element.

    Origins are sample indices y * width + x, or -1. An element is a block of `step` samples along its sides; levels are
    halved until every element of a level is known. The mask of wanted elements saves time on the finest level.
    """
    if (origin >= 0).all():
        return origin
    coarse = _nearest(np.max(_quarters(origin, -1), axis=0), width, step=2 * step)
    y, x = np.nonzero((origin < 0) & wanted)
    best, least = np.full(len(y), -1), np.full(len(y), np.inf)
    there_y, there_x = (part.astype(np.float64) for part in np.divmod(coarse, width))
    middle_x, middle_y = step * (x + 0.5), step * (y + 0.5)
    for place in _coarser(y, x, coarse.shape):
        off = (there_x.take(place) - middle_x) ** 2 + (there_y.take(place) - middle_y) ** 2
        best, least = np.where(off < least, coarse.take(place), best), np.minimum(off, least)
    found = origin.copy()
    found[y, x] = best
    return found


def _spread(known: NDArray[np.bool_], color: Float32, wanted: NDArray[np.bool_] | Literal[True] = True) -> Float32:
    """Fill the colours (h, w, k) of wanted, unknown elements with a blend of known colours (pull and push)."""
    if known.all():
        return color
    have = _quarters(known, False).astype(np.float32)[..., None]
    count = have.sum(axis=0)
    known_there = count[..., 0] > 0
    coarse = _spread(known_there, (_quarters(color, 0) * have).sum(axis=0) / np.maximum(count, 1))
    coarse = coarse.reshape(-1, color.shape[2])
    y, x = np.nonzero(~known & wanted)
    blend = np.zeros((len(y), color.shape[2]), np.float32)
    for place, share in zip(_coarser(y, x, known_there.shape), _NEIGHBOUR_WEIGHTS, strict=True):
        blend += np.float32(share / 16) * coarse.take(place, axis=0)
    found = color.copy()
    found[y, x] = blend
    return found


def _quarters(values: NDArray[Any], beyond: float) -> NDArray[Any]:
    """(4, h / 2, w / 2, ...) the four elements under each element of the next coarser level."""
    pad = [(0, values.shape[0] % 2), (0, values.shape[1] % 2), *[(0, 0)] * (values.ndim - 2)]
    padded = np.pad(values, pad, constant_values=beyond)
    return np.stack([padded[dy::2, dx::2] for dy in (0, 1) for dx in (0, 1)])


def _coarser(y: Whole, x: Whole, shape: tuple[int, ...]) -> list[Whole]:
    """Indices of the four elements of the next coarser level, (h, w, ...), around each centre, its own block first."""
    rows, columns = (
        (at // 2, np.clip(at // 2 + 2 * (at % 2) - 1, 0, count - 1)) for at, count in zip((y, x), shape, strict=False)
    )
    return [row * shape[1] + column for row in rows for column in columns]


def _continued(tree: Tree, limit: Float32, origin: Whole, wanted: NDArray[np.bool_]) -> Float32:
    """(H, W) depths at which the rays of `wanted` samples meet the tangent planes of their samples `origin`."""
    camera = tree.view.camera
    rows, columns = np.nonzero(wanted)
    y, x = np.divmod(origin[wanted], limit.shape[1])
    depth, normal = limit[y, x].astype(np.float64), tree.sample_normals()[y, x].astype(np.float64)

    def ray(x: Whole, y: Whole) -> Float64:
        rows = np.linalg.inv(camera.K)  # term by term: products of small matrices are slow
        return np.stack([a * x + b * y + c for a, b, c in rows], axis=-1)

    here, there = ray(columns, rows), ray(x, y)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        if camera.projection == "perspective":
            found = depth * np.sum(normal * there, axis=-1) / np.sum(normal * here, axis=-1)
            steep = ~(found > 0)
            low, high = depth / _DEPTH_RATIO_MAX, depth * _DEPTH_RATIO_MAX
        else:
            found = depth - np.sum(normal[..., :2] * (here - there)[..., :2], axis=-1) / normal[..., 2]
            steep = ~np.isfinite(found)
            span = (_DEPTH_RATIO_MAX - 1) * float(np.ptp(tree.view.depth[tree.view.valid]))
            low, high = depth - span, depth + span
        found = np.where(steep, depth, np.clip(found, low, high))
    result = limit.copy()
    result[wanted] = np.where(np.isinf(depth), np.inf, found)
    return result
