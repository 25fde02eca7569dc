"""Solids, sheets and reliefs with exact ray hits, and the truth whether neighbouring samples are one surface.

A ray is origin + t * direction. The direction's z is 1 in the camera's axes, so that t is the planar depth.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

import pyibr as ibr

Array = NDArray[Any]

NEAREST = 0.05  # metres: hits at a smaller depth do not count
UNJUDGED, ONE_SURFACE, TWO_SURFACES = 0, 1, 2
_SEAM = 1e-4  # relative to the depth: smaller jumps are rounding, or the step that is left after all halvings
_JUMP = 2e-3  # relative to the depth: from _SEAM to here nothing is judged, since smooth surfaces bend as much
_STEPS = 32  # steps between two pixels; parts thinner than a step may be missed
_CHANGES = 4  # maximum number of places within a step where a ray passes from one part to another
_HALVINGS = 25  # per step; within the rest, the depth of a ball of 1 m at 3 m changes by less than _SEAM


class Rays(NamedTuple):
    """Rays of a camera."""

    origin: Array
    direction: Array

    @classmethod
    def of(cls, camera: ibr.Camera, u: Array, v: Array) -> Rays:
        """Rays through the pixels (u, v)."""
        K = camera.K
        x, y = (u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1]
        zero, one = np.zeros_like(x), np.ones_like(x)
        if camera.projection == "perspective":
            origin, direction = np.zeros((x.size, 3)), np.stack([x, y, one], -1)
        else:
            origin, direction = np.stack([x, y, zero], -1), np.stack([zero, zero, one], -1)
        turn, eye = camera.world_from_camera[:3, :3], camera.world_from_camera[:3, 3]
        return cls(origin @ turn.T + eye, direction @ turn.T)


class Part(Protocol):
    """A body whose depth changes continuously between neighbouring rays that hit it."""

    def depth(self, rays: Rays) -> Array:
        """Planar depth (N,), infinite for rays without a hit."""
        ...


Thing = Sequence[Part]
"""An object: parts that form one body."""


@dataclass(frozen=True)
class Polytope:
    """The points p with normals @ p <= offsets; or, if hollow, a cavity of this shape, seen from inside."""

    normals: Array
    offsets: Array
    hollow: bool = False

    def depth(self, rays: Rays) -> Array:
        """As `Part.depth`."""
        enter, leave = np.full(len(rays.origin), -np.inf), np.full(len(rays.origin), np.inf)
        for normal, offset in zip(self.normals, self.offsets, strict=True):
            rate, distance = rays.direction @ normal, offset - rays.origin @ normal
            with np.errstate(divide="ignore", invalid="ignore"):
                t = distance / rate
            enter = np.where(rate < 0, np.maximum(enter, t), enter)
            leave = np.where(rate > 0, np.minimum(leave, t), leave)
            leave[(rate == 0) & (distance < 0)] = -np.inf
        if self.hollow:
            return np.where(leave > NEAREST, leave, np.inf)
        return np.where((enter <= leave) & (enter > NEAREST), enter, np.inf)


@dataclass(frozen=True)
class Ball:
    """A ball."""

    center: Array
    radius: float

    def depth(self, rays: Rays) -> Array:
        """As `Part.depth`."""
        return _first(*_roots(rays.origin - self.center, rays.direction, self.radius))


@dataclass(frozen=True)
class Rod:
    """A cylinder from `start` to `end`, with flat or round ends."""

    start: Array
    end: Array
    radius: float
    round_ends: bool = False

    def depth(self, rays: Rays) -> Array:
        """As `Part.depth`."""
        middle, reach = (self.start + self.end) / 2, np.linalg.norm(self.end - self.start) / 2 + self.radius
        found, near = np.full(len(rays.origin), np.inf), _passing(rays, middle, float(reach))
        found[near] = self._depth(Rays(rays.origin[near], rays.direction[near]))
        return found

    def _depth(self, rays: Rays) -> Array:
        length = float(np.linalg.norm(self.end - self.start))
        axis, offset = (self.end - self.start) / length, rays.origin - self.start
        along, rate = offset @ axis, rays.direction @ axis
        enter, leave = _roots(offset - along[:, None] * axis, rays.direction - rate[:, None] * axis, self.radius)
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = np.stack([-along / rate, (length - along) / rate])
        level = np.where((along >= 0) & (along <= length), np.inf, -np.inf)  # for rays at right angles to the axis
        first = np.where(rate == 0, -level, ends.min(0))
        last = np.where(rate == 0, level, ends.max(0))
        found = _first(np.maximum(enter, first), np.minimum(leave, last))
        if not self.round_ends:
            return found
        return np.minimum(found, np.minimum(*(Ball(end, self.radius).depth(rays) for end in (self.start, self.end))))


@dataclass(frozen=True)
class Cone:
    """A cone with a flat base."""

    apex: Array
    base: Array
    radius: float

    def depth(self, rays: Rays) -> Array:
        """As `Part.depth`."""
        height = float(np.linalg.norm(self.base - self.apex))
        axis, slope = (self.base - self.apex) / height, self.radius / height
        offset = rays.origin - self.apex
        along, rate = offset @ axis, rays.direction @ axis
        side, turn = offset - along[:, None] * axis, rays.direction - rate[:, None] * axis
        a = (turn * turn).sum(1) - (slope * rate) ** 2
        b = (side * turn).sum(1) - slope**2 * along * rate
        c = (side * side).sum(1) - (slope * along) ** 2
        with np.errstate(divide="ignore", invalid="ignore"):
            root = np.sqrt(b * b - a * c)
            hits = [(-b - root) / a, (-b + root) / a]
            lid = (height - along) / rate
            heights = [along + t * rate for t in hits]
            on_lid = np.linalg.norm(side + lid[:, None] * turn, axis=1) <= self.radius
            valid = [(h >= 0) & (h <= height) for h in heights]
        return np.minimum.reduce(
            [np.where(ok & (t > NEAREST), t, np.inf) for t, ok in zip([*hits, lid], [*valid, on_lid], strict=True)]
        )


@dataclass(frozen=True)
class Sheet:
    """A flat ellipse with the half axes `along` and `across`; or a blade, whose tip is at `along` from `center`."""

    center: Array
    along: Array
    across: Array
    blade: bool = False

    def depth(self, rays: Rays) -> Array:
        """As `Part.depth`."""
        normal = np.cross(self.along, self.across)
        with np.errstate(divide="ignore", invalid="ignore"):
            t = ((self.center - rays.origin) @ normal) / (rays.direction @ normal)
            point = rays.origin + t[:, None] * rays.direction - self.center
            a, b = (point @ axis / (axis @ axis) for axis in (self.along, self.across))
            inside = (a >= 0) & (np.abs(b) <= 1 - a) if self.blade else a * a + b * b <= 1
        return np.where(inside & (t > NEAREST), t, np.inf)


@dataclass(frozen=True)
class Squares:
    """The squares of one colour of a plane chequerboard; the others are empty. Pixels must be smaller than squares."""

    center: Array
    axes: Array
    side: float

    def depth(self, rays: Rays) -> Array:
        """As `Part.depth`; the rows of `axes` are the directions of the squares' sides and of the plane's normal."""
        along, across, normal = self.axes
        with np.errstate(divide="ignore", invalid="ignore"):
            t = ((self.center - rays.origin) @ normal) / (rays.direction @ normal)
            point = rays.origin + t[:, None] * rays.direction - self.center
            square = np.floor(point @ along / self.side) + np.floor(point @ across / self.side)
        return np.where((square % 2 == 1) & (t > NEAREST), t, np.inf)


@dataclass(frozen=True)
class Relief:
    """A smooth surface, given by its depth in each direction (x/z, y/z) from a camera at the origin."""

    shape: Callable[[Array, Array], Array]

    def depth(self, rays: Rays) -> Array:
        """As `Part.depth`."""
        return self.shape(*rays.direction.T[:2])


def _passing(rays: Rays, center: Array, reach: float) -> Array:
    """Find the rays that pass `center` within `reach`; only these need the exact test."""
    offset = center - rays.origin
    along = np.einsum("ij,ij->i", offset, rays.direction) ** 2 / np.einsum("ij,ij->i", rays.direction, rays.direction)
    return np.einsum("ij,ij->i", offset, offset) - along <= reach * reach * (1 + 1e-9)


def _roots(offset: Array, direction: Array, radius: float) -> tuple[Array, Array]:
    """Solve |offset + t direction| = radius for both t; NaN without a solution."""
    a, b, c = (direction**2).sum(1), (offset * direction).sum(1), (offset**2).sum(1) - radius**2
    with np.errstate(divide="ignore", invalid="ignore"):
        root = np.sqrt(b * b - a * c)
        return (-b - root) / a, (-b + root) / a


def _first(enter: Array, leave: Array) -> Array:
    return np.where((enter <= leave) & (enter > NEAREST), enter, np.inf)


def box(low: ArrayLike, high: ArrayLike, turn: Array | None = None, hollow: bool = False) -> Polytope:
    """The box between two corners, turned about its centre by a rotation matrix."""
    low, high = np.asarray(low, float), np.asarray(high, float)
    normals = np.vstack([np.eye(3), -np.eye(3)]) @ (np.eye(3) if turn is None else turn.T)
    offsets = normals @ ((low + high) / 2) + np.tile((high - low) / 2, 2)
    return Polytope(normals, offsets, hollow)


def cast(things: Sequence[Thing], rays: Rays) -> tuple[Array, Array]:
    """Depth (N,), infinite without a hit, and the index of the hit part among all parts of all things, or -1."""
    depth, part = np.full(len(rays.origin), np.inf), np.full(len(rays.origin), -1)
    for index, one in enumerate(one for thing in things for one in thing):
        found = one.depth(rays)
        nearer = found < depth
        depth, part = np.where(nearer, found, depth), np.where(nearer, index, part)
    return depth, part


def sampled(things: Sequence[Thing], camera: ibr.Camera) -> tuple[Array, Array, Array]:
    """Cast a ray for each sample, and judge whether it and its right and lower neighbours are one surface.

    Returns
    -------
    depth : float64 (H, W)
        NaN without a hit.
    right : int8 (H, W - 1)
        UNJUDGED, ONE_SURFACE or TWO_SURFACES.
    below : int8 (H - 1, W)
    """
    width, height = camera.size
    v, u = np.mgrid[:height, :width].astype(float)
    depth, part = (a.reshape(height, width) for a in cast(things, Rays.of(camera, u.ravel(), v.ravel())))
    pairs: list[Array] = []
    for across in (True, False):
        first, second = (np.s_[:, :-1], np.s_[:, 1:]) if across else (np.s_[:-1], np.s_[1:])
        a, b = part[first], part[second]
        joined = np.where((a < 0) | (b < 0), UNJUDGED, ONE_SURFACE).astype(np.int8)
        differ = (a != b) & (joined != UNJUDGED)
        ends = np.stack([np.stack([u[at][differ], v[at][differ]], -1) for at in (first, second)])
        joined[differ] = _joined(things, camera, a[differ], b[differ], ends)
        near, far = np.minimum(depth[first], depth[second]), np.maximum(depth[first], depth[second])
        # A gap narrower than a pixel, between samples of equal depth, cannot be seen in the image.
        joined[(joined == TWO_SURFACES) & (far < (1 + _JUMP) * near)] = UNJUDGED
        pairs.append(joined)
    return np.where(part < 0, np.nan, depth), pairs[0], pairs[1]


def _joined(things: Sequence[Thing], camera: ibr.Camera, a: Array, b: Array, ends: Array) -> Array:
    """Classify pairs of samples on the parts a and b: one surface, two surfaces, or undecided.

    Rays are cast at the pair's objects alone, so that no third object hides the place where they meet.
    """
    thing = np.repeat(np.arange(len(things)), [len(each) for each in things])
    joined = np.empty(len(a), np.int8)
    keys = np.sort(np.stack([thing[a], thing[b]], -1), -1)
    for key in np.unique(keys, axis=0):
        at = (keys == key).all(1)
        jump = _largest_jump([things[index] for index in np.unique(key)], camera, ends[:, at])
        joined[at] = np.select([jump < _SEAM, jump > _JUMP], [ONE_SURFACE, TWO_SURFACES], UNJUDGED)
    return joined


def _largest_jump(things: Sequence[Thing], camera: ibr.Camera, ends: Array) -> Array:
    """Find the largest jump of the surface between two pixels (2, N, 2), relative to its depth.

    The depth can jump only where rays pass from one part to another. Each such place is found by halving the step, up
    to `_CHANGES` places in a step.
    """
    pixels = ends[0] + (ends[1] - ends[0]) * np.linspace(0, 1, _STEPS + 1)[:, None, None]
    depth, part = _cast_at(things, camera, pixels)
    step, pair = np.nonzero(part[1:] != part[:-1])
    low, end, before, left = pixels[step, pair], pixels[step + 1, pair], depth[step, pair], part[step, pair]
    jump = np.zeros(ends.shape[1])
    for _ in range(_CHANGES):
        high, (after, right) = end, _cast_at(things, camera, end)
        is_open = left != right
        if not is_open.any():
            break
        pair, end, low, high, before, after, left, right = (
            values[is_open] for values in (pair, end, low, high, before, after, left, right)
        )
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            found, at = _cast_at(things, camera, middle)
            same = at == left
            low, before = np.where(same[:, None], middle, low), np.where(same, found, before)
            high, after = np.where(same[:, None], high, middle), np.where(same, after, found)
            right = np.where(same, right, at)
        with np.errstate(invalid="ignore"):
            jumps = np.abs(after - before) / np.minimum(after, before)
        np.maximum.at(jump, pair, np.where(np.isfinite(jumps), jumps, np.inf))  # a gap counts as an infinite jump
        low, before, left = high, after, right
    return jump


def _cast_at(things: Sequence[Thing], camera: ibr.Camera, pixels: Array) -> tuple[Array, Array]:
    depth, part = cast(things, Rays.of(camera, *pixels.reshape(-1, 2).T))
    return depth.reshape(pixels.shape[:-1]), part.reshape(pixels.shape[:-1])
