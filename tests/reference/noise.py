"""Noise of depth, estimated from the depth image itself."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pyibr.core.checks import Float64
from pyibr.images.noise import Depth, Found, Terms, fitted_noise

Nearness = NDArray[np.float32]

_CELLS_MIN = 50  # estimates from fewer cells are off by over 15 %
_KNOWN = 0.1  # fraction of cells with depth; with fewer, every other sample is taken to be missing
_GOLDEN = 0.6180339887498949  # rows are chosen at its multiples, to avoid periods of the picture
_MANTISSA = 23  # bits of a float32's mantissa
_ROUNDING = 2.0**-17  # fraction of the nearness: smaller differences may be rounding
_EDGE = 0.1  # fraction of the nearness: there is an edge between neighbours that differ more
_CELL = 2.0  # standard deviation of a cell's second difference, in deviations of one sample
# If fewer than 10 % of all cells have no edge, cells with edges are used, too. Ranges of nearness in which at least
# 80 % of the cells are used are preferred to other ranges.
_FEW, _SMOOTH = 0.1, 0.8
_MOST, _OF_MOST = 0.6, 0.39639  # the smallest 60 % of differences are averaged; their mean for unit normal noise
_LEAST_QUARTER = 0.15793 / 1.4  # mean of the smallest 25 %, which edges raise less, with a reserve of 1.4
_SHAPE = 9.0  # squared ratio of differences over two samples to differences over one: 1 for noise, 16 for curves
_FALL = 1.15  # nearer samples have at most this multiple of the noise of farther samples
_CHANCE = 4.0  # divided by the square root of the number of cells, this is added to `_FALL`: few cells are uncertain
_STEP_MAX = 0.25  # fraction of the nearness: larger differences are edges, not steps of a scale
_LEVELS_MIN = 12  # least number of levels of a scale; real stairs have fewer
_ONE_STEP = 0.6  # on a scale, 60 % of the changes are one step, and 60 % of the levels are whole steps apart
_STAIRS = 0.01  # least fraction of changes that are stairs; steep surfaces have few
_WHOLE, _MOSTLY = 0.02, 0.9  # 90 % of the multiples of a step must be whole to 0.02, as float32 rounds
_STAIRS_MAX = 4_000  # largest number of changes that are examined
_OFF = 0.2  # steps by which changes, and gaps between levels, may differ from whole steps: two scales may be mixed
_NEAREST = 1e37  # greatest nearness: four times as much still fits float32


def _octaves(values: Nearness, parts: int) -> NDArray[np.int32]:
    """Index of the range that contains each positive float32 number; each octave is divided into 2^parts ranges."""
    return values.view(np.int32) >> (_MANTISSA - parts)


_QUARTERS, _EIGHTHS = 2, 3  # ranges of nearness are quarters of an octave, ranges of relative differences eighths
_LEAST, _GREATEST = _octaves(np.array([_ROUNDING, 1.0], np.float32), _EIGHTHS).tolist()
_MIDDLES = np.arange(2 * _LEAST - 1, 2 * _GREATEST + 2, 2, dtype=np.int32) << (_MANTISSA - _EIGHTHS - 1)
_SIZES: Float64 = _MIDDLES.view(np.float32).astype(np.float64)
_SIZES[0] = 0.0  # differences below `_ROUNDING`


def noise_of(depth: Depth, far: float = np.inf, cells: int = 6_000) -> Found:
    """Noise of an image's depth, and the steps of its scale, as `pyibr.images.noise.DepthNoise` holds them."""
    strips = _sampled_strips(depth, far, cells)
    steps = _scale_steps(strips)
    return _noise_of(strips, steps), steps


def _sampled_strips(depth: Depth, far: float, cells: int) -> Nearness:
    """Nearness, (3, n), of some strips of three rows and some strips of three columns, one strip after another.

    NaN where there is no sample, and between strips. If every other sample is missing, these are left out.
    """
    near = np.empty((3, 0), np.float32)
    for gap in (1, 2):
        sparse = depth[::gap, ::gap]
        parts = [_strips_of(side, cells) for side in (sparse, sparse.T)]
        z = np.concatenate(parts, axis=1)
        with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
            near = np.float32(1) / z
        near[~((near > 0) & (near < _NEAREST) & (z < far))] = np.nan
        known = np.isfinite(near[0]) & np.isfinite(near[1])
        if np.count_nonzero(known[1:] & known[:-1]) >= _KNOWN * near.shape[1]:
            break
    return near


def _strips_of(depth: Depth, cells: int) -> Depth:
    """Some strips of three rows, (3, n), each followed by two NaN."""
    height, width = depth.shape
    total = max(height - 2, 0)
    count = min(-(-cells // (2 * max(width, 1))), total)
    places = np.arange(count, dtype=np.float64)
    rows = (places if count == total else places * _GOLDEN % 1 * total).astype(np.intp)
    strips = np.full((3, count, width + 2), np.nan, np.float32)
    strips[:, :, :width] = depth[rows + np.arange(3)[:, None]]
    return strips.reshape(3, -1)


def _noise_of(strips: Nearness, steps: Terms) -> Terms:
    """Estimate noise, (a, b, c), from cells of 2 x 2 samples; it is at least half of a scale's steps.

    Each cell's second difference, upper left - upper right - lower left + lower right, is 0 on planes, and at edges
    along rows or columns. So most cells on thin structures, too, show only noise.
    """
    near, change, largest = _cells(strips[0], strips[1], 1)
    on_scale, half = any(steps), (0.5 * steps[0], 0.5 * steps[1], 0.5 * steps[2])
    if len(near) < _CELLS_MIN:
        return half
    smooth = largest < _EDGE * near
    if np.count_nonzero(smooth) < _FEW * len(near):  # noise is as large as edges
        smooth[:] = True
    row = _octaves(near, _QUARTERS)
    first = row.min()
    row -= first
    ranges = int(row.max()) + 1
    near_2, change_2, _ = _cells(strips[0], strips[2], 2)
    row_2 = np.minimum(np.maximum(_octaves(near_2, _QUARTERS) - first, 0), ranges - 1)
    one, two = _histogram(row[smooth], (change / near)[smooth], ranges), _histogram(row_2, change_2 / near_2, ranges)
    # Ranges with many equal samples, such as a sky, say nothing about noise, nor do ranges with many edges.
    total, every = np.add.reduce(one, axis=1), np.bincount(row, minlength=ranges)
    levels = np.bincount(row[largest == 0.0], minlength=ranges)
    told = (total >= _CELLS_MIN) & (on_scale | (levels < 0.25 * total))
    smoother = told & (total >= _SMOOTH * every)
    told = smoother if smoother.any() else told
    z, total = every[told] / np.bincount(row, near, minlength=ranges)[told], total[told]
    near_by, far_by = _deviations(np.stack([one[told], two[told]]), on_scale) * z
    # Subtract the part of curves, whose second differences grow with the square of the distance.
    deviations = np.sqrt(np.maximum(_SHAPE * near_by**2 - far_by**2, 0.0) / (_SHAPE - 1.0))
    if total[deviations == 0.0].sum() >= 0.5 * total.sum():
        return half
    most = np.minimum.accumulate(near_by * (_FALL + _CHANCE / np.sqrt(total)))
    deviations[1:] = np.minimum(deviations[1:], most[:-1])
    return fitted_noise(z, np.maximum(deviations, half[2] + (half[1] + half[0] * z) * z), total)


def _cells(upper: Nearness, lower: Nearness, gap: int) -> tuple[Nearness, Nearness, Nearness]:
    """Cells with four samples in two lines: mean nearness, second difference, largest difference of neighbours."""
    above, below, left = upper[gap:] - upper[:-gap], lower[gap:] - lower[:-gap], (lower - upper)[gap:]
    near = np.float32(0.25) * (upper[gap:] + upper[:-gap] + lower[gap:] + lower[:-gap])
    known = np.isfinite(near)
    near, above, below, left = near[known], above[known], below[known], left[known]
    return near, np.abs(above - below), np.maximum(np.maximum(np.abs(above), np.abs(below)), np.abs(left))


def _histogram(row: NDArray[np.int32], size: Nearness, ranges: int) -> NDArray[np.intp]:
    """Counts, (ranges, sizes), of differences by range of nearness and by size relative to the nearness."""
    column = np.minimum(np.maximum(_octaves(size, _EIGHTHS), _LEAST - 1), _GREATEST)
    at = row * len(_SIZES) + column - (_LEAST - 1)
    return np.bincount(at, minlength=ranges * len(_SIZES)).reshape(ranges, -1)


def _mean_below(counts: NDArray[np.intp], share: float) -> Float64:
    """Means, (..., ranges), of the smallest sizes, which make up the fraction `share`, in histograms.

    The histograms are (..., ranges, sizes). Quantiles would not do: for noise in steps they are whole steps.
    """
    wanted = share * np.add.reduce(counts, axis=-1)
    before = counts.cumsum(axis=-1) - counts
    weights = np.minimum(np.maximum(wanted[..., None] - before, 0.0), counts)
    return weights @ _SIZES / np.maximum(wanted, 1e-9)


def _deviations(counts: NDArray[np.intp], on_scale: bool) -> Float64:
    """Standard deviations of noise, (..., ranges), as fractions of the nearness, from (..., ranges, sizes) counts."""
    most = _mean_below(counts, _MOST) / _OF_MOST
    # On a scale, many differences are equal although there is noise.
    return (most if on_scale else np.minimum(most, _mean_below(counts, 0.25) / _LEAST_QUARTER)) / _CELL


def _scale_steps(strips: Nearness) -> Terms:
    """Estimate (a, b, c) of the steps of a scale, which are a z^2 + b z + c at depth z; all 0 without a scale.

    On a scale, surfaces are stairs: a sample equals one neighbour and differs from the other, mostly by one step.
    """
    none = 0.0, 0.0, 0.0
    along = strips[0, :-2], strips[0, 1:-1], strips[0, 2:]
    before, here, after = (np.concatenate(pair) for pair in zip(along, strips, strict=True))
    one, other = here - before, after - here
    jump, least = np.abs(one - other), np.minimum(np.abs(one), np.abs(other))
    is_change = (jump > _ROUNDING * here) & (jump < _STEP_MAX * here)
    is_stair = is_change & (least == 0)
    # On a scale, steep surfaces rise by a whole number of steps from sample to sample.
    steep = (is_change & (least > 0) & ((one > 0) == (other > 0))).nonzero()[0]
    multiples = least[steep] / jump[steep]
    is_stair[steep] = np.count_nonzero(np.abs(multiples - np.rint(multiples)) < _WHOLE) > _MOSTLY * len(steep)
    stairs = is_stair.nonzero()[0]
    if len(stairs) <= _STAIRS * np.count_nonzero(is_change):
        return none
    stairs = stairs[:: len(stairs) // _STAIRS_MAX + 1]
    place, jump = here[stairs], jump[stairs]
    levels = np.sort(place)  # np.unique would load numpy.ma, which takes longer than a warp
    levels = levels[np.diff(levels, prepend=0.0) > 0]
    if len(levels) < _LEVELS_MIN:
        return none
    row = _octaves(place, _QUARTERS)
    row -= row.min()
    ranges = int(row.max()) + 1
    counts = _histogram(row, (jump / place).astype(np.float32), ranges)
    at, of_one, levels = place.astype(np.float64), jump.astype(np.float64), levels.astype(np.float64)
    total = np.add.reduce(counts, axis=1)
    some = total > 0
    z = total[some] / np.bincount(row, at, minlength=ranges)[some]
    a, b, c = fitted_noise(z, _mean_below(counts[some], 0.25) * z, total[some])
    ratios = of_one / (a + (b + c * at) * at)
    near_one = np.abs(ratios - 1) < 0.5
    exact = float(np.median(ratios[near_one])) if near_one.any() else 1.0
    a, b, c = a * exact, b * exact, c * exact
    gaps = np.diff(levels) / (a + (b + c * levels[1:]) * levels[1:])
    is_whole = (gaps > _OFF) & (np.abs(gaps - np.rint(gaps)) < _OFF)
    is_one = np.abs(ratios / exact - 1) < _OFF
    return (a, b, c) if min(np.mean(is_one), np.mean(is_whole)) >= _ONE_STEP else none
