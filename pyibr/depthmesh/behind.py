"""What goes on behind depth edges: the surfaces on their far sides, hidden by those on their near sides."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pyibr.core.checks import Float64
from pyibr.depthmesh.tree import Tree
from pyibr.images.depth_image import DepthImage

_STEEPEST = 1.5  # times the depth of its edge, that what goes on behind one may be nearer or farther

Float32 = NDArray[np.float32]
Whole = NDArray[np.int64]


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


def behind_of(mesh: ViewMesh, limit: Float32, words: NDArray[np.uint32]) -> tuple[Float32, NDArray[np.uint32]]:
    """How far a view may look behind its surface until it comes to what the far sides of its depth edges go on as.

    Each sample continues the edge that is nearest to it in the picture: in the plane of the surface on that edge's far
    side, or with nothing where that is background.

    Parameters
    ----------
    mesh : ViewMesh
    limit : (H, W) float32
        The view's depths, infinite for background and 0 where nothing is known.
    words : (H, W) uint32
        Its colours.

    Returns
    -------
    depth : (H, W) float32
        Not less than `limit`.
    words : (H, W) uint32
        The colours there, spread from the edges: the view's own where it does not look behind its surface.
    """
    far = _far_sides(mesh, limit)
    if not far.any():
        return limit, words
    number = np.arange(far.size).reshape(far.shape)
    shown = words.view(np.uint8).reshape(*words.shape, 4).astype(np.float32)
    origin, color = _spread(np.where(far, number, -1), shown, far.shape[1])
    depth = _continued(mesh, limit, origin)
    hidden = (depth > limit) & (limit > 0)
    spread = np.rint(color).astype(np.uint8).view(np.uint32)[..., 0]
    return np.where(hidden, depth, limit), np.where(hidden, spread, words)


def _far_sides(mesh: ViewMesh, limit: Float32) -> NDArray[np.bool_]:
    """(H, W) which samples are those of surfaces, or of background, on the far sides of depth edges."""
    upper, lower = mesh.tree.drawn_cells()
    height, width = limit.shape
    parts = [np.s_[dy : height - 1 + dy, dx : width - 1 + dx] for dy in (0, 1) for dx in (0, 1)]
    corners: Float32 = np.stack([limit[part] for part in parts])
    drawn = upper & lower
    low, high = corners.min(axis=0), corners.max(axis=0)
    cut = ~drawn & (low > 0) & np.isfinite(low)
    middle = np.asarray(np.where(np.isinf(high), 2 * low, 0.5 * (low + high)), np.float32)
    far, near, surface = (np.zeros(limit.shape, np.bool_) for _ in range(3))
    for part, corner in zip(parts, corners, strict=True):
        far[part] |= cut & (corner > middle)
        near[part] |= cut & (corner <= middle)
        surface[part] |= drawn
    return far & ~near & (surface | np.isinf(limit))


def _spread(origin: Whole, color: Float32, width: int, step: int = 1) -> tuple[Whole, Float32]:
    """Fill up what has no origin: with that of the nearest, nearly, and with a blend of colours from around.

    Parameters
    ----------
    origin : (h, w) int64
        Numbers of samples, y * width + x, or -1.
    color : (h, w, k) float32
        Theirs.
    width : int
        Samples in a row of the view.
    step : int
        Samples along the side of what an element stands for: levels are halved until all of one is known.
    """
    height, across = origin.shape
    known = origin >= 0
    if known.all():
        return origin, color
    padded = np.pad(origin, ((0, height % 2), (0, across % 2)), constant_values=-1)
    colors = np.pad(color, ((0, height % 2), (0, across % 2), (0, 0)))
    four = [np.s_[dy::2, dx::2] for dy in (0, 1) for dx in (0, 1)]
    have = np.stack([padded[part] >= 0 for part in four]).astype(np.float32)[..., None]
    mean = (np.stack([colors[part] for part in four]) * have).sum(axis=0) / np.maximum(have.sum(axis=0), 1)
    coarse, mean = _spread(np.max([padded[part] for part in four], axis=0), mean, width, 2 * step)
    y, x = np.nonzero(~known)
    best, least = np.full(len(y), -1), np.full(len(y), np.inf)
    blend = np.zeros((len(y), color.shape[2]), np.float32)
    for up, left, share in ((0, 0, 9), (0, 1, 3), (1, 0, 3), (1, 1, 1)):  # of bilinear interpolation, in sixteenths
        row = np.clip(y // 2 + up * (2 * (y % 2) - 1), 0, coarse.shape[0] - 1)
        column = np.clip(x // 2 + left * (2 * (x % 2) - 1), 0, coarse.shape[1] - 1)
        there = coarse[row, column]
        off = np.hypot(there % width - step * (x + 0.5), there // width - step * (y + 0.5))
        best, least = np.where(off < least, there, best), np.minimum(off, least)
        blend += np.float32(share / 16) * mean[row, column]
    origin, color = origin.copy(), color.copy()
    origin[y, x], color[y, x] = best, blend
    return origin, color


def _continued(mesh: ViewMesh, limit: Float32, origin: Whole) -> Float32:
    """(H, W) depths of the planes of surfaces at their samples `origin`, where other samples look."""
    camera = mesh.view.camera
    y, x = np.divmod(origin, limit.shape[1])
    depth, normal = limit[y, x].astype(np.float64), mesh.tree.sample_normals()[y, x].astype(np.float64)

    def ray(x: Whole, y: Whole) -> Float64:
        return np.asarray(np.stack([x, y, np.ones_like(x)], axis=-1) @ np.linalg.inv(camera.K).T)

    rows, columns = np.divmod(np.arange(limit.size).reshape(limit.shape), limit.shape[1])
    here, there = ray(columns, rows), ray(x, y)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        if camera.projection == "perspective":
            found = depth * np.sum(normal * there, axis=-1) / np.sum(normal * here, axis=-1)
            steep = ~(found > 0)
            low, high = depth / _STEEPEST, depth * _STEEPEST
        else:
            found = depth - np.sum(normal[..., :2] * (here - there)[..., :2], axis=-1) / normal[..., 2]
            steep = ~np.isfinite(found)
            span = (_STEEPEST - 1) * float(np.ptp(mesh.view.depth[mesh.view.valid]))
            low, high = depth - span, depth + span
        found = np.where(steep, depth, np.clip(found, low, high))
    return np.where(np.isinf(depth), np.inf, found).astype(np.float32)
