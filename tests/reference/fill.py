"""Holes filled by push and pull, in NumPy float64, on whole images, one resolution level after another."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.truth import dilate

Array = NDArray[Any]

TILE, HALO, BESIDE = 16, 4, 1
LEAST, FAINT, RIM = 1e-6, 1e-3, 0.2
NARROW, WIDE, OUTWARD, FLAT, SLOPING = 0.02, 0.035, 8, 0.05, 0.15
STEEPEST, FAINTEST, ADDING = 64, 0.3, 32
UNDECIDED = 1e-4  # pixels: points closer than this to the middle between two pixels may round to either


@dataclass
class Behind:
    """Surface behind each hole pixel, found along its epipolar line."""

    depth: Array  #: (H, W) float64, 0 where no line gives a depth or there is no hole
    falloff: Array  #: (H, W) float64; a pixel nearer than `depth` by d is foreground by falloff * d
    decided: Array  #: (H, W) bool: rounding cannot change the pixels that the line passes


def behind_reference(
    depth: Array,
    valid: Array,
    epipole: tuple[float, float, float],
    perspective: bool = True,
    same: tuple[float, float, float] = (0.0, 0.015, 0.0),
) -> Behind:
    """Follow a line from each hole pixel both ways, to the first valid pixels: the farther depth is behind the hole.

    The lines run away from the epipole and towards it, in steps of one pixel along the longer axis. The falloff says
    how much the nearer end counts as foreground.

    epipole: homogeneous, (x, y, w); if all three are 0, the lines are rows. same: (a, b, c); pixels of one surface may
    differ in depth by a z^2 + b z + c at depth z.
    """
    y, x = holes = np.nonzero(~valid)
    at = np.stack([x, y], axis=-1).astype(float)
    away = at * epipole[2] - epipole[:2]
    longest = np.abs(away).max(axis=-1, initial=0.0, keepdims=True)
    away = np.where(longest > 0, away / np.where(longest > 0, longest, 1.0), (1.0, 0.0))
    a, b = _End(valid, at, away), _End(valid, at, -away)
    at_epipole = (longest[:, 0] == 0) & any(epipole)  # there, rounding decides the direction
    length = a.steps + b.steps
    out = np.maximum(length // OUTWARD, 1)
    ends = [end.values(depth) for end in (a, b)]
    beyond = [end.beyond(depth, valid, out) for end in (a, b)]
    near, far = np.minimum(*ends), np.maximum(*ends)
    both, gap = near > 0, far - near
    with np.errstate(divide="ignore", invalid="ignore"):
        differ = _rising(1, 2, gap / np.polyval(same, far))
        narrow = 1 - _rising(NARROW, WIDE, length * np.hypot(*away.T) / max(valid.shape))
        n, outer = ([1 / z if perspective else -z for z in each] for each in (ends, beyond))
        change = (abs(n[0] - outer[0]) + abs(n[1] - outer[1])) * length / out / abs(n[0] - n[1])
        flat = np.where((beyond[0] > 0) & (beyond[1] > 0), 1 - _rising(FLAT, SLOPING, change), 0.0)
        falloff = differ * np.maximum(narrow, flat) / gap
    told = Behind(np.zeros(valid.shape), np.zeros(valid.shape), np.ones(valid.shape, bool))
    told.depth[holes] = far
    told.falloff[holes] = np.where(both & (differ > 0), falloff, 0.0)
    told.decided[holes] = a.decided & b.decided & ~at_epipole
    return told


def _rising(start: float, end: float, values: Array) -> Array:
    """Smooth step: 0 up to `start`, 1 from `end` on."""
    part = np.clip((values - start) / (end - start), 0, 1)
    return part**2 * (3 - 2 * part)


class _End:
    """First valid pixels on lines that start at given places and advance by given steps."""

    def __init__(self, valid: Array, at: Array, step: Array) -> None:
        height, width = valid.shape
        count = len(at)
        self.at, self.step = at, step
        self.found, self.decided = np.zeros(count, bool), np.ones(count, bool)
        self.pixels, self.steps = np.zeros((count, 2), int), np.zeros(count, int)
        walking = np.arange(count)
        for number in range(1, max(width, height) + 1):
            place = at[walking] + number * step[walking]
            pixel = np.rint(place).astype(int)
            self.decided[walking] &= _is_decided(place)
            inside = ((pixel >= 0) & (pixel < (width, height))).all(axis=-1)
            walking, pixel = walking[inside], pixel[inside]
            there = valid[pixel[:, 1], pixel[:, 0]]
            ends = walking[there]
            self.found[ends], self.pixels[ends], self.steps[ends] = True, pixel[there], number
            walking = walking[~there]

    def values(self, image: Array) -> Array:
        """Values of the image at the ends; 0 where there is no end."""
        return np.where(self.found, image[self.pixels[:, 1], self.pixels[:, 0]], 0.0)

    def beyond(self, depth: Array, valid: Array, steps: Array) -> Array:
        """Depths at the pixels `steps` steps beyond the ends; 0 where such a pixel is not valid."""
        height, width = valid.shape
        place = self.at + (self.steps + steps)[:, None] * self.step
        self.decided &= _is_decided(place)
        x, y = np.rint(place).astype(int).T
        inside = (x >= 0) & (y >= 0) & (x < width) & (y < height)
        x, y = np.where(inside, x, 0), np.where(inside, y, 0)
        return np.where(inside & valid[y, x], depth[y, x], 0.0)


def _is_decided(places: Array) -> Array:
    """(N,) bool: places that are not half-way between two pixels."""
    return (np.abs(places - np.floor(places) - 0.5) > UNDECIDED).all(axis=-1)


def fill_reference(color: Array, depth: Array, valid: Array, behind: Array | None, perspective: bool) -> Array:
    """Return colour and depth together, (H, W, 4), with holes filled.

    `behind`: (2, H, W), depth behind the holes and falloff, from which pixels get weights; None: equal weights.
    """
    values = np.concatenate([color, depth[..., None]], axis=-1).astype(float)
    counts = dilate(~valid, BESIDE) & valid
    weights = counts.astype(float)
    if behind is not None:
        behind = np.where(edges_of(valid), behind, 0.0)
        farthest = _farthest(~valid, behind[0])[counts]
        ratio = np.where(farthest > 0, np.minimum(depth[counts] / np.where(farthest > 0, farthest, 1), 1), 1)
        touching, falloff = (_beside(np.where(behind[1] > 0, each, 0.0))[counts] for each in behind)
        foreground = np.clip(falloff * (touching - depth[counts]), 0, 1)
        weights[counts] = np.maximum(((1 + FAINT) * ratio**12 - FAINT) * (1 - foreground), LEAST)
    nearness = values.copy()
    if perspective:
        nearness[..., 3] = 1 / values[..., 3]
    base = np.where(counts[..., None], nearness, 0.0) * weights[..., None]
    told = None if behind is None else perspective
    filled = _pulled(np.concatenate([base, weights[..., None]], axis=-1), told, 1)
    if perspective:
        filled[..., 3] = 1 / filled[..., 3]
    if behind is not None:
        _mix_rims(filled, values, valid, behind)
    return np.where(valid[..., None], values, filled)


def _mix_rims(filled: Array, values: Array, valid: Array, behind: Array) -> None:
    """Mix the mean colour of foreground pixels among the four neighbours into each hole pixel at a silhouette."""
    total, parts, most = np.zeros((*valid.shape, 3)), np.zeros(valid.shape), np.zeros(valid.shape)
    padded, seen = np.pad(values, ((1, 1), (1, 1), (0, 0))), np.pad(valid, 1)
    height, width = valid.shape
    for y, x in ((0, 1), (2, 1), (1, 0), (1, 2)):
        beside, is_seen = padded[y : y + height, x : x + width], seen[y : y + height, x : x + width]
        part = np.where(is_seen, np.clip(behind[1] * (behind[0] - beside[..., 3]), 0, 1), 0.0)
        total += np.where(is_seen[..., None], part[..., None] * beside[..., :3], 0.0)
        parts, most = parts + part, np.maximum(most, part)
    rims = most > 0
    mixed = total[rims] / parts[rims, None] - filled[rims, :3]
    filled[rims, :3] += RIM * most[rims, None] * mixed


def edges_of(valid: Array) -> Array:
    """(H, W) bool: hole pixels beside valid pixels, also diagonally, or at the image's border."""
    return ~valid & dilate(np.pad(valid, 1, constant_values=True), 1)[1:-1, 1:-1]


def _beside(image: Array) -> Array:
    """(H, W) maximum over 3 x 3 pixels."""
    height, width = image.shape
    padded = np.pad(image, 1)
    return np.max([padded[v : v + height, u : u + width] for v in range(3) for u in range(3)], axis=0)


def _farthest(holes: Array, behind: Array) -> Array:
    """(H, W) farthest depth behind holes; each block of 4 x 4 pixels gets that of the 12 x 12 pixels around it.

    Only hole pixels beside valid pixels count, as far as both are within a tile's window of `TILE` + 2 `HALO` pixels.
    """
    height, width = holes.shape
    down, across = -(-height // TILE) * TILE, -(-width // TILE) * TILE
    more = ((HALO, HALO + down - height), (HALO, HALO + across - width))
    holes, behind = np.pad(holes, more), np.pad(behind, more)
    found = np.zeros((down, across))
    for y in range(0, down, TILE):
        for x in range(0, across, TILE):
            window = np.s_[y : y + TILE + 2 * HALO, x : x + TILE + 2 * HALO]
            edges = holes[window] & dilate(~holes[window], 1)
            blocks = np.where(edges, behind[window], 0.0).reshape(6, 4, 6, 4).max(axis=(1, 3))
            most = np.max([blocks[v : v + 4, u : u + 4] for v in range(3) for u in range(3)], axis=0)
            found[y : y + TILE, x : x + TILE] = np.repeat(np.repeat(most, 4, axis=0), 4, axis=1)
    return found[:height, :width]


def _pushed(cells: Array, told: bool | None, side: int) -> Array:
    """Merge each four cells into one, (H / 2, W / 2, 5); cells nearer than the farthest of the four count less.

    `told`: whether the picture is perspective; None: all cells count equally.
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
    """Fill cells from coarser levels. Cells (H, W, 5) hold weighted values and weights, and are `side` pixels wide.

    Returns values (H, W, 4).
    """
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
