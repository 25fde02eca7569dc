"""Cells of depth images, each between four samples: how near a surface may lie there (kernels/slicing/view_volumes.h).

Rays know the surface where they meet it. Between them it is bilinear, but what sticks out there no image shows, and of
many images each would cut off a part of it. So creases reach to where the surfaces of both sides meet, and beside depth
edges a surface goes on as it rose before.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.images import DepthImage
from pyibr.opencl.headers import constant

Float32 = NDArray[np.float32]
Mask = NDArray[np.bool_]

_EDGE = np.float32(3)  # samples' distances: neighbours that differ by more in depth are of two surfaces
_RISE_MAX = np.float32(1)  # samples' distances by which a surface is nearer than its samples tell
_NOTHING = np.float32(1 / 64)  # samples' distances that make no difference
_ROUND = np.float32(0.375)  # of the bend beside a crease, which is then a part of something round


def with_cells(view: DepthImage, nearness: Float32, empty: Mask) -> Float32:
    """(2, H, W) of a view: nearness, with bits that tell what cells are, and the cells, each at its first sample.

    Parameters
    ----------
    view : DepthImage
    nearness : (H, W) float32
        Of its samples: `pyibr.slicing.boxes.nearness_map`.
    empty : (H, W) bool
        Where it saw that there is nothing.
    """
    beyond = (0, 1), (0, 1)
    n = np.pad(nearness, beyond, mode="edge")
    solid, background = np.pad(view.valid, beyond, mode="edge"), np.pad(empty, beyond, mode="edge")
    sample = _sample_of(view, n)
    right, left, crease_x = _along_rows(n, solid, sample)
    down, up, crease_y = (part.T for part in _along_rows(n.T, solid.T, sample.T))
    # Corners row by row, and how steeply the surface rises from each into the cell.
    first, last = slice(None, -1), slice(1, None)
    corners = (first, first), (first, last), (last, first), (last, last)
    values = [n[at] for at in corners]
    rises = (
        right[first] + down[:, first],
        left[first] + down[:, last],
        right[last] + up[:, first],
        left[last] + up[:, last],
    )
    nearest, farthest = np.maximum.reduce(values), np.minimum.reduce(values)
    sample = _sample_of(view, nearest)
    beside_empty = np.logical_or.reduce([background[at] for at in corners])
    whole = np.logical_and.reduce([solid[at] for at in corners]) & (nearest - farthest <= _EDGE * sample)
    part, ceiling = np.zeros(nearness.shape, np.int32), np.full(nearness.shape, -np.inf, np.float32)
    for k, at in enumerate(corners):
        of_part = np.where(beside_empty, ~background[at], values[k] >= nearest - _EDGE * sample)
        reach = values[k] + np.minimum(rises[k], _RISE_MAX * sample)
        ceiling = np.where(of_part, np.maximum(ceiling, reach), ceiling)
        part |= of_part.astype(np.int32) << k
    crease = np.maximum(crease_x[first], crease_x[last]) + np.maximum(crease_y[:, first], crease_y[:, last])
    crease = np.where(crease < _NOTHING * sample, 0, np.minimum(crease, _RISE_MAX * sample))
    flat, nothing = whole & (crease == 0), part == 0
    part = np.where(whole, _bits("CELL_WHOLE"), part) | np.where(beside_empty, _bits("CELL_BACKGROUND"), 0)
    cells = np.where(whole, crease, np.where(nothing, 0, ceiling - values[0]))
    other = np.where(beside_empty, _bits("OUTLINE_CELL"), _bits("OTHER_CELL"))
    kinds = np.where(nothing, _bits("EMPTY_CELL"), np.where(flat, 0, other))
    return np.stack(
        [
            _with_bits(nearness, kinds, _bits("OUTLINE_CELL")),
            _with_bits(cells, part, _bits("CELL_BITS")),
        ]
    )


def reach_of(view: DepthImage) -> float:
    """The nearness by which the surface of a view may be nearer than the nearest of four samples."""
    nearest = 1 / float(view.depth[view.valid].min()) if view.camera.projection == "perspective" else 0.0
    return 1.001 * float(_RISE_MAX * _sample_of(view, np.full(1, nearest, np.float32))[0])


def _bits(name: str) -> int:
    return int(constant("slicing/view_volumes.h", name))


def _with_bits(image: Float32, bits: NDArray[Any], places: int) -> Float32:
    """Float32 with others as its last bits."""
    return ((image.astype(np.float32).view(np.int32) & ~places) | bits).astype(np.int32).view(np.float32)


def _sample_of(view: DepthImage, nearness: Float32) -> Float32:
    """The change of nearness over as much in depth as neighbouring samples lie apart."""
    focal = np.float32(min(view.camera.K[0, 0], view.camera.K[1, 1]))
    return nearness / focal if view.camera.projection == "perspective" else np.full_like(nearness, 1 / focal)


def _along_rows(n: Float32, solid: Mask, sample: Float32) -> tuple[Float32, Float32, Float32]:
    """Of each pair of samples in a row: how much nearer the surface comes towards it from its left and from its right,
    and by how much a crease between the two is nearer than they tell, if there is one."""
    change = np.diff(n, axis=1)
    joined = solid[:, :-1] & solid[:, 1:] & (np.abs(change) <= _EDGE * sample[:, :-1])
    joined[:, -1] = False  # with the border, repeated
    change = np.where(joined, change, np.float32(0))
    before, has_before = np.roll(change, 1, axis=1), np.roll(joined, 1, axis=1)
    after, has_after = np.roll(change, -1, axis=1), np.roll(joined, -1, axis=1)
    before[:, :1], has_before[:, :1], after[:, -1:], has_after[:, -1:] = 0, False, 0, False
    # The bends at the two samples: planes through the samples on either side meet in between, so far above.
    bend_left, bend_right = np.maximum(before - change, 0), np.maximum(change - after, 0)
    left = np.where(has_before, bend_left, np.where(has_after, bend_right, 0))
    right = np.where(has_after, bend_right, left)
    height = left * right / np.maximum(left + right, np.float32(1e-30))
    # What is round bends as much beside them, and is an eighth of it above its chord, not a half.
    around = np.minimum(np.roll(left, 1, axis=1), np.roll(right, -1, axis=1))
    crease = np.where(joined, np.maximum(height - _ROUND * around, 0), 0)
    return np.maximum(before, 0), np.maximum(-after, 0), crease
