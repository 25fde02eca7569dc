"""Holes filled by push and pull, in NumPy float64: whole images at once, level by level."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

TILE, HALO, BESIDE = 16, 4, 1
LEAST, FAINT = 1e-6, 1e-3
STEEPEST, FAINTEST, ADDING = 64, 0.3, 32
UNDECIDED = 1e-4  # pixels: rounding may take what lies that close to the middle between two pixels for either


@dataclass
class Behind:
    """Surface behind holes."""

    depth: Array  #: (H, W) float64, 0 where no line tells or there is no hole
    decided: Array  #: (H, W) bool: which pixels the line passes does not hang on rounding


def behind_reference(depth: Array, valid: Array, epipole: tuple[float, float, float]) -> Behind:
    """The farther depth at the ends of each hole's line, which leads away from the epipole, and back to it, in steps of
    a pixel along its longer axis.

    Parameters
    ----------
    depth : (H, W)
    valid : (H, W) bool
    epipole : (x, y, w)
        Homogeneous; all 0: the lines are the rows.
    """
    y, x = holes = np.nonzero(~valid)
    at = np.stack([x, y], axis=-1).astype(float)
    away = at * epipole[2] - epipole[:2]
    longest = np.abs(away).max(axis=-1, initial=0.0, keepdims=True)
    away = np.where(longest > 0, away / np.where(longest > 0, longest, 1.0), (1.0, 0.0))
    a, b = _End(valid, at, away), _End(valid, at, -away)
    at_epipole = (longest[:, 0] == 0) & any(epipole)  # there, rounding decides on the direction
    told = Behind(np.zeros(valid.shape), np.ones(valid.shape, bool))
    told.depth[holes] = np.maximum(a.values(depth), b.values(depth))
    told.decided[holes] = a.decided & b.decided & ~at_epipole
    return told


class _End:
    """The first valid pixels from places on."""

    def __init__(self, valid: Array, at: Array, step: Array) -> None:
        height, width = valid.shape
        count = len(at)
        self.found, self.decided = np.zeros(count, bool), np.ones(count, bool)
        self.pixels = np.zeros((count, 2), int)
        walking = np.arange(count)
        for number in range(1, max(width, height) + 1):
            place = at[walking] + number * step[walking]
            pixel = np.rint(place).astype(int)
            self.decided[walking] &= (np.abs(place - np.floor(place) - 0.5) > UNDECIDED).all(axis=-1)
            inside = ((pixel >= 0) & (pixel < (width, height))).all(axis=-1)
            walking, pixel = walking[inside], pixel[inside]
            there = valid[pixel[:, 1], pixel[:, 0]]
            ends = walking[there]
            self.found[ends], self.pixels[ends] = True, pixel[there]
            walking = walking[~there]

    def values(self, image: Array) -> Array:
        """Values of the image there; 0 where there is no end."""
        return np.where(self.found, image[self.pixels[:, 1], self.pixels[:, 0]], 0.0)


def fill_reference(color: Array, depth: Array, valid: Array, behind: Array | None, perspective: bool) -> Array:
    """(H, W, 4): colour and depth with holes filled; `behind` (H, W) tells what pixels count, None: all alike."""
    values = np.concatenate([color, depth[..., None]], axis=-1).astype(float)
    counts = _around(~valid, BESIDE) & valid
    weights = counts.astype(float)
    if behind is not None:
        farthest = _farthest(~valid, behind)[counts]
        ratio = np.where(farthest > 0, np.minimum(depth[counts] / np.where(farthest > 0, farthest, 1), 1), 1)
        weights[counts] = np.maximum((1 + FAINT) * ratio**12 - FAINT, LEAST)
    nearness = values.copy()
    if perspective:
        nearness[..., 3] = 1 / values[..., 3]
    base = np.where(counts[..., None], nearness, 0.0) * weights[..., None]
    told = None if behind is None else perspective
    filled = _pulled(np.concatenate([base, weights[..., None]], axis=-1), told, 1)
    if perspective:
        filled[..., 3] = 1 / filled[..., 3]
    return np.where(valid[..., None], values, filled)


def edges_of(valid: Array) -> Array:
    """(H, W) bool: holes beside valid pixels, or at the border."""
    return ~valid & _around(np.pad(valid, 1, constant_values=True), 1)[1:-1, 1:-1]


def _around(mask: Array, reach: int) -> Array:
    """Pixels within `reach` of the mask, diagonally, too."""
    height, width = mask.shape
    padded, found = np.pad(mask, reach), np.zeros_like(mask)
    for y in range(2 * reach + 1):
        for x in range(2 * reach + 1):
            found |= padded[y : y + height, x : x + width]
    return found


def _farthest(holes: Array, behind: Array) -> Array:
    """(H, W): the farthest depth behind holes in the 12 x 12 pixels around each 4 x 4; of those beside what is no hole,
    as far as a tile's window shows.
    """
    height, width = holes.shape
    down, across = -(-height // TILE) * TILE, -(-width // TILE) * TILE
    more = ((HALO, HALO + down - height), (HALO, HALO + across - width))
    holes, behind = np.pad(holes, more), np.pad(behind, more)
    found = np.zeros((down, across))
    for y in range(0, down, TILE):
        for x in range(0, across, TILE):
            window = np.s_[y : y + TILE + 2 * HALO, x : x + TILE + 2 * HALO]
            edges = holes[window] & _around(~holes[window], 1)
            blocks = np.where(edges, behind[window], 0.0).reshape(6, 4, 6, 4).max(axis=(1, 3))
            most = np.max([blocks[v : v + 4, u : u + 4] for v in range(3) for u in range(3)], axis=0)
            found[y : y + TILE, x : x + TILE] = np.repeat(np.repeat(most, 4, axis=0), 4, axis=1)
    return found[:height, :width]


def _pushed(cells: Array, told: bool | None, side: int) -> Array:
    """(H / 2, W / 2, 5): of four cells each counts by how much nearer it is than the farthest.

    told: whether the picture is a perspective one; None: all count alike.
    """
    four = np.stack([cells[y::2, x::2] for y in (0, 1) for x in (0, 1)])
    weights = four[..., 4]
    if told is not None:
        nearness = four[..., 3]
        with np.errstate(invalid="ignore", divide="ignore"):
            depth = np.where(weights > 0, weights / nearness if told else nearness / weights, 0.0)
        farthest = depth.max(axis=0)
        ratio = depth / np.where(farthest > 0, farthest, 1.0)
        four = four * np.maximum(ratio[..., None] ** min(16 * side, STEEPEST), FAINTEST)
    sums, most = four.sum(axis=0), weights.max(axis=0)
    limit = np.minimum(np.maximum(most, ADDING * most**2), 1.0)
    return sums * np.where(sums[..., 4] > limit, limit / np.maximum(sums[..., 4], limit), 1.0)[..., None]


def _pulled(base: Array, told: bool | None, side: int) -> Array:
    """(H, W, 4): cells (H, W, 5), `side` pixels wide, values times weights and weights, filled from storeys above."""
    height, width = base.shape[:2]
    levels = [np.pad(base, ((0, -height % TILE), (0, -width % TILE), (0, 0)))]
    for number in range(4):
        levels.append(_pushed(levels[-1], told, side * 2**number))
    top = levels.pop()
    filled = top[..., :4] / top[..., 4:] if top.shape[:2] == (1, 1) else _pulled(top, told, side * TILE)
    above = np.pad(filled, ((1, 1), (1, 1), (0, 0)), mode="edge")
    for level in reversed(levels):
        own = np.pad(level, ((1, 1), (1, 1), (0, 0)))
        for axis, size in enumerate(own.shape[:2]):
            cell = np.arange(size)
            part = np.where(cell % 2, 0.75, 0.25).reshape([-1 if i == axis else 1 for i in range(3)])
            left, right = np.take(above, cell // 2, axis), np.take(above, cell // 2 + 1, axis)
            above = left + part * (right - left)
        above = own[..., :4] + (1 - own[..., 4:]) * above
    return above[1 : height + 1, 1 : width + 1]
