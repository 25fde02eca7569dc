"""Exposures of several views of one scene, estimated from the colours of surfaces that they share."""

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

_SAMPLES = 3_000  # samples per view that are looked up in other views
_NEAREST, _FARTHER = 6, 3  # views that a view is compared with: its nearest neighbours, and some of the others
_DEVIATIONS = 4.0  # depths that differ by up to this many standard deviations of both views' noise are one surface
_SAME = 0.005  # tolerance besides noise, relative to the depth or to the extent of an orthographic camera's image
_OVERLAP_MIN = 200  # fewest usable samples of an overlap
_DARKEST, _BRIGHTEST = 0.08, 0.98  # usable part of a channel's range: sensors clip outside
_SURE, _ROUNDS = 0.02, 8  # residuals up to _SURE have full weight; rounds of reweighting
_TIED = 1e-9  # weight of the prior that keeps views without overlap at gain 1, relative to the largest overlap


Colors = NDArray[np.floating[Any]]


@dataclass(frozen=True)
class Overlap:
    """Relative exposure of two views, given by their indices, where both show one surface."""

    first: int
    second: int
    ratio: Float64
    """(3,) logarithm of the first view's red, green and blue over the second view's."""
    count: int
    """Samples behind the ratio."""


def exposure_gains(views: Sequence[DepthImage]) -> Float64:
    """Estimate gains for the colours of each view, so that views agree where they saw one surface.

    Some samples of each view are looked up in its nearest neighbours and in a few other views. The median ratio of
    their colours gives the relative exposure of two views; all pairs together give (N, 3) gains of red, green and blue
    for each view. The order of the views does not affect the gains.
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
    """(views, 3) gains for each view's colours, so that views agree where they overlap.

    The gains are a robust least-squares fit: pairs that contradict the others get little weight. Views without overlaps
    keep their colours. In each group of views connected by overlaps, the median gain is 1: most cameras are right.
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
    """(views,) a label for each view: the lowest index in its group of connected views."""
    group = np.arange(views)
    for first, second in pairs:
        one, other = sorted((group[first], group[second]))
        group[group == other] = one
    return group


def _pairs(places: Float64) -> list[tuple[int, int]]:
    """Pairs of views to compare, the lower index first. Each view adds a fixed number of pairs."""
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
    """Ratio and count of an `Overlap` from (n, 3) colours in [0, 1] of the same points; None if too few are usable."""
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
        """(n, 3) positions in the world; NaN where the lens has no ray."""
        return self.view.camera.unproject(np.column_stack([self.x, self.y]), self.z)

    @cached_property
    def colors(self) -> NDArray[np.float32]:
        """(n, 3) colours in [0, 1]."""
        return _colors(self.view, self.y, self.x)

    def compared_with(self, other: DepthImage) -> tuple[Float64, int] | None:
        """Ratio and count of an `Overlap` with another view; None if too few samples are usable."""
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
"""Cached ratios and counts of pairs of views, for as long as both views exist."""

_places: WeakKeyDictionary[DepthImage, Float64] = WeakKeyDictionary()


def _place_of(view: DepthImage) -> Float64:
    """(6,) the camera's centre, and the median of some of the view's points."""
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
    """Scale for relative tolerances: the depth, or the image's longer side for an orthographic camera."""
    return longer_side(view.camera) if view.camera.projection == "orthographic" else z


def _colors(view: DepthImage, y: NDArray[Any], x: NDArray[Any]) -> NDArray[np.float32]:
    colors = view.color if view.has_color else view.shown_color
    return (colors[y, x] / np.float32(255 if colors.dtype == np.uint8 else 1)).astype(np.float32)
