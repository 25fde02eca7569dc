"""Exact views after sideways steps, in float64: along each epipolar line, the surface is a polyline.

Two cameras with one K differ by a step along x, along y or, with square pixels, along a diagonal. Then each row, column
or diagonal of samples in the source appears as a line of pixels in the target. Along it the surface is a polyline with
a knot at each sample. Diagonals that cross the diagonals along which cells are split have a knot in the middle of each
cell, too. Between the cameras, a sample moves along its line by focal length * step * nearness and keeps its nearness.
On each ray, the greatest nearness is visible.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.images import DepthImage
from tests.reference.edges import Edges, edges_of, with_ring
from tests.reference.margins import Margins, margins_of

Array = NDArray[Any]

TOUCH = 1e-6  # pixels by which both ends of a segment are extended, so that rounding opens no gaps
NEAR_END = 1e-3  # pixels: rays closer than this to an end of the surface may hit or miss it


@dataclass
class Sideways:
    """Picture of the camera after a sideways step."""

    depth: Array  #: (H, W) float64, nan in holes
    source: Array  #: (H, W, 2) source pixel (x, y) of the visible point, nan in holes
    on_end: Array  #: (H, W) bool: the ray passes a visible end of the surface, a fold or a lone sample


def sideways_reference(view: DepthImage, step: tuple[float, float], edges: str = "connect") -> Sideways:
    """Return the picture of a view from the camera `view.camera.moved(*step, 0)`; `edges` as for `WarpedView`.

    The view must be perspective. One component of the step is 0 or, with square pixels, both are equally long.
    """
    height, width = view.depth.shape
    ring, torn = with_ring(view, edges_of(view, edges))
    margins = margins_of(view, ring, torn)
    direction = np.sign(step).astype(int)
    if direction[np.flatnonzero(direction)[0]] < 0:
        direction = -direction
    axis = 0 if direction[0] else 1
    shift = view.camera.K[axis, axis] * step[axis]  # pixels along the line, for nearness 1
    size = height, width
    result = Sideways(np.full(size, np.nan), np.full((*size, 2), np.nan), np.zeros(size, bool))
    epipole = np.append(np.diag(view.camera.K)[:2] * step, [0.0, 1.0])
    across = np.array([-direction[1], direction[0]])
    for start in _starts(width, height, direction):
        pixels = np.arange(_length(width, height, start, direction))
        x, y = (start + pixels[:, None] * direction).T
        s, q, closed = _polyline(ring, torn, x, y, direction)
        seen, place, result.on_end[y, x] = _first_seen(s, s - shift * q, q, closed, pixels)
        result.depth[y, x] = 1 / seen
        result.source[y, x] = start + place[:, None] * direction
        away = np.abs((np.stack([margins.x, margins.y], axis=-1) - start) @ across)
        beside = away <= np.abs(across).sum() * (0.5 + NEAR_END)  # margins extend half a pixel
        _see_margins(result, margins.some(beside), epipole, x, y)
    return result


def _see_margins(result: Sideways, margins: Margins, epipole: Array, x: Array, y: Array) -> None:
    """Add to the result the margins that a line's rays meet before anything else."""
    if not len(margins.x):
        return
    infinity = np.stack([x, y, np.ones(len(x)), np.zeros(len(x))], axis=-1)
    seen = np.nan_to_num(result.depth[y, x], nan=np.inf)

    def hits(grown: float) -> Array:
        t = margins.hits(epipole, infinity, grown)
        return np.where(t >= 0, t, np.inf)

    around = np.stack([hits(grown).min(axis=1) for grown in (NEAR_END, -NEAR_END)])
    result.on_end[y, x] |= (around.min(axis=0) < seen) & ~np.isclose(*around, rtol=1e-5)
    every = hits(0.0)
    t, number = every.min(axis=1), every.argmin(axis=1)
    met = t < seen
    x, y, t, infinity = x[met], y[met], t[met, None], infinity[met]
    front = (margins.planes[number[met]] * infinity).sum(axis=1) > 0
    point = epipole + t * infinity
    result.depth[y, x] = np.where(front, t[:, 0], np.nan)
    result.source[y, x] = np.where(front[:, None], point[:, :2] / point[:, 2:3], np.nan)


def _starts(width: int, height: int, direction: Array) -> list[Array]:
    """First sample (x, y) of each line."""
    samples = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).reshape(-1, 2)
    before = samples - direction
    inside = (before >= 0).all(axis=1) & (before < [width, height]).all(axis=1)
    return list(samples[~inside])


def _length(width: int, height: int, start: Array, direction: Array) -> int:
    """Number of samples of a line, from the first to the image's border."""
    left = np.where(direction > 0, np.subtract([width, height], start), np.add(start, 1))
    return int(left[direction != 0].min())


def _polyline(ring: Array, torn: Edges, x: Array, y: Array, direction: Array) -> tuple[Array, Array, Array]:
    """Positions of a line's knots, in samples from its start, their nearness, and which segments are surface.

    The line also covers half a pixel beyond its first and its last sample.
    """
    dx, dy = direction
    x, y = (1 + np.concatenate([a[:1] - d, a, a[-1:] + d]) for a, d in ((x, dx), (y, dy)))  # indices in the ring
    q, x, y = ring[y, x], x[:-1], y[:-1]
    places = np.arange(-1.0, len(q) - 1)
    if (dx, dy) != (1, 1):  # the line runs along edges of the grid
        closed = ~(torn.diagonal[y - 1, x] if dx and dy else torn.right[y, x] if dx else torn.below[y, x])
        places[0], places[-1] = -0.5, len(q) - 2.5
        q[0], q[-1] = (q[0] + q[1]) / 2, (q[-2] + q[-1]) / 2
        return places, q, closed
    # In each cell, the line crosses the lower triangle, the middle of the diagonal, and the upper triangle.
    right, below = ring[y, x + 1], ring[y + 1, x]
    knots, closed = np.empty(2 * len(q) - 1), np.empty(2 * len(q) - 2, bool)
    knots[::2], knots[1::2] = q, (right + below) / 2
    closed[::2] = ~(torn.right[y, x] | torn.below[y, x] | torn.diagonal[y, x])
    closed[1::2] = ~(torn.right[y + 1, x] | torn.below[y, x + 1] | torn.diagonal[y, x])
    return np.arange(-1, len(q) - 1.5, 0.5)[1:-1], knots[1:-1], closed[1:-1]


def _first_seen(s: Array, t: Array, q: Array, closed: Array, pixels: Array) -> tuple[Array, Array, Array]:
    """Nearness and source position of the first surface on each pixel's ray, nan in holes, and which rays pass an end.

    Knots have the positions s in the source and t in the target. A segment shows its front if t grows with s.
    """
    nothing = np.full(len(pixels), np.nan)
    if not len(closed):
        return nothing, nothing, np.zeros(len(pixels), bool)
    t0, t1, q0, q1 = t[:-1, None], t[1:, None], q[:-1, None], q[1:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        part = np.clip((pixels - t0) / (t1 - t0), 0, 1)
        met = closed[:, None] & (pixels >= np.minimum(t0, t1) - TOUCH) & (pixels <= np.maximum(t0, t1) + TOUCH)
        front = t1 > t0
        # At a fold, a ray meets the front of one segment and the back of the next at one depth: the front wins.
        there = np.where(met, (q0 + part * (q1 - q0)) * (1 + TOUCH * front), -np.inf)
    first, pixel = there.argmax(axis=0), np.arange(len(pixels))
    visible = met[first, pixel] & front[first, 0]
    part = part[first, pixel]
    seen = np.where(visible, q[first] + part * (q[first + 1] - q[first]), np.nan)
    place = np.where(visible, s[first] + part * (s[first + 1] - s[first]), np.nan)

    before, after = np.append(False, closed), np.append(closed, False)
    side = np.append(front[:, 0], False)
    turns = before & after & (np.roll(side, 1) != side)
    lone = ~before & ~after & np.isfinite(q)  # perhaps the corner of a surface beside the line
    ends = np.flatnonzero((before != after) | turns | lone)
    close = np.abs(pixels[:, None] - t[ends]) <= NEAR_END
    hidden = there.max(axis=0)[:, None] > q[ends] * 1.001
    return seen, place, (close & ~hidden).any(axis=1)
