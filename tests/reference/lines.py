"""Exact sideways steps in float64: each epipolar line as the polyline of the surface along it.

Two cameras that share K and differ by a step along x, along y or (with square pixels) along a diagonal see each
other's lines of samples as lines of pixels. Along such a line the surface is a polyline with a knot at each sample,
and on the diagonals that cross the cells' own also one in the middle of each cell. A sample moves along its line by
focal length * step * nearness, and its nearness stays as it is: what has the greatest nearness is seen first.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.images import DepthImage
from tests.reference.warp import nearness

Array = NDArray[Any]

TOUCH = 1e-6  # pixels by which a segment reaches beyond its ends, so that rounding in float64 opens no gaps
NEAR_END = 1e-3  # pixels: a ray that passes an end of the surface this closely may see it or not


@dataclass
class Sideways:
    """View of a camera that has stepped sideways."""

    depth: Array  #: (H, W) float64, nan in holes
    source: Array  #: (H, W, 2) x and y in the source of what is seen, nan in holes
    on_end: Array  #: (H, W) bool: the ray passes an end of the surface, a fold or a lone sample, that nothing hides


def sideways_reference(view: DepthImage, step: tuple[float, float], cut_ratio: float = np.inf) -> Sideways:
    """Picture of a view that `view.camera.moved(*step, 0)` sees.

    Parameters
    ----------
    view : DepthImage
        The camera is perspective. If the step is along a diagonal, its pixels are square.
    step : (x, y)
        In scene units. One of them is 0, or both are of one length.
    cut_ratio : float
        Neighbours whose depths differ by a greater ratio are torn apart.
    """
    delta = nearness(view)
    height, width = delta.shape
    direction = np.sign(step).astype(int)
    if direction[np.flatnonzero(direction)[0]] < 0:
        direction = -direction
    axis = 0 if direction[0] else 1
    shift = view.camera.K[axis, axis] * step[axis]  # along the line, in pixels at nearness 1
    result = Sideways(np.full(delta.shape, np.nan), np.full((*delta.shape, 2), np.nan), np.zeros(delta.shape, bool))
    for start in _starts(width, height, direction):
        pixels = np.arange(_length(width, height, start, direction))
        x, y = (start + pixels[:, None] * direction).T
        s, q, closed = _polyline(delta, x, y, direction, cut_ratio)
        seen, place, result.on_end[y, x] = _first_seen(s, s - shift * q, q, closed, pixels)
        result.depth[y, x] = 1 / seen
        result.source[y, x] = start + place[:, None] * direction
    return result


def _starts(width: int, height: int, direction: Array) -> list[Array]:
    """The first sample (x, y) of each line."""
    samples = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).reshape(-1, 2)
    before = samples - direction
    inside = (before >= 0).all(axis=1) & (before < [width, height]).all(axis=1)
    return list(samples[~inside])


def _length(width: int, height: int, start: Array, direction: Array) -> int:
    """The number of samples from the first one to the image's border."""
    left = np.where(direction > 0, np.subtract([width, height], start), np.add(start, 1))
    return int(left[direction != 0].min())


def _polyline(delta: Array, x: Array, y: Array, direction: Array, cut_ratio: float) -> tuple[Array, Array, Array]:
    """The knots' places in samples from the line's start, their nearness, and which segments are surface."""
    q = delta[y, x]
    if tuple(direction) != (1, 1):  # rows, columns and the cells' own diagonals are edges of the grid
        return np.arange(len(q), dtype=float), q, _together(cut_ratio, q[:-1], q[1:])
    # The other diagonals pass a cell's lower triangle, the middle of its own diagonal, and its upper triangle.
    right, below = delta[y[:-1], x[:-1] + 1], delta[y[:-1] + 1, x[:-1]]
    knots, closed = np.empty(2 * len(q) - 1), np.empty(2 * len(q) - 2, bool)
    knots[::2], knots[1::2] = q, (right + below) / 2
    closed[::2], closed[1::2] = _together(cut_ratio, q[:-1], right, below), _together(cut_ratio, q[1:], right, below)
    return np.arange(len(knots)) / 2, knots, closed


def _together(cut_ratio: float, *samples: Array) -> Array:
    """Tell whether the samples of a triangle or an edge, given by nearness, are one surface."""
    with np.errstate(invalid="ignore"):
        return np.max(samples, axis=0) <= cut_ratio * np.min(samples, axis=0)  # a hole's nan is not


def _first_seen(s: Array, t: Array, q: Array, closed: Array, pixels: Array) -> tuple[Array, Array, Array]:
    """Each pixel's nearness and place of what its ray sees first, nan in holes; and whether it is on an end.

    The knots are at s in the source and at t in the target. A segment shows its front where both run the same way.
    """
    nothing = np.full(len(pixels), np.nan)
    if not len(closed):
        return nothing, nothing, np.zeros(len(pixels), bool)
    t0, t1, q0, q1 = t[:-1, None], t[1:, None], q[:-1, None], q[1:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        part = np.clip((pixels - t0) / (t1 - t0), 0, 1)
        met = closed[:, None] & (pixels >= np.minimum(t0, t1) - TOUCH) & (pixels <= np.maximum(t0, t1) + TOUCH)
        front = t1 > t0
        # At a fold a ray meets the front of one segment and the back of the next at once: it sees the front.
        there = np.where(met, (q0 + part * (q1 - q0)) * (1 + TOUCH * front), -np.inf)
    first, pixel = there.argmax(axis=0), np.arange(len(pixels))
    visible = met[first, pixel] & front[first, 0]
    part = part[first, pixel]
    seen = np.where(visible, q[first] + part * (q[first + 1] - q[first]), np.nan)
    place = np.where(visible, s[first] + part * (s[first + 1] - s[first]), np.nan)

    before, after = np.append(False, closed), np.append(closed, False)
    side = np.append(front[:, 0], False)
    turns = before & after & (np.roll(side, 1) != side)
    lone = ~before & ~after & np.isfinite(q)  # it may be a corner of a surface beside the line
    ends = np.flatnonzero((before != after) | turns | lone)
    close = np.abs(pixels[:, None] - t[ends]) <= NEAR_END
    hidden = there.max(axis=0)[:, None] > q[ends] * 1.001
    return seen, place, (close & ~hidden).any(axis=1)
