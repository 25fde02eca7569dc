"""Margins of a depth image's surface in NumPy: they cover the parts of samples' pixels that no triangle covers.

This is the readable form of `kernels/warp/margins.cl`. An open triangle, one with a torn edge, is divided among its
three corners; each corner's margin covers the part nearest to it. In the pixel of the sample at the triangle's right
angle, the part is a quarter of the pixel. In the pixels of the other two it is half of a quarter, on one side of the
cell's diagonal.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.images import DepthImage
from tests.reference.edges import STEEP_MAX, STEEPEST, Edges

Array = NDArray[Any]

LOWER, UPPER = 1, 2
QUARTERS = ((-1, -1), (1, -1), (-1, 1), (1, 1))


@dataclass(frozen=True)
class Margins:
    """n margins; each lies in one quarter of a sample's pixel."""

    x: Array  #: (n,) pixel of the sample; y likewise
    y: Array
    to_x: Array  #: -1 or 1: direction of the quarter along x; `to_y` along y
    to_y: Array
    parts: Array  #: LOWER, UPPER or both (3): the sides of the cell's diagonal that are covered
    q: Array  #: nearness at the sample
    gu: Array  #: change of nearness per pixel in x; `gv` in y
    gv: Array
    color: Array  #: (n, 3, c) colour of the sample, and its change per pixel in x and in y

    @cached_property
    def planes(self) -> Array:
        """Planes (n, 4) in homogeneous pixel space: plane . point = W * (the margin's nearness - the point's)."""
        level = self.q - self.gu * self.x - self.gv * self.y
        return np.stack([self.gu, self.gv, level, -np.ones(len(self.x))], axis=-1)

    def some(self, which: Array) -> Margins:
        """Select margins by `which`, (n,) bool."""
        return Margins(*(getattr(self, one.name)[which] for one in fields(self)))

    def hits(self, epipole: Array, infinity: Array, grown: float = 0.0) -> Array:
        """Return t, (..., n), where rays epipole + t * infinity meet each margin; inf where they do not.

        Both points, (4,) and (..., 4), are in homogeneous pixel space. Margins are enlarged by `grown` pixels.
        """
        with np.errstate(all="ignore"):
            t = -(self.planes @ epipole) / (infinity @ self.planes.T)
            x, y, w = (epipole[i] + t * infinity[..., None, i] for i in range(3))
            du, dv = x / w - self.x, y / w - self.y
            inside = (np.abs(du * self.to_x - 0.25) <= 0.25 + grown) & (np.abs(dv * self.to_y - 0.25) <= 0.25 + grown)
            inside &= ((self.parts & LOWER > 0) & (du + dv <= grown)) | ((self.parts & UPPER > 0) & (du + dv >= -grown))
        return np.where(inside & (w > 0), t, np.inf)

    def first_hit(self, epipole: Array, infinity: Array, low: float, high: float) -> tuple[float, int]:
        """Return the least t in [low, high] at which a ray meets a margin, and the margin's index; -1 if none."""
        t = self.hits(epipole, infinity)
        t = np.where((t >= low) & (t <= high), t, np.inf)
        return (float(t.min()), int(t.argmin())) if np.isfinite(t).any() else (np.inf, -1)

    def corners(self) -> tuple[Array, Array, Array, Array]:
        """Margins as triangles: pixels (m, 2), nearness (m,), colours (m, c) and faces (k, 3)."""
        out = {LOWER: [], UPPER: []}
        for number, (tx, ty) in enumerate(zip(self.to_x, self.to_y, strict=True)):
            square = np.array([[0, 0], [tx, 0], [tx, ty], [0, ty]]) / 2.0
            for part, sign in ((LOWER, -1), (UPPER, 1)):
                if tx == ty or not self.parts[number] & part:
                    continue
                kept = square[(square.sum(axis=1) * sign) >= 0]
                out[part].append((number, kept))
            if tx == ty:
                out[LOWER] += [(number, square[[0, 1, 2]]), (number, square[[0, 2, 3]])]
        three = out[LOWER] + out[UPPER]
        numbers = np.array([number for number, _ in three], int)
        offsets = np.array([corners for _, corners in three]).reshape(-1, 3, 2)
        at = np.stack([self.x, self.y], axis=-1)[numbers, None] + offsets
        du, dv = offsets[..., 0], offsets[..., 1]
        near = self.q[numbers, None] + self.gu[numbers, None] * du + self.gv[numbers, None] * dv
        own, along_x, along_y = (self.color[numbers, i][:, None] for i in range(3))
        colors = own + along_x * du[..., None] + along_y * dv[..., None]
        count = self.color.shape[-1]
        return at.reshape(-1, 2), near.ravel(), colors.reshape(-1, count), np.arange(3 * len(numbers)).reshape(-1, 3)


def steepest_margins(view: DepthImage, q: Array) -> tuple[Array, Array]:
    """Change of nearness per pixel, in x and in y, on the steepest surface that counts as facing the camera."""
    fx, fy = view.camera.K[0, 0], view.camera.K[1, 1]
    if view.camera.projection == "orthographic":
        return STEEPEST / fx * np.ones_like(q), STEEPEST / fy * np.ones_like(q)
    return min(STEEPEST / fx, STEEP_MAX) * q, min(STEEPEST / fy, STEEP_MAX) * q


def margins_of(view: DepthImage, ring: Array, torn: Edges) -> Margins:
    """Return the margins of a view from its nearness and edges, which `with_ring` returns."""
    height, width = view.depth.shape
    q = ring[1:-1, 1:-1]

    def at(values: Array, dx: int, dy: int) -> Array:
        return values[1 + dy : height + 1 + dy, 1 + dx : width + 1 + dx]

    def lower(dx: int, dy: int) -> Array:
        return at(torn.right, dx, dy) | at(torn.below, dx, dy) | at(torn.diagonal, dx, dy)

    def upper(dx: int, dy: int) -> Array:
        """True if the upper triangle is open in the cell whose upper left sample is at (dx, dy); `lower` likewise."""
        return at(torn.right, dx, dy + 1) | at(torn.below, dx + 1, dy) | at(torn.diagonal, dx, dy)

    open_parts = {
        (-1, -1): (upper(-1, -1), upper(-1, -1)),
        (1, -1): (lower(0, -1), upper(0, -1)),
        (-1, 1): (lower(-1, 0), upper(-1, 0)),
        (1, 1): (lower(0, 0), lower(0, 0)),
    }
    torn_to = {
        (-1, 0): at(torn.right, -1, 0),
        (1, 0): at(torn.right, 0, 0),
        (0, -1): at(torn.below, 0, -1),
        (0, 1): at(torn.below, 0, 0),
    }
    image = np.pad(view.color, ((1, 1), (1, 1), (0, 0)), mode="edge").astype(np.float64)

    def slope(dx: int, dy: int) -> Array:
        """Change of nearness towards the neighbour at (dx, dy), per pixel in x or y; 0 if it is torn from it."""
        sign = dx + dy
        return np.where(torn_to[dx, dy], 0.0, (at(ring, dx, dy) - q) * sign)

    found = list[tuple[Array, ...]]()
    for tx, ty in QUARTERS:
        low, high = open_parts[tx, ty]
        most_x, most_y = steepest_margins(view, q)
        gu, gv = np.clip(slope(tx, 0), -most_x, most_x), np.clip(slope(0, ty), -most_y, most_y)
        if (tx, ty) == (1, -1):  # touches both triangles of a cell; if only one is open, its plane continues
            planes = (
                (high & ~low, at(ring, 1, -1) - at(ring, 0, -1), q - at(ring, 0, -1)),
                (low & ~high, at(ring, 1, 0) - q, at(ring, 1, 0) - at(ring, 1, -1)),
            )
        elif (tx, ty) == (-1, 1):
            planes = (
                (high & ~low, q - at(ring, -1, 0), at(ring, -1, 1) - at(ring, -1, 0)),
                (low & ~high, at(ring, 0, 1) - at(ring, -1, 1), at(ring, 0, 1) - q),
            )
        else:
            planes = ()
        for where, pu, pv in planes:
            gu, gv = np.where(where, pu, gu), np.where(where, pv, gv)
        y, x = np.nonzero((low | high) & ~np.isnan(q))
        own = at(image, 0, 0)
        change_x = np.where(torn_to[tx, 0][..., None], 0.0, (at(image, tx, 0) - own) * tx)
        change_y = np.where(torn_to[0, ty][..., None], 0.0, (at(image, 0, ty) - own) * ty)
        parts = (LOWER * low + UPPER * high)[y, x]
        color = np.stack([own, change_x, change_y], axis=2)[y, x]
        found.append((x, y, np.full(len(x), tx), np.full(len(x), ty), parts, q[y, x], gu[y, x], gv[y, x], color))
    return Margins(*(np.concatenate(values) for values in zip(*found, strict=True)))
