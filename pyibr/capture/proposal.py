"""Frusta that cover a surface, proposed one after the other: each sees most of what is still unseen.

A greedy cover: of many candidates the one is taken that adds most, unseen area by how finely it samples that, and seen
area by how much more finely. Candidates stand around the whole, and before what is seen worst.
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
from pyibr.core.checks import Float64, integer_from
from pyibr.core.errors import ArgumentError
from pyibr.images.depth_image import Side
from pyibr.meshes.mesh import Mesh

_AROUND = 64  # candidates that see the whole from outside
_WORST = 0.1  # of the points, before which candidates stand once all are seen
_ANCHORS = 12  # places a round before which candidates stand
_DISTANCES = (0.12, 0.3, 0.7)  # from these, in radii of the mesh
_APERTURES = (60.0, 60.0, 50.0)  # degrees at these distances
_PROBE = 128  # pixels of candidates' images, which tell what they see
_FAR = 1.02  # times the depth of the farthest that a frustum is to show
_MARGIN = 1.06  # of the angles around that
_SEEN = 0.7  # what it is worth that a point is seen at all; the rest is for how finely: with less, more stays unseen

Progress = Callable[[int, int, float], None]
"""(frusta so far, of how many, the share that none of them sees)"""


@dataclass(frozen=True)
class _Candidate:
    """A frustum, and what its image of each of the surface's points is worth: 1 if it is fine, 0 if there is none."""

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
        How many at most; fewer, if no more add anything.
    size : int
        Pixels a side of their images.
    known : sequence of Frustum
        Those that there are already: what they see needs no more.
    side : {"front", "back", "both"}
        Of the triangles, that counts as seen.
    surface : Surface, optional
        `surface_of(mesh)`, if it is known; of a part of the mesh, if only that is to be seen.
    progress : callable, optional
        Called after each frustum; what it raises ends the search.

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
    if not isinstance(mesh, Mesh):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise ArgumentError("mesh", "a pyibr.Mesh", type(mesh).__name__)
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
        self._best = np.where(self._outer, 0, 1).astype(np.float32)  # what the images so far are worth, by points
        self._candidates: list[_Candidate] = []
        self._random = np.random.default_rng(1999)
        low, high = surface.bounds
        self._middle, self._radius = 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low))
        # If each image were filled by its own part of the surface, its pixels would be so dense.
        self._goal = count * size**2 / surface.area

    @property
    def unseen(self) -> float:
        """The share of what can be seen that is not."""
        return float(np.count_nonzero(self._best == 0) / max(np.count_nonzero(self._outer), 1))

    def candidate(self, frustum: Frustum) -> _Candidate:
        """A frustum with what it sees."""
        view = frustum.resized(_PROBE).capture(self._surface.mesh)
        finer = (self._size / _PROBE) ** 2
        dense = self._surface.resolution(view, side=self._side)
        fine = np.sqrt(np.minimum(dense * np.float32(finer / self._goal), 1))  # by pixels along a line
        return _Candidate(frustum, np.where(dense > 0, np.float32(_SEEN) + np.float32(1 - _SEEN) * fine, np.float32(0)))

    def look_around(self) -> None:
        """Candidates that see the whole."""
        angle = 2 * math.degrees(math.asin(1 / 2.2))
        for direction in spread_directions(_AROUND):
            self._add(self._middle + 2.2 * self._radius * direction, self._middle, angle)

    def look_closer(self) -> None:
        """Candidates before places that are still unseen, or seen worst."""
        places = np.flatnonzero(self._best <= max(np.quantile(self._best[self._outer], _WORST), 0))
        for place in self._random.choice(places, min(_ANCHORS, len(places)), replace=False):
            point, normal = self._surface.points[place], self._outwards(place)
            for distance, angle in zip(_DISTANCES, _APERTURES, strict=True):
                aside = 0.35 * self._random.normal(size=3)  # what lies straight before a place may be hidden
                way = normal + aside - (aside @ normal) * normal
                self._add(point + distance * self._radius * way / np.linalg.norm(way), point, angle)

    def _outwards(self, place: int) -> Float64:
        normal = self._surface.normals[place]
        return -normal if self._side == "back" else normal

    def _add(self, eye: Float64, target: Float64, angle: float) -> None:
        up = np.eye(3)[np.abs(target - eye).argmin()]
        try:
            self._candidates.append(self.candidate(Frustum.look_at(eye, target, up, self._size, fov=angle)))
        except ArgumentError:  # it stands where single precision draws nothing
            return

    def best(self) -> _Candidate | None:
        """The candidate that adds most; None if none adds anything."""
        gains = [float(np.maximum(one.worth - self._best, 0).sum(dtype=np.float64)) for one in self._candidates]
        number = int(np.argmax(gains))
        return self._candidates[number] if gains[number] > 0 else None

    def take(self, one: _Candidate) -> None:
        """Count what it sees as seen."""
        self._best = np.maximum(self._best, one.worth)
        self._candidates = [other for other in self._candidates if other is not one]

    def fitted(self, one: _Candidate) -> Frustum:
        """Its frustum no wider and no deeper than what it adds needs."""
        camera = one.frustum.camera
        new = one.worth > self._best
        pixels, depth = camera.project(self._surface.points[new])
        half = np.abs((pixels - camera.K[:2, 2]) / np.diag(camera.K)[:2]).max(axis=0) * _MARGIN
        across, down = (
            min(2 * math.degrees(math.atan(one)), fov) for one, fov in zip(half, one.frustum.fov, strict=True)
        )
        return one.frustum.opened(max(across, 1.0), max(down, 1.0), float(depth.max()) * _FAR)
