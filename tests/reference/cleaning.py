"""Depth cleaned step by step in NumPy, and by OpenCV: what the kernels of kernels/cleaning are to come near to.

Islands have values in sixteenths of the scale's 1, regions grow in the order of time, and weights are exponentials.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.cleaning import CleanedDepth
from pyibr.core.checks import Float64
from pyibr.core.optional import opencv
from pyibr.images.depth_image import Color, Depth
from pyibr.images.noise import DepthNoise

Mask = NDArray[np.bool_]
Float32 = NDArray[np.float32]

_RANGE = 3.3  # standard deviations of the noise, of the smoothing: what differs by ten is left apart
_RADIUS, _SPREAD = 5, 3.0  # pixels, of the smoothing
_REACH = 3  # pixels to either side over which a slope is found
_NOISE_MIN = 5e-4  # of the depth: what is less is none
_APART, _LEAST_APART = 5.0, 0.02  # deviations, and a share of depth: two surfaces are at least that far apart
_GAP = 2  # pixels: the next sample in a direction may be so far off
_UNLIKE = (0.03, 0.1, 0.3, np.inf)  # colours, their channels' differences added: holes grow together in that order
_ALIKE = 0.1  # colours of one surface, in the same measure
_SPECKLE = 40  # pixels: a smaller island amid other depths is no surface
_STEPS = 4096  # of the scale's table
_STEADY_WEIGHT = 0.9  # of what was known before, where it agrees


def clean_depth(
    depth: Depth,
    color: Color | None = None,
    *,
    before: Depth | None = None,
    holes: int = 8,
    strength: float = 1.0,
) -> CleanedDepth:
    """The same as `pyibr.clean_depth`, for arguments that are right."""
    cv2 = opencv("the reference of clean_depth", "bilateralFilter", "filterSpeckles", "morphologyEx")
    tint = None if color is None else _tint(color)
    known = None if before is None else _without_invalid(before)
    known = None if known is None or np.isnan(known).all() else known
    measured = _without_invalid(depth)
    valid = np.isfinite(measured)
    if not valid.any():
        return CleanedDepth(measured, valid)

    seen = [measured] if known is None else [measured, known]
    at = 1 / np.geomspace(max(map(np.nanmax, seen)), min(map(np.nanmin, seen)), 64)
    a, b, c = DepthNoise(measured, cells=20_000).deviation
    noise = a + (b + c * at) * at
    apart, alike = _Scale(seen, at, _APART * noise, _LEAST_APART), _Scale(seen, at, noise, _NOISE_MIN)
    kept = valid & ~_flying_pixels(apart.of(measured))
    seeds, sown = kept, measured
    if known is not None and holes > 0:
        still = _held_over(np.where(kept, apart.of(measured), np.float32(np.nan)), apart.of(known), tint)
        seeds, sown = kept | still, np.where(still, known, measured)
    area = _filled_area(cv2, seeds, holes)
    grown = _region_grown(cv2, sown, seeds, area, tint)
    speckle = _speckle(cv2, apart.of(grown))
    if known is not None:
        speckle &= ~_islands_with(cv2, speckle, kept & (np.abs(apart.of(measured) - apart.of(known)) < 1))
    if (speckle & seeds).any():
        kept, seeds = kept & ~speckle, seeds & ~speckle
        area &= ~speckle | _filled_area(cv2, seeds, holes)
        grown = _region_grown(cv2, sown, seeds, area, tint)
    if strength > 0 and np.isfinite(grown).any():
        values = _smoothed(cv2, alike.of(grown), strength)
        if known is not None:
            values = _temporally_filtered(values, alike.of(known), strength)
        grown = alike.depth_of(values)
    return CleanedDepth(grown, np.isfinite(grown) & ~kept)


def _without_invalid(depth: Depth) -> Depth:
    """Depth in which NaN alone is none."""
    return np.where((depth > 0) & np.isfinite(depth), depth, np.float32(np.nan))


class _Scale:
    """Nearness (1 / depth), stretched so that 1 is the same multiple of the noise at every depth.

    Parameters
    ----------
    depths : (H, W) float32
        Images whose range it covers; NaN where there is none.
    at, noise : (k,) float64
        Nearness, and what is to be 1 there.
    least : float
        It is that share of the nearness at least.
    """

    def __init__(self, depths: Sequence[Depth], at: Float64, noise: Float64, least: float) -> None:
        low, high = 1 / max(float(np.nanmax(d)) for d in depths), 1 / min(float(np.nanmin(d)) for d in depths)
        self._nearness = np.geomspace(low, max(high, low * 1.001), _STEPS)
        found = least * self._nearness
        if len(at):  # Nearer than what was looked at it grows with nearness: a stray sample must not stretch the scale.
            looked = np.interp(self._nearness, at, noise) * np.maximum(self._nearness / at[-1], 1)
            found = np.maximum(found, looked)
        self._values = np.append(0, np.cumsum(2 * np.diff(self._nearness) / (found[1:] + found[:-1])))

    def of(self, depth: Depth) -> Float32:
        """Depths on this scale."""
        return np.interp(1 / depth.astype(np.float64), self._nearness, self._values).astype(np.float32)

    def depth_of(self, values: Float32) -> Depth:
        """The inverse of `of`."""
        return (1 / np.interp(values, self._values, self._nearness)).astype(np.float32)


def _flying_pixels(values: Float32) -> Mask:
    """(H, W) samples between two surfaces, apart from both: an edge was seen there, half of each.

    Looked at along rows, columns and diagonals; the line through the next two samples on a side may lead there, too.
    """
    flies = np.zeros(values.shape, np.bool_)
    for dy, dx in ((0, 1), (1, 0), (1, 1), (1, -1)):
        first, first_line = _beside(values, dy, dx)
        last, last_line = _beside(values, -dy, -dx)
        low, high = np.fmin(first, last), np.fmax(first, last)
        between = (values - low > 1) & (high - values > 1)
        led_to = (np.abs(first_line - values) < 2) | (np.abs(last_line - values) < 2)
        flies |= between & ~led_to
    return flies


def _beside(values: Float32, dy: int, dx: int) -> tuple[Float32, Float32]:
    """(H, W) the next value in a direction, and what the next two, as a line, let expect here; NaN if unknown."""
    next_one, next_at = _first_known(values, dy, dx, np.zeros(values.shape, np.float32))
    after, after_at = _first_known(values, dy, dx, next_at)
    expected = next_one + (next_one - after) * next_at / (after_at - next_at)
    return next_one, expected.astype(np.float32, copy=False)


def _first_known(values: Float32, dy: int, dx: int, beyond: Float32) -> tuple[Float32, Float32]:
    """The first value within `_GAP` steps after `beyond` steps, and after how many; NaN if there is none."""
    height, width = values.shape
    most = 2 * _GAP
    padded = np.pad(values, most, constant_values=np.nan)
    found, at = np.full(values.shape, np.nan, np.float32), np.full(values.shape, np.nan, np.float32)
    for step in range(most, 0, -1):
        top, left = most + step * dy, most + step * dx
        other = padded[top : top + height, left : left + width]
        here = np.isfinite(other) & (step > beyond) & (step <= beyond + _GAP)
        found, at = np.where(here, other, found), np.where(here, np.float32(step), at)
    return found, at


def _held_over(values: Float32, known: Float32, tint: Float32 | None) -> Mask:
    """(H, W) where no value is, but known is one of a surface that is seen within `_GAP` pixels, of its colour."""
    height, width = values.shape
    y, x = np.nonzero(np.isnan(values) & np.isfinite(known))
    there = np.zeros(values.shape, np.bool_)
    for down, across in np.ndindex(2 * _GAP + 1, 2 * _GAP + 1):
        row, column = np.clip(y + down - _GAP, 0, height - 1), np.clip(x + across - _GAP, 0, width - 1)
        alike = np.abs(values[row, column] - known[y, x]) < 1
        if tint is not None:
            alike &= np.abs(tint[row, column] - tint[y, x]).sum(axis=1) < _ALIKE
        there[y, x] |= alike
    return there


def _filled_area(cv2: Any, kept: Mask, holes: int) -> Mask:
    """(H, W) where samples may be invented: what no disc of this radius without a sample covers."""
    if holes == 0:
        return kept
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * holes + 1, 2 * holes + 1))
    closed: NDArray[np.uint8] = cv2.morphologyEx(kept.astype(np.uint8), cv2.MORPH_CLOSE, disc)
    return closed.astype(np.bool_)


def _tint(color: Color) -> Float32:
    """Colours from 0 to 1."""
    return color.astype(np.float32) * np.float32(1 / 255 if color.dtype == np.uint8 else 1)


def _region_grown(cv2: Any, depth: Depth, kept: Mask, area: Mask, tint: Float32 | None) -> Depth:
    """Depth all over the area, from the kept samples outwards; NaN elsewhere.

    Where colours are alike first: fronts from two sides meet at an edge of the colour.
    """
    grown, there = np.where(kept, depth, np.float32(np.nan)), kept.copy()
    if tint is None:
        _grow(cv2, grown, there, area, np.zeros((*kept.shape, 1), np.float32), np.inf)
        return grown
    for most in _UNLIKE:
        _grow(cv2, grown, there, area, tint, most)
    return grown


def _grow(cv2: Any, grown: Depth, there: Mask, area: Mask, tint: Float32, most: float) -> None:
    """Samples get the depth of the neighbour that is most like them, as long as there are such pairs."""
    height, width = there.shape
    steps = [(dy, dx) for dy in (-1, 0, 1) for dx in (-1, 0, 1) if dy or dx]
    steps.sort(key=lambda step: abs(step[0]) + abs(step[1]))  # of equal ones the first
    changed = there
    while True:
        near: NDArray[np.uint8] = cv2.dilate(changed.astype(np.uint8), np.ones((3, 3), np.uint8))
        y, x = np.nonzero((near > 0) & ~there & area)
        least, best = np.full(len(y), np.inf), np.zeros(len(y), np.float32)
        for dy, dx in steps:
            row, column = np.clip(y + dy, 0, height - 1), np.clip(x + dx, 0, width - 1)
            unlike = np.where(there[row, column], np.abs(tint[row, column] - tint[y, x]).sum(axis=1), np.inf)
            better = unlike < least
            least[better], best[better] = unlike[better], grown[row, column][better]
        found = least <= most if most < np.inf else least < np.inf
        if not found.any():
            return
        y, x = y[found], x[found]
        grown[y, x], there[y, x] = best[found], True
        changed = np.zeros_like(there)
        changed[y, x] = True


def _speckle(cv2: Any, values: Float32) -> Mask:
    """(H, W) islands of so few samples, apart from what is around them, that no surface is known to be there."""
    there = np.isfinite(values)
    fine = min(16.0, (np.iinfo(np.int16).max - 2) / max(float(np.nanmax(values)), 1.0))
    steps = np.where(there, np.rint(np.nan_to_num(values) * fine) + 1, 0).astype(np.int16)
    cv2.filterSpeckles(steps, 0, min(_SPECKLE, np.count_nonzero(there) // 10), max(round(fine), 1))
    return there & (steps == 0)


def _islands_with(cv2: Any, islands: Mask, some: Mask) -> Mask:
    """(H, W) the islands that have some of these samples: a wire that broke is a surface if it was one before."""
    labels: NDArray[np.int32] = cv2.connectedComponents(islands.astype(np.uint8))[1]
    return islands & np.isin(labels, labels[islands & some])


def _smoothed(cv2: Any, values: Float32, strength: float) -> Float32:
    """A bilateral filter around each sample's own plane, over what is there.

    Without the planes, steep surfaces would differ from pixel to pixel by more than noise does, and keep theirs.
    """
    off = float(np.nanmax(values)) + 20 * _RANGE * strength  # so far that it does not count
    rough: Float32 = cv2.bilateralFilter(
        np.nan_to_num(values, nan=off), 2 * _RADIUS + 1, 2 * _RANGE * strength, _SPREAD
    )
    rough[np.isnan(values)] = np.nan
    across, down = (_slope(rough, axis) for axis in (1, 0))
    height, width = values.shape
    padded = np.pad(values, _RADIUS, constant_values=np.nan)
    total, weights = np.zeros(values.shape, np.float32), np.zeros(values.shape, np.float32)
    for y in range(-_RADIUS, _RADIUS + 1):
        for x in range(-_RADIUS, _RADIUS + 1):
            if x * x + y * y <= _RADIUS * _RADIUS:
                other = padded[_RADIUS + y : _RADIUS + y + height, _RADIUS + x : _RADIUS + x + width]
                off_plane = other - (values + (x * across + y * down))
                with np.errstate(over="ignore"):  # what is so unlike counts nothing
                    unlike = (off_plane / np.float32(_RANGE * strength)) ** 2
                unlike += np.float32((x * x + y * y) / _SPREAD**2)
                weight = np.nan_to_num(np.exp(np.float32(-0.5) * unlike))
                total += weight * np.nan_to_num(off_plane)
                weights += weight
    return (values + total / np.maximum(weights, np.float32(1e-6))).astype(np.float32, copy=False)


def _slope(values: Float32, axis: int) -> Float32:
    """(H, W) how much values change from pixel to pixel: the lesser change of the two sides', 0 where they disagree."""
    along = values if axis == 1 else values.T
    padded = np.pad(along, ((0, 0), (_REACH, _REACH)), constant_values=np.nan)
    before = (along - padded[:, : along.shape[1]]) / _REACH
    after = (padded[:, 2 * _REACH :] - along) / _REACH
    lesser = np.where(np.abs(before) < np.abs(after), before, after)
    slope = np.nan_to_num(np.where(before * after > 0, lesser, 0)).astype(np.float32)
    return slope if axis == 1 else slope.T


def _temporally_filtered(values: Float32, known: Float32, strength: float) -> Float32:
    """Values drawn to what was known before; the less the farther they are from it: noise does, and no move.

    A steady drift v is followed at a distance d, both over `strength`, with d = v + `_KEPT` exp(-d^2 / 2) d: behind by
    0.55 at most.
    """
    off = known - values
    with np.errstate(over="ignore"):
        weight = np.float32(_STEADY_WEIGHT) * np.exp(np.float32(-0.5) * (off / np.float32(strength)) ** 2)
    return (values + np.nan_to_num(weight * off)).astype(np.float32, copy=False)
