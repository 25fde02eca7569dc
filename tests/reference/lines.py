"""Exact sideways steps in float64: each epipolar line as the polyline of the surface along it.

Two cameras that share K and differ by a step along x, along y or (with square pixels) along a diagonal see each
other's lines of samples as lines of pixels. There the surface is a polyline between samples, and along the diagonal
that crosses the cells' own also their middles. A sample moves by focal length * step * nearness, nothing else changes.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.images import DepthImage
from tests.reference.warp import nearness

Array = NDArray[Any]

TOUCH = 1e-6  # pixels: float64 decides what a ray touches that passes a segment's very end


def sideways_reference(view: DepthImage, step: tuple[float, float], cut_ratio: float = np.inf) -> tuple[Array, Array]:
    """Depth (H, W) float64 that `view.camera.moved(*step, 0)` sees, nan in holes; and where a ray passes an end.

    Parameters
    ----------
    view : DepthImage
        Perspective; if the step is along a diagonal, with square pixels.
    step : (x, y)
        In scene units: one of them 0, or both of one length.
    cut_ratio : float
        Neighbours' depths that differ by more are torn apart.

    Returns
    -------
    depth : (H, W) float64
    on_end : (H, W) bool
        The ray of the pixel passes an end of the surface to within rounding: it may see it or not.
    """
    direction = np.sign(step).astype(int)
    direction = direction if direction[np.flatnonzero(direction)[0]] > 0 else -direction
    shift = float(np.dot(step, direction)) / np.abs(direction).sum() * view.camera.K[0, 0]
    if direction[0] == 0:
        shift = step[1] * view.camera.K[1, 1]
    delta = nearness(view)
    height, width = delta.shape
    seen, on_end = np.full(delta.shape, np.nan), np.zeros(delta.shape, bool)
    for y, x in _starts(width, height, direction):
        count = _length(width, height, x, y, direction)
        xs, ys = x + direction[0] * np.arange(count), y + direction[1] * np.arange(count)
        s, q, closed = _polyline(delta, xs, ys, direction, cut_ratio)
        nearest, ends = _first_seen(s - shift * q, q, closed, np.arange(count))
        seen[ys, xs], on_end[ys, xs] = 1 / nearest, ends
    return seen, on_end


def _starts(width: int, height: int, direction: Array) -> list[tuple[int, int]]:
    """(y, x) of the first sample of each line."""
    dx, dy = direction
    return [
        (y, x)
        for y in range(height)
        for x in range(width)
        if not (0 <= x - dx < width and 0 <= y - dy < height)
    ]


def _length(width: int, height: int, x: int, y: int, direction: Array) -> int:
    count = 0
    while 0 <= x < width and 0 <= y < height:
        x, y, count = x + direction[0], y + direction[1], count + 1
    return count


def _polyline(delta: Array, xs: Array, ys: Array, direction: Array, cut_ratio: float) -> tuple[Array, Array, Array]:
    """Positions and nearness of the line's knots, and which segments between them are surface."""
    q = delta[ys, xs]
    s = np.arange(len(q), dtype=float)
    if tuple(direction) != (1, 1):  # rows, columns and the cells' diagonals: edges of the grid
        return s, q, _together(cut_ratio, q[:-1], q[1:])
    right, below = delta[ys[:-1], xs[:-1] + 1], delta[ys[:-1] + 1, xs[:-1]]
    knots, places = np.empty(2 * len(q) - 1), np.arange(2 * len(q) - 1) / 2
    knots[::2], knots[1::2] = q, 0.5 * (right + below)
    closed = np.empty(2 * len(q) - 2, bool)
    closed[::2], closed[1::2] = _together(cut_ratio, q[:-1], right, below), _together(cut_ratio, q[1:], right, below)
    return places, knots, closed


def _together(cut_ratio: float, *samples: Array) -> Array:
    """Whether samples of nearness are one surface."""
    high, low = np.max(samples, axis=0), np.min(samples, axis=0)
    with np.errstate(invalid="ignore"):
        return (low > 0) & (high <= cut_ratio * low)


def _first_seen(t: Array, q: Array, closed: Array, pixels: Array) -> tuple[Array, Array]:
    """Nearness that each pixel sees first, nan where that is nothing or the surface's back; and where a ray passes an
    end of the surface."""
    t0, t1, q0, q1 = t[:-1, None], t[1:, None], q[:-1, None], q[1:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        part = np.clip((pixels - t0) / (t1 - t0), 0, 1)
        met = closed[:, None] & (pixels >= np.minimum(t0, t1) - TOUCH) & (pixels <= np.maximum(t0, t1) + TOUCH)
        there = np.where(met, q0 + part * (q1 - q0), -np.inf)
    if not len(there):
        return np.full(len(pixels), np.nan), np.zeros(len(pixels), bool)
    first = there.argmax(axis=0)
    found = there[first, np.arange(len(pixels))]
    front = (t1 > t0)[first, 0]
    before, after = np.append(False, closed), np.append(closed, False)
    turns = np.append(False, (t[1:-1] - t[:-2]) * (t[2:] - t[1:-1]) <= 0) if len(t) > 2 else np.array([False])
    ends = t[(before != after) | np.append(turns, False)[: len(t)]]
    on_end = (np.abs(pixels[:, None] - ends) <= 1e-3).any(axis=1)
    return np.where(np.isfinite(found) & front, found, np.nan), on_end
