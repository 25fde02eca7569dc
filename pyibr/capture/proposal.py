"""Frusta that cover a surface, proposed one by one: each sees most of the part that is still unseen.

The greedy search picks, from many candidates, the frustum that adds most. Unseen area counts by how finely the frustum
samples it, seen area by how much more finely than before. Candidates stand around the whole surface, and in front of
the places that are seen worst.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pyibr.capture.coverage import Mask, Surface, surface_of
from pyibr.capture.frusta import Frustum
from pyibr.capture.raycast import spread_directions
from pyibr.core.checks import Float64, instance_of, integer_from
from pyibr.core.errors import ArgumentError
from pyibr.images.depth_image import Side
from pyibr.meshes.mesh import Mesh

_AROUND = 64  # candidates that see the whole surface from outside
_WORST = 0.1  # fraction of the points, the worst seen, that get candidates once all points are seen
_ANCHORS = 12  # points per round that get candidates in front of them
_DISTANCES = (0.12, 0.3, 0.7)  # distances of these candidates from their points, in radii of the mesh
_APERTURES = (60.0, 60.0, 50.0)  # angles of view of these candidates, in degrees, for each distance
_PROBE = 128  # size in pixels of the images that measure what a candidate sees
_FAR = 1.02  # far plane, in depths of the farthest point that a frustum shows
_MARGIN = 1.06  # factor that widens the angles of view around the points that a frustum shows
_SEEN = 0.7  # worth of seeing a point at all; the rest rewards resolution. Lower values leave more unseen

Progress = Callable[[int, int, float], None]
"""(frusta so far, number wanted, fraction of the surface that no frustum sees)"""


@dataclass(frozen=True)
class _Candidate:
    """A frustum, and the worth of its image for each point of the surface: 1 if fine, 0 if unseen."""

    frustum: Frustum
    worth: NDArray[np.float32]


def propose_frusta(
    mesh: Mesh,
    count: int,
    size: int = 256,
    *,
    known: Sequence[Frustum] = (),
    side: Side = "front",
    surface: Surface | None = None,
    progress: Progress | None = None,
) -> list[Frustum]:
    """Propose frusta that together see as much of a mesh as can be seen from outside.

    Parameters
    ----------
    mesh : Mesh
    count : int
        Maximum number of frusta; fewer, if no further frustum adds anything.
    size : int
        Width and height of their images in pixels.
    known : sequence of Frustum
        Existing frusta; the points that they see count as seen.
    side : {"front", "back", "both"}
        Side of the triangles that counts as seen.
    surface : Surface, optional
        `surface_of(mesh)`, if already computed, or the part of the mesh to cover.
    progress : callable, optional
        Called after each frustum; an exception that it raises ends the search.

    Returns
    -------
    list of Frustum

    Examples
    --------
    >>> from pyibr.capture import models
    >>> from pyibr.capture.proposal import propose_frusta
    >>> frusta = propose_frusta(models.donut(), 4, 64)
    >>> len(frusta)
    4
    """
    integer_from("count", count, 1, 1024)
    integer_from("size", size, 2, 1 << 14)
    instance_of("mesh", mesh, Mesh, "a pyibr.Mesh")
    search = _Search(surface or surface_of(mesh), count, size, side)
    for frustum in known:
        search.take(search.candidate(frustum))
    search.look_around()
    made: list[Frustum] = []
    while len(made) < count:
        search.look_closer()
        best = search.best()
        if best is None:
            break
        made.append(search.fitted(best))
        search.take(best)
        if progress is not None:
            progress(len(made), count, search.unseen)
    return made


class _Search:
    def __init__(self, surface: Surface, count: int, size: int, side: Side) -> None:
        self._surface, self._size = surface, size
        self._side: Side = side
        self._outer: Mask = surface.outer
        self._best = np.where(self._outer, 0, 1).astype(np.float32)  # worth of the images so far, for each point
        self._candidates: list[_Candidate] = []
        self._random = np.random.default_rng(1999)
        low, high = surface.bounds
        self._middle, self._radius = 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low))
        # Density of pixels if each image showed another part of the surface and were full.
        self._goal = count * size**2 / surface.area

    @property
    def unseen(self) -> float:
        """Fraction of the visible points that no frustum sees yet."""
        return float(np.count_nonzero(self._best == 0) / max(np.count_nonzero(self._outer), 1))

    def candidate(self, frustum: Frustum) -> _Candidate:
        """Return a frustum as a candidate, with the worth of its image for each point."""
        view = frustum.resized(_PROBE).capture(self._surface.mesh)
        finer = (self._size / _PROBE) ** 2
        dense = self._surface.resolution(view, side=self._side)
        fine = np.sqrt(np.minimum(dense * np.float32(finer / self._goal), 1))  # square root: pixels along a line
        return _Candidate(frustum, np.where(dense > 0, np.float32(_SEEN) + np.float32(1 - _SEEN) * fine, np.float32(0)))

    def look_around(self) -> None:
        """Add candidates that see the whole surface."""
        angle = 2 * math.degrees(math.asin(1 / 2.2))
        for direction in spread_directions(_AROUND):
            self._add(self._middle + 2.2 * self._radius * direction, self._middle, angle)

    def look_closer(self) -> None:
        """Add candidates in front of points that are unseen, or seen worst."""
        places = np.flatnonzero(self._best <= max(np.quantile(self._best[self._outer], _WORST), 0))
        for place in self._random.choice(places, min(_ANCHORS, len(places)), replace=False):
            point, normal = self._surface.points[place], self._surface.normals[place]
            normal = -normal if self._side == "back" else normal
            for distance, angle in zip(_DISTANCES, _APERTURES, strict=True):
                aside = 0.35 * self._random.normal(size=3)  # the view straight onto a point may be occluded
                way = normal + aside - (aside @ normal) * normal
                self._add(point + distance * self._radius * way / np.linalg.norm(way), point, angle)

    def _add(self, eye: Float64, target: Float64, angle: float) -> None:
        up = np.eye(3)[np.abs(target - eye).argmin()]
        try:
            self._candidates.append(self.candidate(Frustum.look_at(eye, target, up, self._size, fov=angle)))
        except ArgumentError:  # too near or far for single precision
            return

    def best(self) -> _Candidate | None:
        """Return the candidate that adds most; None if none adds anything."""
        gains = [float(np.maximum(one.worth - self._best, 0).sum(dtype=np.float64)) for one in self._candidates]
        number = int(np.argmax(gains))
        return self._candidates[number] if gains[number] > 0 else None

    def take(self, one: _Candidate) -> None:
        """Count the points that a candidate sees as seen."""
        self._best = np.maximum(self._best, one.worth)
        self._candidates = [other for other in self._candidates if other is not one]

    def fitted(self, one: _Candidate) -> Frustum:
        """Return a candidate's frustum, no wider and no deeper than its additional points need."""
        camera = one.frustum.camera
        new = one.worth > self._best
        pixels, depth = camera.project(self._surface.points[new])
        half = np.abs((pixels - camera.K[:2, 2]) / np.diag(camera.K)[:2]).max(axis=0) * _MARGIN
        across, down = (
            min(2 * math.degrees(math.atan(one)), fov) for one, fov in zip(half, one.frustum.fov, strict=True)
        )
        return one.frustum.opened(max(across, 1.0), max(down, 1.0), float(depth.max()) * _FAR)
