"""The fraction of a surface that depth images have seen, measured at points spread evenly over it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pyibr.capture.raycast import spread_directions
from pyibr.core.camera import Camera
from pyibr.core.checks import Float64, checked_box, describe, instance_of, integer_from
from pyibr.core.errors import ArgumentError
from pyibr.images import DepthImage
from pyibr.images.depth_image import Side
from pyibr.meshes.mesh import Mesh
from pyibr.picture.render import render

Mask = NDArray[np.bool_]

_SLACK = 1.0  # pixels by which a seen point may lie behind the image's depth, because surfaces curve
_ALONG = 0.05  # surfaces more oblique than this cosine count as seen from both sides
_DIRECTIONS = 128  # views that find the surface visible from outside
_OUTSIDE = 320  # width and height of these views in pixels
_TURNED = 2.0  # a normal flips where its back is seen from outside this many times as often as its front
_DENSER_MAX = 64.0  # limit of the oversampling that puts enough points into a box
_CLOSED = 0.02  # fraction of the surface: if less is visible from outside, the scene surrounds the viewer


@dataclass(frozen=True)
class Surface:
    """Points spread over a mesh or a part of it; each point stands for the same area.

    Attributes
    ----------
    mesh : Mesh
    points : (N, 3)
        In the world.
    corner_normals : (N, 3)
        Unit normals by the triangles' corner order, which is not consistent in every mesh.
    area : float
        Area that the points are spread over, in squared scene units.
    within : (2, 3), optional
        Box of the part, (low, high) in the world. The rest of the mesh may occlude the part.
    """

    mesh: Mesh
    points: Float64
    corner_normals: Float64
    area: float
    within: Float64 | None = None

    @property
    def bounds(self) -> tuple[Float64, Float64]:
        """Bounding box of the mesh or its part: (low, high), each (3,), in the world."""
        low, high = (corner.astype(np.float64) for corner in self.mesh.bounds)
        if self.within is None:
            return low, high
        return np.maximum(low, self.within[0]), np.minimum(high, self.within[1])

    def seen(self, view: DepthImage, *, side: Side = "front") -> Mask:
        """Points, (N,) bool, that a depth image has seen from `side`, as `pyibr.picture.unseen` marks them."""
        return self.resolution(view, side=side) > 0

    def resolution(self, view: DepthImage, *, side: Side = "front") -> NDArray[np.float32]:
        """Pixels per squared scene unit, (N,), at which a depth image has seen the points; 0 where unseen."""
        camera = view.camera
        pixels, z = camera.project(self.points)
        width, height = camera.size
        with np.errstate(invalid="ignore"):
            inside = (z > 0) & ((pixels >= -0.5) & (pixels <= np.array([width, height]) - 0.5)).all(axis=1)
        to = camera.center - self.points[inside]
        distance = np.linalg.norm(to, axis=1)
        cosine = np.sum(to * self.normals[inside], axis=1) / np.maximum(distance, 1e-30)
        counts = np.zeros(len(cosine), np.bool_)
        if side != "back":
            counts |= cosine > -_ALONG
        if side != "front":
            counts |= cosine < _ALONG
        some = np.flatnonzero(inside)[counts]
        depth = np.where(view.valid, view.depth, np.float32(0))
        sample = max(1 / camera.K[0, 0], 1 / camera.K[1, 1])
        near = z[some] * (1 - _SLACK * sample)
        x, y = (
            np.clip(np.floor(pixels[some, axis]), 0, max(camera.size[axis] - 2, 0)).astype(np.intp) for axis in (0, 1)
        )
        found = np.zeros(len(some), np.bool_)
        for dx in range(min(width, 2)):
            for dy in range(min(height, 2)):
                found |= depth[y + dy, x + dx] >= near
        found &= near > 0
        hit = some[found]
        made = np.zeros(len(self.points), np.float32)
        # A patch covers a solid angle of area * facing / distance^2. On the plane z = 1, where pixels have equal areas,
        # it covers 1 / cos^3 times as much; cos is the cosine of the angle to the axis.
        ahead = -(to[counts][found] @ camera.forward) / distance[counts][found]
        facing = np.maximum(np.abs(cosine[counts][found]), _ALONG)
        made[hit] = (
            camera.K[0, 0] * camera.K[1, 1] * facing / (distance[counts][found] ** 2 * np.maximum(ahead, 1e-3) ** 3)
        )
        return made

    @property
    def outer(self) -> Mask:
        """Points, (N,) bool, that are visible from far outside; all points, if hardly any is visible."""
        front, back = self._from_outside
        found: Mask = (front + back) > 0
        return found if found.mean() > _CLOSED else np.ones(len(self.points), np.bool_)

    @cached_property
    def normals(self) -> Float64:
        """Unit normals, (N, 3), on the side that is visible from outside: the front."""
        front, back = self._from_outside
        return np.where((back > _TURNED * front)[:, None], -self.corner_normals, self.corner_normals)

    @cached_property
    def _from_outside(self) -> NDArray[np.int32]:
        """(2, N) counts of directions that see each point: on the side of its corner normal, and on the other side."""
        middle, radius = _ball(self.bounds)
        center, mesh_radius = _ball(tuple(corner.astype(np.float64) for corner in self.mesh.bounds))
        away = 2 * mesh_radius + float(np.linalg.norm(middle - center))  # outside the whole mesh
        found = np.zeros((2, len(self.points)), np.int32)
        for direction in cast("Sequence[Float64]", spread_directions(_DIRECTIONS)):
            camera = Camera.look_at(
                middle + away * direction,
                middle,
                np.eye(3)[np.abs(direction).argmin()],
                (_OUTSIDE, _OUTSIDE),
                projection="orthographic",
                height=2.02 * radius,
            )
            frame = render(self.mesh, camera)
            pixels, z = camera.project(self.points)
            x, y = np.clip(np.rint(pixels).astype(np.intp), 0, _OUTSIDE - 1).T
            facing: Float64 = self.corner_normals @ direction
            # On an oblique surface, the depths of neighbours differ by the slope: by up to three pixels here.
            steep = np.sqrt(1 - facing**2) / np.maximum(np.abs(facing), 0.1)
            tolerance = 2.02 * radius / _OUTSIDE * (0.5 + np.minimum(steep, 3.0))
            seen = frame.depth[y, x] >= z - tolerance
            found += np.stack([(facing > _ALONG) & seen, (facing < -_ALONG) & seen])
        return found


def surface_of(mesh: Mesh, *, count: int = 40_000, within: ArrayLike | None = None) -> Surface:
    """Spread points over a mesh, the same each time.

    Parameters
    ----------
    mesh : Mesh
    count : int
        Number of points. On a part of the mesh, the number may differ somewhat.
    within : (2, 3), optional
        Box, (low, high) in the world; only the surface inside counts.

    Raises
    ------
    ArgumentError
        If `within` is not a box, or contains none of the mesh.

    Examples
    --------
    >>> from pyibr.capture import models
    >>> from pyibr.capture.coverage import surface_of
    >>> surface = surface_of(models.donut(60), count=1000)
    >>> len(surface.points), round(surface.area, 1)  # 4 pi^2 0.4 = 15.8
    (1000, 15.8)
    """
    instance_of("mesh", mesh, Mesh, "a pyibr.Mesh")
    integer_from("count", count, 1, 1 << 24)
    box = None if within is None else checked_box("within", within)
    corner = mesh.vertices.astype(np.float64)[mesh.faces]
    across = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    twice = np.linalg.norm(across, axis=1)
    normals = across / np.maximum(twice, 1e-300)[:, None]
    if box is None:
        points, face = _spread(corner, twice, count)
        return Surface(mesh, points, normals[face], float(twice.sum()) / 2)
    twice[((corner.max(axis=1) < box[0]) | (corner.min(axis=1) > box[1])).any(axis=1)] = 0
    tried = _inside(_spread(corner, twice, count)[0], box).mean()
    points, face = _spread(corner, twice, round(count * min(1 / max(tried, 1e-30), _DENSER_MAX)))
    inside = _inside(points, box)
    if not inside.any():
        raise ArgumentError("within", "a box that holds some of the surface", describe(within))
    return Surface(mesh, points[inside], normals[face[inside]], float(twice.sum() * inside.mean()) / 2, box)


def _ball(bounds: tuple[Float64, ...]) -> tuple[Float64, float]:
    """Middle and radius of the ball around a box."""
    low, high = bounds
    return 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low))


def _inside(points: Float64, box: Float64) -> Mask:
    found: Mask = ((points >= box[0]) & (points <= box[1])).all(axis=1)
    return found


def _spread(corner: Float64, weights: Float64, count: int) -> tuple[Float64, NDArray[np.intp]]:
    """Spread `count` points over triangles (F, 3, 3), on each in proportion to its weight.

    Returns the points, and the index of each point's triangle.
    """
    ends = np.cumsum(weights)
    random = np.random.default_rng(1999)
    places = (np.arange(count) + random.random(count)) * (ends[-1] / count)  # one point in each interval of equal area
    found = cast("NDArray[np.intp]", np.searchsorted(ends, places, side="right"))
    face = np.minimum(found, len(weights) - 1)
    u, v = np.sqrt(random.random(count)), random.random(count)
    parts = np.stack([1 - u, u * (1 - v), u * v], axis=1)
    return np.einsum("nk,nkc->nc", parts, corner[face]), face


def unseen_share(surface: Surface, seen: Sequence[Mask]) -> float:
    """Fraction of the points visible from outside that no mask contains."""
    outer = surface.outer
    covered = np.any(seen, axis=0) if len(seen) else np.zeros(len(outer), np.bool_)
    return float(np.count_nonzero(outer & ~covered) / max(np.count_nonzero(outer), 1))
