"""The warp in NumPy float64, one pixel at a time: a readable reference for small images.

It follows Schaufler and Priglinger, "Efficient Displacement Mapping by Image Warping" (1999), sections 3 to 5, in
homogeneous pixel space: `Camera.pixel_matrix` maps a point in the camera's frame to (U, V, W, Q). The point's pixel is
(U/W, V/W), and its nearness, the paper's disparity delta, is Q/W. On a triangle of the source's grid, and along a ray,
nearness is an affine function of the source's pixels, for perspective and for orthographic cameras.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera
from pyibr.images import DepthImage
from tests.reference.edges import Edges, edges_of, nearness_of, with_ring
from tests.reference.margins import Margins, margins_of

Array = NDArray[Any]


@dataclass
class Result:
    """depth (H, W) float64, nan in holes; valid (H, W) bool; color (H, W, 3) float64, 0 in holes."""

    depth: Array
    valid: Array
    color: Array

    @classmethod
    def empty(cls, camera: Camera) -> Result:
        width, height = camera.size
        depth = np.full((height, width), np.nan)
        return cls(depth, np.zeros((height, width), dtype=bool), np.zeros((height, width, 3)))

    def put(self, x: int, y: int, depth: float, color: Array) -> None:
        self.depth[y, x], self.valid[y, x], self.color[y, x] = depth, True, color


def forward_reference(view: DepthImage, camera: Camera, splat: int = 1) -> Result:
    """Draw every valid sample as ``splat`` x ``splat`` target pixels; the nearest wins, of equals the lowest index.

    Equation (2) maps a sample's pixel x_r and nearness delta(x_r) to the target's pixel space.
    """
    result = Result.empty(camera)
    target_from_source = np.linalg.inv(_source_from_target(view.camera, camera))
    delta = nearness_of(view)
    nearest = np.full(result.depth.shape, -np.inf)
    for y, x in np.argwhere(view.valid):
        u, v, w, q = point = target_from_source @ [x, y, 1.0, delta[y, x]]
        if w <= 0:  # behind the target camera
            continue
        left, top = (int(np.floor(c / w - (splat - 1) / 2 + 0.5)) for c in (u, v))
        for row in range(max(top, 0), min(top + splat, camera.height)):
            for column in range(max(left, 0), min(left + splat, camera.width)):
                if q / w > nearest[row, column]:
                    nearest[row, column] = q / w
                    result.put(column, row, _depth(camera, point), view.color[y, x])
    return result


def search_reference(
    view: DepthImage,
    camera: Camera,
    sample: str = "linear",
    edges: str = "connect",
    cut_ratio: float | None = None,
    side: str = "front",
) -> Result:
    """Search the epipolar line of every target pixel for the first surface, from the epipole to infinity.

    The ray of the target pixel x_d is ``epipole + t * infinity`` in the source's pixel space; equation (4) gives both
    ends. At t the ray projects to a source pixel; its nearness there is the paper's min_delta. The ray has met the
    surface where the surface's delta at that pixel is larger.

    Every triangle of the grid along the line is tried, so that the result is exact. With "nearest" samples, depth and
    colour are those that the sample nearest to the hit has.
    """
    result = Result.empty(camera)
    source_from_target = _source_from_target(view.camera, camera)
    surface = with_ring(view, edges_of(view, edges, cut_ratio))
    margins = margins_of(view, *surface)
    width, height = camera.size
    for y in range(height):
        for x in range(width):
            # In the target's pixel space, pixel (x, y) at depth t is (t x, t y, t, 1), if orthographic (x, y, 1, -t).
            if camera.projection == "perspective":
                ray = Ray(source_from_target @ [0, 0, 0, 1], source_from_target @ [x, y, 1, 0], 0.0)
            else:
                ray = Ray(source_from_target @ [x, y, 1, 0], source_from_target @ [0, 0, 0, -1], -np.inf)
            if not ray.clip(view.camera.size):
                continue
            hit = _nearer(_first_triangle(view, ray, *surface), margins, ray)
            if hit is None or (side != "both" and hit.front != (side == "front")):
                continue
            point, color = hit.point, hit.color
            if sample == "nearest":
                nearest = np.floor(point[:2] / point[2] + 0.5).astype(int)
                sx, sy = np.clip(nearest, 0, np.subtract(view.camera.size, 1))
                point, color = np.array([sx, sy, 1.0, nearness_of(view)[sy, sx]]), view.color[sy, sx]
            result.put(x, y, _depth(camera, np.linalg.solve(source_from_target, point)), color)
    return result


@dataclass
class Hit:
    """Intersection of a ray with the surface."""

    t: float  #: depth for the target
    point: Array  #: (4,) the surface point in the source's pixel space
    front: bool  #: whether the hit is on the side that the source sees
    color: Array  #: (3,) the source's colour there


@dataclass
class Ray:
    """``epipole + t * infinity`` in the source's pixel space, low <= t <= high; t is the target's depth."""

    epipole: Array
    infinity: Array
    low: float
    high: float = np.inf

    def clip(self, size: tuple[int, int]) -> bool:
        """Limit t to the part of the ray that lies in the source's image and in front of it; False if there is none.

        The conditions are -W / 2 <= U <= W (width - 1 / 2), likewise for V, and W > 0. They are linear in t. So rays
        that cross the source camera's plane, where W changes its sign, need no special treatment.
        """
        right, bottom = size[0] - 0.5, size[1] - 0.5
        rows = [[1, 0, 0.5, 0], [-1, 0, right, 0], [0, 1, 0.5, 0], [0, -1, bottom, 0], [0, 0, 1, 0]]
        for row in rows:
            a, b = np.dot(row, self.epipole), np.dot(row, self.infinity)  # a + t b >= 0
            if b > 0:
                self.low = max(self.low, -a / b)
            elif b < 0:
                self.high = min(self.high, -a / b)
            elif a < 0:
                return False
        return bool(self.low < self.high)

    def at(self, t: Array) -> Array:
        """Points (n, 4) of the ray at depths t (n,)."""
        return self.epipole + t[:, None] * self.infinity

    def meets(self, axis: tuple[int, int], last: int) -> Array:
        """Sorted t at which the ray crosses the grid lines ``axis . (x, y) = -1, 0, 1, ... last``."""
        k = np.arange(-1, last + 1)
        a = np.dot(axis, self.epipole[:2]) - k * self.epipole[2]
        b = np.dot(axis, self.infinity[:2]) - k * self.infinity[2]
        with np.errstate(divide="ignore", invalid="ignore"):
            t = -a / b
        return np.sort(t[np.isfinite(t) & (t >= self.low) & (t <= self.high)])


def _first_triangle(view: DepthImage, ray: Ray, ring: Array, edges: Edges) -> Hit | None:
    """Find the first triangle that the ray meets, in the grid with a ring of samples around the image's."""
    height, width = view.depth.shape
    grid = ray.meets((1, 0), width), ray.meets((0, 1), height), ray.meets((1, 1), width + height)
    t = np.unique(np.concatenate([[ray.low], *grid, [ray.high]]))
    a, b = t[:-1], t[1:]
    # Between two successive values of t, the ray projects into one triangle, that around any point between them.
    inner = np.where(np.isinf(b), np.where(np.isinf(a), 0.0, a + 1), np.where(np.isinf(a), b - 1, (a + b) / 2))
    pixel = ray.at(inner)[:, :2] / ray.at(inner)[:, 2:3]
    x, y = np.clip(np.floor(pixel).astype(int), -1, [width - 1, height - 1]).T
    upper = (pixel[:, 0] - x + pixel[:, 1] - y >= 1).astype(int)
    # (cx, cy): the triangle's corner with the right angle; nx, ny: columns and rows of its neighbours in x and y.
    cx, cy, nx, ny = x + upper, y + upper, x + 1 - upper, y + 1 - upper
    delta = ring[cy + 1, cx + 1]
    gu, gv = (ring[cy + 1, nx + 1] - delta) * (nx - cx), (ring[ny + 1, cx + 1] - delta) * (ny - cy)
    plane = np.stack([gu, gv, delta - gu * cx - gv * cy, -np.ones_like(gu)], axis=-1)
    # W * (delta - min_delta), the surface's nearness less the ray's, is f0 + t f1.
    f0, f1 = plane @ ray.epipole, plane @ ray.infinity
    with np.errstate(divide="ignore", invalid="ignore"):
        root = -f0 / f1
        slack = 1e-9 * np.where(np.isfinite(b - a), b - a, 1.0)
        crossed = (root >= a - slack) & (root <= b + slack)
        row = np.where(upper, y + 1, y) + 1  # row of the edge along x
        column = np.where(upper, x + 1, x) + 1
        crossed &= ~(edges.diagonal[y + 1, x + 1] | edges.right[row, x + 1] | edges.below[y + 1, column])
    if not crossed.any():
        return None
    i = int(np.argmax(crossed))
    point = ray.epipole + root[i] * ray.infinity
    along_x, along_y = np.abs(point[:2] / point[2] - [cx[i], cy[i]])
    color = np.pad(view.color, ((1, 1), (1, 1), (0, 0)), mode="edge").astype(np.float64)
    mixed = (1 - along_x - along_y) * color[cy[i] + 1, cx[i] + 1]
    mixed = mixed + along_x * color[cy[i] + 1, nx[i] + 1] + along_y * color[ny[i] + 1, cx[i] + 1]
    return Hit(float(root[i]), point, bool(f1[i] > 0), mixed)


def _nearer(hit: Hit | None, margins: Margins, ray: Ray) -> Hit | None:
    """Return the hit or, if the ray meets a margin earlier, the hit on that margin."""
    t, number = margins.first_hit(ray.epipole, ray.infinity, ray.low, ray.high)
    if number < 0 or (hit is not None and hit.t <= t):
        return hit
    point = ray.epipole + t * ray.infinity
    plane = margins.planes[number]
    du, dv = point[:2] / point[2] - [margins.x[number], margins.y[number]]
    color, along_x, along_y = margins.color[number]
    return Hit(t, point, bool(plane @ ray.infinity > 0), color + du * along_x + dv * along_y)


def _source_from_target(source: Camera, target: Camera) -> Array:
    """Matrix (4, 4) from the target's homogeneous pixel space to the source's."""
    source_from_target = source.camera_from_world @ target.world_from_camera
    return source.pixel_matrix @ source_from_target @ np.linalg.inv(target.pixel_matrix)


def _depth(camera: Camera, point: Array) -> float:
    """Planar depth of a point (U, V, W, Q) in the camera's pixel space."""
    _, _, w, q = point
    return float(w / q if camera.projection == "perspective" else -q / w)
