"""Noise of depth, estimated from its own samples."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from functools import cached_property
from typing import cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pyibr.core.camera import Projection
from pyibr.core.checks import Float64, Immutable, describe, number_from, numbers, positive
from pyibr.core.errors import ArgumentError

Depth = NDArray[np.float32]
Terms = tuple[float, float, float]
Found = tuple[Terms, Terms]

Noise = float | Terms | Callable[[Float64], Float64]
"""Noise argument of `DepthImage` and `clean_depth`."""

_PLACES = 16  # depths at which a noise function is sampled
_NOISE_MAX = 1e18  # scene units: its square is still within single precision
_ROUNDS, _CLOSE = 3, 0.02  # number of fits; relative differences above _CLOSE have less weight in the next fit
_SIMPLER = 0.03  # each additional term must lower the mean relative difference by at least this
_RIDGE = 1e-9  # regularization: samples at a single depth cannot separate the terms
_CHOICES = np.array(
    [[kind in kinds for kind in range(3)] for count in (1, 2, 3) for kinds in itertools.combinations(range(3), count)]
)
"""Subsets of the three terms that a fit may have: (7, 3) bool, the smallest first."""
_CHOSEN_PAIRS = _CHOICES[:, :, None] & _CHOICES[:, None, :]
_OTHERS = np.eye(3) * np.where(_CHOICES, _RIDGE, 1.0)[:, None]

_estimators: list[Callable[[DepthNoise], Found]] = []


def estimated_by(estimate: Callable[[DepthNoise], Found]) -> Callable[[DepthNoise], Found]:
    """Register the function that estimates noise on a device; a decorator. Images themselves know no device."""
    _estimators[:] = [estimate]
    return estimate


class DepthNoise(Immutable):
    """Noise of an image's depth, (H, W), and the quantization steps of its scale, estimated on first use.

    Depths that are not finite, <= 0 or >= `far` are ignored. given: the standard deviation, which is then not
    estimated. cells: number of sampled cells; with 6,000 the estimate is accurate to a few percent.
    """

    def __init__(self, depth: Depth, far: float = np.inf, given: Terms | None = None, cells: int = 6_000) -> None:
        self.depth, self.far, self.given, self.cells = depth, far, given, cells

    @property
    def deviation(self) -> Terms:
        """(a, b, c), none negative: at depth z the noise has a standard deviation of about a z^2 + b z + c.

        The first term is the noise of stereo and structured light, the others that of time of flight. The deviation is
        at least half a step of the scale, since depths between two levels are rounded to either.
        """
        return self._found[0] if self.given is None else self.given

    @property
    def steps(self) -> Terms:
        """(a, b, c), none negative: at depth z, levels of a quantized scale lie a z^2 + b z + c apart.

        Such scales are, for example, disparities or whole units.
        """
        return self._found[1]

    @cached_property
    def _found(self) -> Found:
        return _estimators[0](self)


def fitted_noise(depths: Float64, deviations: Float64, counts: ArrayLike = 1.0) -> Terms:
    """(a, b, c), none negative: fit a z^2 + b z + c to deviations (n,) at depths z (n,); zero deviations do not count.

    counts: number of samples behind each deviation.
    """
    known = deviations > 0
    number = np.count_nonzero(known)
    if not number:
        return 0.0, 0.0, 0.0
    z, in_depth, shares = depths[known], deviations[known], np.broadcast_to(counts, known.shape)[known]
    shares = shares / shares.max()
    terms = np.empty((number, 3))
    terms[:, 0], terms[:, 1], terms[:, 2] = z * z, z, 1.0
    terms /= in_depth[:, None]
    # Each subset of terms is fitted for least absolute differences, by reweighted squares: outliers, such as a sky
    # whose noise is clipped at nearness 0, have little weight. In the normal equations, terms outside a subset have
    # identity rows.
    sizes: Float64 = np.sqrt(np.add.reduce(terms * terms, axis=0))
    scaled = terms / sizes
    products = (scaled[:, :, None] * scaled[:, None, :]).reshape(number, 9)
    found: Float64 = np.zeros((len(_CHOICES), 3))
    differences: Float64 = np.zeros((len(_CHOICES), number))
    for _ in range(_ROUNDS):
        weights = shares / np.maximum(differences, _CLOSE)
        weights /= np.maximum.reduce(weights, axis=1, keepdims=True)
        systems = (weights @ products).reshape(-1, 3, 3) * _CHOSEN_PAIRS + _OTHERS
        sums: Float64 = (weights @ scaled) * _CHOICES
        found = cast("Float64", np.linalg.solve(systems, sums[:, :, None])[:, :, 0])
        differences = np.abs(found @ scaled.T - 1)
    off = differences @ shares / shares.sum() + _SIMPLER * _CHOICES.sum(axis=1)
    choices = (found / sizes).tolist()
    ranks = [by if min(choice) >= 0 else math.inf for by, choice in zip(off.tolist(), choices, strict=True)]
    a, b, c = (min(term, _NOISE_MAX) for term in choices[ranks.index(min(ranks))])
    return a, b, c


def checked_noise(noise: object, depth: Depth, far: float = np.inf, projection: Projection = "perspective") -> Terms:
    """Return (a, b, c) of the noise that a user gives, or raise ArgumentError.

    depth, far: the samples; a function is evaluated over their range. projection: decides whether a number is the
    deviation of 1 / depth (perspective) or of depth (orthographic).
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
    """Return the noise of depth from disparity as the standard deviation of 1 / depth, for `DepthImage`.

    Parameters
    ----------
    pixels : float
        >= 0: standard deviation of the disparity.
    focal : float
        > 0: focal length of the camera, in pixels.
    baseline : float
        > 0: distance of the two cameras (or camera and projector), in scene units.

    Raises
    ------
    ArgumentError
        If a value is out of range.

    Examples
    --------
    >>> import pyibr as ibr
    >>> round(ibr.disparity_noise(0.25, 500, 0.1), 6)
    0.005
    """
    deviation = number_from("pixels", pixels, 0.0, math.inf, "a number of pixels >= 0")
    return deviation / (positive("focal", focal) * positive("baseline", baseline))
