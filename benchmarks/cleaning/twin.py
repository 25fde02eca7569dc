"""Cleaned depth, step by step in NumPy and OpenCV: an approximate reference for kernels/cleaning.

It differs from the kernels in three ways. It finds islands in values that are rounded to 1/16 of the scale's unit. It
grows regions pixel by pixel, from the samples that the previous step reached. It computes weights with exponentials.
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

_RANGE = 3.3  # standard deviation of the smoothing's weights over depth, in deviations of noise; steps of ten stay
_RADIUS, _SPREAD = 5, 3.0  # radius of the smoothing, and standard deviation of its weights over distance, in pixels
_REACH = 3  # distance, in pixels, of the samples on both sides that give a slope
_NOISE_MIN = 5e-4  # least noise that is assumed, as a fraction of the depth
_APART, _LEAST_APART = 5.0, 0.02  # least step between surfaces: deviations of noise, and fraction of the depth
_GAP = 2  # pixels within which the next valid sample in a direction is sought
_UNLIKE = (0.03, 0.1, 0.3, np.inf)  # largest colour differences, summed over channels, that depth crosses: four rounds
_ALIKE = 0.1  # largest difference of colours, summed over channels, on one surface
_SPECKLE = 40  # pixels: smaller islands, apart from their surroundings, are removed
_STEPS = 4096  # entries of the scale's table
_STEADY_WEIGHT = 0.9  # weight of the previous frame's value if it equals the new one


def clean_depth(
    depth: Depth, color: Color | None = None, *, before: Depth | None = None, holes: int = 8, strength: float = 1.0
) -> CleanedDepth:
    """Clean depth like `pyibr.clean_depth`; arguments must be valid."""
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
    """Return depth with NaN for every invalid sample."""
    return np.where((depth > 0) & np.isfinite(depth), depth, np.float32(np.nan))


class _Scale:
    """Nearness (1 / depth) on a scale whose unit is the same multiple of the noise at every depth.

    depths: images whose range the scale covers; NaN where there is no depth. at, noise: (k,) values of nearness, and
    the length of the scale's unit there, in nearness. least: least length of the unit, as a fraction of the nearness.
    """

    def __init__(self, depths: Sequence[Depth], at: Float64, noise: Float64, least: float) -> None:
        low, high = 1 / max(float(np.nanmax(d)) for d in depths), 1 / min(float(np.nanmin(d)) for d in depths)
        self._nearness = np.geomspace(low, max(high, low * 1.001), _STEPS)
        found = least * self._nearness
        if len(at):  # nearer than `at`, the unit grows with nearness, so that stray samples do not stretch the scale
            looked = np.interp(self._nearness, at, noise) * np.maximum(self._nearness / at[-1], 1)
            found = np.maximum(found, looked)
        self._values = np.append(0, np.cumsum(2 * np.diff(self._nearness) / (found[1:] + found[:-1])))

    def of(self, depth: Depth) -> Float32:
        """Values of depths on this scale."""
        return np.interp(1 / depth.astype(np.float64), self._nearness, self._values).astype(np.float32)

    def depth_of(self, values: Float32) -> Depth:
        """Inverse of `of`."""
        return (1 / np.interp(values, self._values, self._nearness)).astype(np.float32)


def _flying_pixels(values: Float32) -> Mask:
    """(H, W) bool: samples that the camera mixed from two surfaces at an edge: they lie between them, apart from both.

    Rows, columns and diagonals are examined. A sample stays if it lies on the line through the next two samples on one
    side.
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
    """(H, W) next value in a direction, and the value that the line through the next two has here; NaN if unknown."""
    next_one, next_at = _first_known(values, dy, dx, np.zeros(values.shape, np.float32))
    after, after_at = _first_known(values, dy, dx, next_at)
    expected = next_one + (next_one - after) * next_at / (after_at - next_at)
    return next_one, expected.astype(np.float32, copy=False)


def _first_known(values: Float32, dy: int, dx: int, beyond: Float32) -> tuple[Float32, Float32]:
    """(H, W) first value more than `beyond` steps away, by `_GAP` at most, and its distance in steps; NaN if none."""
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
    """(H, W) bool: missing samples whose depth in the previous frame agrees with a sample of similar colour nearby.

    `values` are the new frame's, `known` the previous frame's; nearby is within `_GAP` pixels.
    """
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
    """(H, W) bool: samples that may have depth: the morphological closing of `kept` by a disc of radius `holes`."""
    if holes == 0:
        return kept
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * holes + 1, 2 * holes + 1))
    closed: NDArray[np.uint8] = cv2.morphologyEx(kept.astype(np.uint8), cv2.MORPH_CLOSE, disc)
    return closed.astype(np.bool_)


def _tint(color: Color) -> Float32:
    """Colours as float32 from 0 to 1."""
    return color.astype(np.float32) * np.float32(1 / 255 if color.dtype == np.uint8 else 1)


def _region_grown(cv2: Any, depth: Depth, kept: Mask, area: Mask, tint: Float32 | None) -> Depth:
    """Depth in the whole area, grown from the kept samples into the gaps; NaN elsewhere.

    Depth first spreads to pixels of similar colour, so that regions that grow from two sides meet at a colour edge.
    """
    grown, there = np.where(kept, depth, np.float32(np.nan)), kept.copy()
    if tint is None:
        _grow(cv2, grown, there, area, np.zeros((*kept.shape, 1), np.float32), np.inf)
        return grown
    for most in _UNLIKE:
        _grow(cv2, grown, there, area, tint, most)
    return grown


def _grow(cv2: Any, grown: Depth, there: Mask, area: Mask, tint: Float32, most: float) -> None:
    """Give samples the depth of the neighbour with the most similar colour, if the difference is at most `most`."""
    height, width = there.shape
    steps = [(dy, dx) for dy in (-1, 0, 1) for dx in (-1, 0, 1) if dy or dx]
    steps.sort(key=lambda step: abs(step[0]) + abs(step[1]))  # among equally similar neighbours, the first wins
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
    """(H, W) bool: islands, apart from their surroundings, that have too few samples to count as a surface."""
    there = np.isfinite(values)
    fine = min(16.0, (np.iinfo(np.int16).max - 2) / max(float(np.nanmax(values)), 1.0))
    steps = np.where(there, np.rint(np.nan_to_num(values) * fine) + 1, 0).astype(np.int16)
    cv2.filterSpeckles(steps, 0, min(_SPECKLE, np.count_nonzero(there) // 10), max(round(fine), 1))
    return there & (steps == 0)


def _islands_with(cv2: Any, islands: Mask, some: Mask) -> Mask:
    """(H, W) bool: islands that contain some of the samples `some`, such as pieces of a wire seen before."""
    labels: NDArray[np.int32] = cv2.connectedComponents(islands.astype(np.uint8))[1]
    return islands & np.isin(labels, labels[islands & some])


def _smoothed(cv2: Any, values: Float32, strength: float) -> Float32:
    """Filter the known values bilaterally, by their distances from a plane through each sample.

    Without such a plane, neighbours on steep surfaces would differ by more than the noise, and would not be averaged.
    """
    off = float(np.nanmax(values)) + 20 * _RANGE * strength  # value of missing samples; too far off to have weight
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
                with np.errstate(over="ignore"):  # such values have no weight
                    unlike = (off_plane / np.float32(_RANGE * strength)) ** 2
                unlike += np.float32((x * x + y * y) / _SPREAD**2)
                weight = np.nan_to_num(np.exp(np.float32(-0.5) * unlike))
                total += weight * np.nan_to_num(off_plane)
                weights += weight
    return (values + total / np.maximum(weights, np.float32(1e-6))).astype(np.float32, copy=False)


def _slope(values: Float32, axis: int) -> Float32:
    """(H, W) slope per pixel: the lesser of the slopes on both sides, or 0 if their signs differ."""
    along = values if axis == 1 else values.T
    padded = np.pad(along, ((0, 0), (_REACH, _REACH)), constant_values=np.nan)
    before = (along - padded[:, : along.shape[1]]) / _REACH
    after = (padded[:, 2 * _REACH :] - along) / _REACH
    lesser = np.where(np.abs(before) < np.abs(after), before, after)
    slope = np.nan_to_num(np.where(before * after > 0, lesser, 0)).astype(np.float32)
    return slope if axis == 1 else slope.T


def _temporally_filtered(values: Float32, known: Float32, strength: float) -> Float32:
    """Pull values towards the previous frame's, the less the more they differ: this reduces noise but keeps motion.

    If depth drifts by v per frame, each new value differs from the previous result by d, where
    d = v + `_STEADY_WEIGHT` exp(-d^2 / 2) d in units of `strength`. The result lags behind by d - v, at most 0.55.
    """
    off = known - values
    with np.errstate(over="ignore"):
        weight = np.float32(_STEADY_WEIGHT) * np.exp(np.float32(-0.5) * (off / np.float32(strength)) ** 2)
    return (values + np.nan_to_num(weight * off)).astype(np.float32, copy=False)
