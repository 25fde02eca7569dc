"""Exposures of several views of one scene, told from the colours of what they show together."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from pyibr.core.checks import Float64
from pyibr.core.pixelspace import longer_side
from pyibr.images.depth_image import DepthImage
from pyibr.images.order import order_of

_SAMPLES = 3_000  # of a view that are looked up in others
_NEAREST, _FARTHER = 6, 3  # views that a view is looked up in: those next to it, and some of all others
_DEVIATIONS = 4.0  # of both views' noise, within which depths are one surface's
_SAME = 0.005  # of the depth, or of what an orthographic camera sees: without noise
_OVERLAP_MIN = 200  # samples of an overlap that tell anything
_DARKEST, _BRIGHTEST = 0.08, 0.98  # of a channel's range: beyond, sensors do not tell
_SURE, _ROUNDS = 0.02, 8  # residuals that count in full; rounds in which larger ones count less and less
_TIED = 1e-9  # of an overlap's weight: what holds views that nothing else does


Colors = NDArray[np.floating[Any]]


@dataclass(frozen=True)
class Overlap:
    """Two views' exposures where both show one surface.

    Attributes
    ----------
    first, second : int
        The views' numbers.
    ratio : (3,) float64
        Logarithm of the first one's red, green and blue over the second one's.
    count : int
        Samples that tell it.
    """

    first: int
    second: int
    ratio: Float64
    count: int


def exposure_gains(views: Sequence[DepthImage]) -> Float64:
    """Tell what each view's colours are to be multiplied by, so that views agree where they saw one surface.

    Some samples of each view are looked up in those next to it, and in a few of the others; the medians of their
    colours' ratios tell pairs of exposures apart, and all pairs together a gain for each view.

    Parameters
    ----------
    views : sequence of DepthImage
        In any order, which changes nothing.

    Returns
    -------
    (N, 3) float64
        By view, of red, green and blue.
    """
    order = order_of(views)
    ordered = [views[number] for number in order]
    sampled: _Sampled | None = None
    overlaps: list[Overlap] = []
    for first, second in _pairs(np.array([_place_of(view) for view in ordered])):
        known = _known.setdefault(ordered[first], WeakKeyDictionary())
        if ordered[second] not in known:
            if sampled is None or sampled.view is not ordered[first]:
                sampled = _Sampled(ordered[first])
            known[ordered[second]] = sampled.compared_with(ordered[second])
        if (found := known[ordered[second]]) is not None:
            overlaps.append(Overlap(first, second, *found))
    gains = np.empty((len(views), 3))
    gains[order] = matching_gains(len(views), overlaps)
    return gains


def matching_gains(views: int, overlaps: Iterable[Overlap]) -> Float64:
    """(views, 3) what each view's colours are to be multiplied by, so that they agree where they overlap.

    Least squares, in which pairs that contradict the others count little. Views that nothing is known of keep their
    colours. So does the one in the middle of those that overlaps connect: most cameras are right.
    """
    found = list(overlaps)
    logs = np.zeros((views, 3))
    if not found:
        return np.exp(logs)
    first, second = (np.array([getattr(one, end) for one in found]) for end in ("first", "second"))
    ratios, counts = np.array([one.ratio for one in found]), np.array([float(one.count) for one in found])
    weights = counts
    for _ in range(_ROUNDS):
        system, sums = np.eye(views) * (_TIED * counts.max()), np.zeros((views, 3))
        for end, other, sign in ((first, second, -1.0), (second, first, 1.0)):
            np.add.at(system, (end, end), weights)
            np.add.at(system, (end, other), -weights)
            np.add.at(sums, end, sign * weights[:, None] * ratios)
        logs = np.asarray(np.linalg.solve(system, sums), np.float64)
        off = np.abs(logs[first] - logs[second] + ratios).max(axis=1)
        if (off <= _SURE).all() and weights is counts:
            break
        weights = counts * (_SURE / np.maximum(off, _SURE))
    groups = _connected(views, zip(first.tolist(), second.tolist(), strict=True))
    for group in np.unique(groups):
        logs[groups == group] -= np.median(logs[groups == group], axis=0)
    return np.exp(logs)


def _connected(views: int, pairs: Iterable[tuple[int, int]]) -> NDArray[np.int64]:
    """(views,) the least number of those that pairs connect with each view."""
    group = np.arange(views)
    for first, second in pairs:
        one, other = sorted((group[first], group[second]))
        group[group == other] = one
    return group


def _pairs(places: Float64) -> list[tuple[int, int]]:
    """Pairs of views that are compared, the lower number first: so many a view, however many there are."""
    found: set[tuple[int, int]] = set()
    for number, place in enumerate(places):
        by_distance = np.argsort(((places - place) ** 2).sum(axis=1), kind="stable")
        others = by_distance[by_distance != number]
        far = others[_NEAREST:]
        some = far[np.linspace(0, len(far) - 1, min(_FARTHER, len(far))).astype(int)]
        compared = [*others[:_NEAREST].tolist(), *some.tolist()]
        found.update((min(number, other), max(number, other)) for other in compared)
    return sorted(found)


def compared_colors(first: Colors, second: Colors) -> tuple[Float64, int] | None:
    """Ratio and count of an `Overlap`, by (n, 3) colours in [0, 1] of the same points; None if too few tell it."""
    both = np.stack([first, second])
    tells = ((both > _DARKEST) & (both < _BRIGHTEST)).all(axis=(0, 2))
    if (count := int(np.count_nonzero(tells))) < _OVERLAP_MIN:
        return None
    logs = np.log(both[:, tells].astype(np.float64))
    return np.asarray(np.median(logs[0] - logs[1], axis=0), np.float64), count


class _Sampled:
    """Some valid samples of a view."""

    def __init__(self, view: DepthImage, most: int = _SAMPLES) -> None:
        step = max(int(np.sqrt(view.depth.size / (8 * most))), 1)
        y, x = np.nonzero(_is_valid(view.depth[::step, ::step], view))
        some = slice(None, None, max(len(y) // most, 1))
        self.view, self.y, self.x = view, y[some] * step, x[some] * step
        self.z = view.depth[self.y, self.x].astype(np.float64)

    @cached_property
    def points(self) -> Float64:
        """(n, 3) in the world; NaN where a lens does not see."""
        return self.view.camera.unproject(np.column_stack([self.x, self.y]), self.z)

    @cached_property
    def colors(self) -> NDArray[np.float32]:
        """(n, 3) in [0, 1]."""
        return _colors(self.view, self.y, self.x)

    def compared_with(self, other: DepthImage) -> tuple[Float64, int] | None:
        """Ratio and count of an `Overlap` with another view; None if too little tells it."""
        pixels, z = other.camera.project(self.points)
        with np.errstate(invalid="ignore"):
            at = np.rint(pixels)
            inside = (z > 0) & ((at >= 0) & (at < other.camera.size)).all(axis=1)
        seen = np.flatnonzero(inside)
        u, v = at[seen].astype(np.int64).T
        depth = other.depth[v, u]
        off = _noise(other, z[seen]) + _noise(self.view, self.z[seen]) + _SAME * _unit(other, z[seen])
        with np.errstate(invalid="ignore"):
            same = _is_valid(depth, other) & (np.abs(depth - z[seen]) <= off)
        return compared_colors(self.colors[seen[same]], _colors(other, v[same], u[same]))


_known: WeakKeyDictionary[DepthImage, WeakKeyDictionary[DepthImage, tuple[Float64, int] | None]] = WeakKeyDictionary()
"""How views compare with others, for as long as both are there."""

_places: WeakKeyDictionary[DepthImage, Float64] = WeakKeyDictionary()


def _place_of(view: DepthImage) -> Float64:
    """(6,) where a view was taken from, and the middle of some of what it sees."""
    if view not in _places:
        points = _Sampled(view, 100).points
        points = points[np.isfinite(points).all(axis=1)]
        middle = np.median(points, axis=0) if len(points) else view.camera.center
        _places[view] = np.concatenate([view.camera.center, middle])
    return _places[view]


def _is_valid(depth: NDArray[np.float32], view: DepthImage) -> NDArray[np.bool_]:
    with np.errstate(invalid="ignore"):
        return (depth > 0) & (depth < view.far) & np.isfinite(depth)


def _noise(view: DepthImage, z: Float64) -> Float64:
    a, b, c = view.noise
    return _DEVIATIONS * ((a * z + b) * z + c)


def _unit(view: DepthImage, z: Float64) -> Float64 | float:
    """The scale of depths, which orthographic cameras' own have not."""
    return longer_side(view.camera) if view.camera.projection == "orthographic" else z


def _colors(view: DepthImage, y: NDArray[Any], x: NDArray[Any]) -> NDArray[np.float32]:
    colors = view.color if view.has_color else view.shown_color
    return (colors[y, x] / np.float32(255 if colors.dtype == np.uint8 else 1)).astype(np.float32)
