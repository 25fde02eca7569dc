"""Noise of depth, estimated from its own samples."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable
from functools import cached_property
from typing import cast

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Projection
from pyibr.core.checks import Float64, describe, number_from, numbers, positive
from pyibr.core.errors import ArgumentError

Depth = NDArray[np.float32]
Nearness = NDArray[np.float32]

Noise = float | tuple[float, float, float] | Callable[[Float64], Float64]
"""Noise of depth, as `DepthImage` and `clean_depth` take it."""

_PLACES = 16  # depths at which a function of noise is looked at

_RANGES, _SAMPLES_MIN = 12, 50  # noise is looked up for as many ranges of depth, each from so many samples at least
_SAMPLES_MAX = 80_000  # samples that are looked at: medians of more are no surer
_LEVELS, _OF_LEVEL = 5, 10  # so many values in a range of depth, each so many times on average, are a scale's steps, if
_OF_STAIRS = 0.02  # such a part of the samples is level to one side alone,
_OFF_MULTIPLE, _FEW = 0.1, 0.04  # or values lie several steps apart, but for few; else rows have a depth each
_STEP_MAX = 0.02  # of the nearness: farther apart are surfaces
_ENOUGH = 10 * _RANGES * _SAMPLES_MIN  # for the three figures of all depths together: noise is found to 2 % then
_STAIRS_MIN, _STAIRS, _OF_ONE_STEP = (
    50,
    0.3,
    0.6,
)  # of a scale: changes amid level samples, also as a part of all, and of
_LEVELS_MIN = 12  # one step; and so many levels
_NOISE_MAX = 1e18  # scene units: its square is still within single precision
_GOLDEN = 0.6180339887498949
_OF_MIDDLE = 1.4826 / math.sqrt(6)  # a standard deviation by the middle of 1, -2, 1 times normal noise
_SHAPE = 2.0  # times as large over two samples as over one: of noise 1, of a curve 4
_NOISE_MIN = 5e-4  # a part of the nearness: smaller differences may be of a scale's steps, or of shapes
_ROUNDING = 2e-7  # of the nearness: of single precision, no noise
_ROUNDS, _CLOSE = 3, 0.02  # of fits, of which each heeds less what is off by more than that in the one before
_RIDGE = 1e-9  # of one depth alone, the kinds of noise cannot be told apart
_ROWS = 5  # times as many lie in the lines that they are taken from
_APART = 2  # samples between lines, which are none
_CHOICES = np.array(
    [[kind in kinds for kind in range(3)] for count in (1, 2, 3) for kinds in itertools.combinations(range(3), count)]
)
"""Which of the three kinds of noise there are: (7, 3) bool, the fewest first."""
_CHOSEN_PAIRS = _CHOICES[:, :, None] & _CHOICES[:, None, :]
_OTHERS = np.eye(3) * np.where(_CHOICES, _RIDGE, 1.0)[:, None]


class DepthNoise:
    """Noise of an image's depth, and the steps of its scale: each found on first use, or given.

    Parameters
    ----------
    depth : (H, W) float32
        There is none where it is not finite, <= 0 or >= `far`.
    far : float
    given : (a, b, c), optional
        The deviation, if it is known.
    """

    def __init__(self, depth: Depth, far: float = np.inf, given: tuple[float, float, float] | None = None) -> None:
        self.given = given
        self._depth, self._far = depth, far

    @cached_property
    def deviation(self) -> tuple[float, float, float]:
        """(a, b, c), none negative: at depth z the noise has a standard deviation of about a z^2 + b z + c.

        Stereo and structured light have the first kind, time of flight the others.
        """
        if self.given is not None:
            return self.given
        at, deviations = _noise_along(self._line, _ENOUGH)
        deviations[deviations < _ROUNDING * at] = 0.0
        return fitted_noise(1 / at, deviations / at**2)

    @cached_property
    def is_random(self) -> bool:
        """True of what is noise for sure: given, or second differences do not grow with the distance, as shapes' do."""
        if self.given is not None:
            return any(self.given)
        near, far = (_typical_change(self._line, step) for step in (1, 2))
        return near > _NOISE_MIN and far < _SHAPE * near

    @cached_property
    def steps(self) -> tuple[float, float, float]:
        """(a, b, c), none negative: at depth z the values that a coarse scale has lie about a z^2 + b z + c apart.

        Disparity has steps of the first kind, depth in whole units of the last. On a scale, surfaces are stairs:
        neighbours differ where those before and after them do not, by as much as values that are next to each other.
        """
        return _steps_along(self._line)

    @cached_property
    def _line(self) -> Nearness:
        return _line_of(self._depth, self._far, _ENOUGH)


def noise_by_nearness(depth: Depth, far: float = np.inf, count_max: int = _SAMPLES_MAX) -> tuple[Float64, Float64]:
    """Noise of (H, W) depth in which there is none where it is not finite, <= 0 or >= `far`.

    It is taken from second differences along rows and columns, which the surface's slope leaves alone, and from their
    median, which its edges leave alone. Where every other sample is missing, neighbours are two apart. About
    `count_max` samples are looked at. Cameras that tell depth in coarse steps show no difference on most pixels: their
    noise is half a step at least, as a depth between two steps is rounded now to the one, now to the other.

    Returns
    -------
    (k,) float64, (k,) float64
        Nearness (1 / depth), growing, and the standard deviation of the nearness there; k = 0 if too little is known.
    """
    return _noise_along(_line_of(depth, far, count_max), count_max)


def _line_of(depth: Depth, far: float, count_max: int) -> Nearness:
    """The nearness of some rows, and of some columns, one after the other, of several times `count_max` samples.

    NaN where there is none, and between them.
    """
    apart = max(2 * depth.size // min(_ROWS * count_max, _SAMPLES_MAX), 1)
    parts = [depth[::apart], depth.T[::apart]]
    line = np.zeros(sum(len(part) * (part.shape[1] + _APART) for part in parts), np.float32)
    start = 0
    for part in parts:
        width = part.shape[1] + _APART
        line[start : start + len(part) * width].reshape(-1, width)[:, :-_APART] = part
        start += len(part) * width
    with np.errstate(
        divide="ignore", over="ignore", invalid="ignore"
    ):  # of depths so near that float32 holds no nearness
        near = np.float32(1) / line
    known = near > 0
    known &= near < np.inf
    if far < np.inf:
        known &= line < far
    np.copyto(near, np.nan, where=np.logical_not(known, out=known))
    return near


def _noise_along(line: Nearness, count_max: int) -> tuple[Float64, Float64]:
    """Noise of a line, as `noise_by_nearness` returns it."""
    starts, all_places, changes = _changes(line, 1, count_max)
    steps_between: NDArray[np.intp] | int = 1
    if len(all_places) < min(10 * _RANGES * _SAMPLES_MIN, count_max):
        more = _changes(line, 2, count_max)
        steps_between = np.repeat([1, 2], [len(all_places), len(more[0])])
        starts = np.concatenate([starts, more[0]])
        all_places, changes = np.concatenate([all_places, more[1]]), np.concatenate([changes, more[2]])
    count = len(all_places)
    if count < _SAMPLES_MIN:
        return np.empty(0), np.empty(0)
    ranges = min(_RANGES, count // _SAMPLES_MIN)
    each = count // ranges  # few are left over: the nearest ones
    order = _growing(all_places)[: ranges * each].reshape(ranges, each)
    place, change = all_places[order], changes[order]
    middles = np.partition(change, each // 2, axis=1)[:, each // 2].astype(np.float64) * _OF_MIDDLE
    some = place[:, :: _OF_LEVEL // 2]  # where these differ too often, all do
    changes_of_some = np.add.reduce(some[:, 1:] != some[:, :-1], axis=1)
    on_levels: list[int] = (changes_of_some < each / _OF_LEVEL).nonzero()[0].tolist()
    if on_levels:
        before, after = (line[starts + at] == all_places for at in (0, 2 * steps_between))
        stairs: list[int] = np.add.reduce((before != after)[order], axis=1).tolist()
        for part in on_levels:
            step = _step_of(place[part], stairs[part])
            middles[part] = max(middles[part], 0.5 * step if step < _STEP_MAX * place[part, 0] else 0.0)
    return place[:, each // 2].astype(np.float64), middles


def _step_of(place: Nearness, stairs: int) -> float:
    """The middle step of the scale that a range of nearness, growing, is told on; 0 if it is on none.

    `stairs`: how many of the samples are level to one side alone.
    """
    rises = place[1:] - place[:-1]
    at = rises.nonzero()[0]
    levels = 1 + len(at)
    if levels < _LEVELS or len(place) < _OF_LEVEL * levels:
        return 0.0
    steps: list[float] = rises[at].tolist()
    if stairs < _OF_STAIRS * len(place) and not _are_multiples(steps, place[at].tolist()):
        return 0.0
    return sorted(steps)[-(levels // 2)]


def _are_multiples(steps: list[float], place: list[float]) -> bool:
    """Tell whether steps of nearness, or those of depth that they are, are one and several times the same."""
    in_depth = [step / (near * near) for step, near in zip(steps, place, strict=True)]
    for each in (steps, in_depth):  # some twenty: NumPy would take longer
        least, few = min(each), _FEW * len(each)
        off = [step for step in each if _OFF_MULTIPLE < step / least % 1.0 < 1.0 - _OFF_MULTIPLE]
        if len(off) <= few and len([step for step in each if step > 1.5 * least]) > few:
            return True
    return False


def _typical_change(line: Nearness, step: int) -> float:
    """The middle second difference of nearness along a line, as a part of it; 0 if too few samples are known."""
    _, place, change = _changes(line, step, _ENOUGH)
    with np.errstate(over="ignore"):  # of nearness that float32 hardly holds
        return float(np.median(change / place)) if len(place) >= _SAMPLES_MIN else 0.0


def _changes(line: Nearness, step: int, count_max: int) -> tuple[NDArray[np.intp], Nearness, Nearness]:
    """Nearness along a line and its second differences, of some `count_max` samples; first, where those before lie."""
    here = line[step:-step]
    with np.errstate(over="ignore", invalid="ignore"):
        change = np.abs(line[: -2 * step] - 2 * here + line[2 * step :])
    known = np.isfinite(change).nonzero()[0]
    if len(known) > count_max:
        known = known[_spread(count_max, len(known))]
    return known, here[known], change[known]


@functools.lru_cache(maxsize=8)
def _spread(count: int, total: int) -> NDArray[np.intp]:
    """So many of a total number, at no regular distance, which might be that of what is seen."""
    return (np.mod(np.arange(count, dtype=np.float64) * _GOLDEN, 1.0) * total).astype(np.intp)


def _growing(values: Nearness) -> NDArray[np.intp]:
    """The order of values > 0, of equal ones as they come: by halves, which NumPy sorts by their digits."""
    bits = values.view(np.uint32)
    by_low = bits.astype(np.uint16).argsort(kind="stable")
    return by_low[(bits >> 16).astype(np.uint16)[by_low].argsort(kind="stable")]


def fitted_noise(depths: Float64, deviations: Float64) -> tuple[float, float, float]:
    """(a, b, c), none negative: deviations (n,) at depths z (n,) are about a z^2 + b z + c; zeros do not count."""
    counts = deviations > 0
    number = np.count_nonzero(counts)
    if not number:
        return 0.0, 0.0, 0.0
    z, in_depth = (depths, deviations) if number == len(counts) else (depths[counts], deviations[counts])
    terms = np.empty((number, 3))
    terms[:, 0], terms[:, 1], terms[:, 2] = z * z, z, 1.0
    terms /= in_depth[:, None]
    # Least differences of each choice of terms, by weighted squares: what is far off, as a sky whose noise is cut off
    # at no nearness, tells nothing. In normal equations the terms that are not of a choice are the identity's.
    sizes: Float64 = np.sqrt(np.add.reduce(terms * terms, axis=0))
    scaled = terms / sizes
    products = (scaled[:, :, None] * scaled[:, None, :]).reshape(number, 9)
    found: Float64 = np.zeros((len(_CHOICES), 3))
    differences: Float64 = np.zeros((len(_CHOICES), number))
    for _ in range(_ROUNDS):
        weights = 1 / np.maximum(differences, _CLOSE)
        weights /= np.maximum.reduce(weights, axis=1, keepdims=True)
        systems = (weights @ products).reshape(-1, 3, 3) * _CHOSEN_PAIRS + _OTHERS
        sums: Float64 = (weights @ scaled) * _CHOICES
        found = cast("Float64", np.linalg.solve(systems, sums[:, :, None])[:, :, 0])
        differences = np.abs(found @ scaled.T - 1)
    off = np.add.reduce(differences, axis=1).round(6)  # of equally good ones the fewest
    choices = (found / sizes).tolist()
    ranks = [by if min(choice) >= 0 else math.inf for by, choice in zip(off.tolist(), choices, strict=True)]
    a, b, c = (min(term, _NOISE_MAX) for term in choices[ranks.index(min(ranks))])
    return a, b, c


def checked_noise(
    noise: object, depth: Depth, far: float = np.inf, projection: Projection = "perspective"
) -> tuple[float, float, float]:
    """Return (a, b, c) of the noise of depth as users give it, or raise ArgumentError.

    depth, far: the samples, whose range tells where a function is looked at. projection: of a number, what it is of.
    """
    expected = "a number >= 0, three of them or a function of depth"
    if not callable(noise):
        given = numbers("noise", noise, () if np.ndim(noise) == 0 else (3,))  # pyright: ignore[reportArgumentType]
        if not (given >= 0).all():
            raise ArgumentError("noise", expected, describe(noise))
        if given.ndim:
            a, b, c = given.tolist()
            return a, b, c
        return (float(given), 0.0, 0.0) if projection == "perspective" else (0.0, 0.0, float(given))
    valid = depth[(depth > 0) & (depth < far)]
    ends = (float(valid.min()), float(valid.max())) if len(valid) else (1.0, 1.0)
    z: Float64 = np.linspace(*ends, _PLACES)
    deviations: Float64 = np.asarray(cast("Callable[[Float64], Float64]", noise)(z), np.float64)
    if deviations.shape != z.shape or not (np.isfinite(deviations) & (deviations >= 0)).all():
        expected = f"a function of ({_PLACES},) depths that returns as many numbers >= 0"
        raise ArgumentError("noise", expected, describe(deviations))
    return fitted_noise(z, deviations)


def disparity_noise(pixels: float, focal: float, baseline: float) -> float:
    """Return the noise of depth from disparity: the standard deviation of 1 / depth, as `DepthImage` takes it.

    Parameters
    ----------
    pixels : float
        >= 0: standard deviation of the disparity.
    focal : float
        > 0: focal length of the camera, in pixels.
    baseline : float
        > 0: between the two cameras (or camera and projector), in scene units.

    Raises
    ------
    ArgumentError
        If one is out of its range.

    Examples
    --------
    >>> import pyibr as ibr
    >>> round(ibr.disparity_noise(0.25, 500, 0.1), 6)
    0.005
    """
    deviation = number_from("pixels", pixels, 0.0, math.inf, "a number of pixels >= 0")
    return deviation / (positive("focal", focal) * positive("baseline", baseline))


def _steps_along(line: Nearness) -> tuple[float, float, float]:
    """Steps of the scale of a line, as `DepthNoise.steps` has them."""
    level = line[1:] == line[:-1]
    if np.count_nonzero(level) < _STAIRS_MIN:
        return 0.0, 0.0, 0.0
    change = ~level[1:-1]
    at = (level[:-2] & change & level[2:]).nonzero()[0]  # known ones: what is not equals nothing
    if len(at) < _STAIRS_MIN:
        return 0.0, 0.0, 0.0
    known = line == line
    change &= known[1:-2]
    change &= known[2:-1]
    if len(at) < _STAIRS * np.count_nonzero(change):
        return 0.0, 0.0, 0.0
    before, after = line[at + 1].astype(np.float64), line[at + 2].astype(np.float64)
    place, jump = np.maximum(before, after), np.abs(after - before)
    levels = np.sort(place)
    levels = levels[np.diff(levels, prepend=-np.inf) > 0]  # np.unique would load numpy.ma, for longer than a warp takes
    gaps = np.diff(levels)
    # Levels that are missing leave gaps of whole steps: the least ones around are the scale's.
    if len(gaps) < _LEVELS_MIN:
        return 0.0, 0.0, 0.0
    count = len(gaps) - _LEVELS + 1
    steps: Float64 = np.stack([gaps[i : i + count] for i in range(_LEVELS)]).min(axis=0)
    at = levels[_LEVELS // 2 : _LEVELS // 2 + count]
    # A scale's jumps are mostly of one step, surfaces' of any size.
    expected: Float64 = np.interp(place, at, steps)
    if np.mean(np.abs(jump / expected - 1) < 0.5) < _OF_ONE_STEP:
        return 0.0, 0.0, 0.0
    return fitted_noise(1 / at, steps / at**2)
