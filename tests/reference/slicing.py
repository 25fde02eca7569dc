"""Objects from images in float64: a readable reference for Kautz & Seidel (2001), sections 4 and 5.

It uses no slices: each ray is followed in steps far shorter than the distance of slices, and the point where it enters
the object is refined by halving the last step.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from pyibr.core.camera import Camera
from pyibr.images import DepthImage
from pyibr.images.silhouette import Silhouette
from pyibr.slicing.boxes import Box
from tests.embree import rays_of
from tests.reference.heights import bilinear

Inside = Callable[[np.ndarray], np.ndarray]  # world points (N, 3) -> (N,) bool


def seen_at(camera: Camera, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return x, y and depth of world points in a camera's image, and which points the image contains."""
    local = (points - camera.world_from_camera[:3, 3]) @ camera.world_from_camera[:3, :3]
    z = local[:, 2]
    scale = np.where(z > 0, z, 1.0) if camera.projection == "perspective" else 1.0
    x = (camera.K[0, 0] * local[:, 0] + camera.K[0, 1] * local[:, 1]) / scale + camera.K[0, 2]
    y = camera.K[1, 1] * local[:, 1] / scale + camera.K[1, 2]
    on_image = (x >= -0.5) & (x <= camera.width - 0.5) & (y >= -0.5) & (y <= camera.height - 0.5)
    return x, y, z, on_image & ((z > 0) | (camera.projection == "orthographic"))


def nearness(z: np.ndarray, camera: Camera) -> np.ndarray:
    """Nearness, 1/z for a perspective camera and -z for an orthographic one, is linear in the pixels of a plane."""
    return 1 / np.maximum(z, 1e-12) if camera.projection == "perspective" else -z


class DepthSurface:
    """The surface of a depth image, which has a nearness at every place (x, y) of the image.

    A cell's four samples may all be of one surface. Then nearness is interpolated bilinearly. A crease may lie in the
    cell if the surface bends on both sides: then it is nearer, by up to two distances between samples. In other cells,
    the nearest samples form the front part. Beside missing samples, the front part ends where its samples' bilinear
    weights sum up to `outline`. Beside a farther surface, it falls off to that surface.
    """

    EDGE = 3.0  # distances between samples: neighbours whose depths differ more are on different surfaces
    REACH = 2.0  # distances between samples by which a surface may be nearer than its samples
    FALL = 1e30  # change of nearness beside a missing sample

    def __init__(self, view: DepthImage, outline: float) -> None:
        self.valid, self.outline = view.valid, outline
        self.n = nearness(np.where(view.valid, view.depth, np.inf).astype(float), view.camera)
        self.focal = min(view.camera.K[0, 0], view.camera.K[1, 1])
        self.perspective = view.camera.projection == "perspective"
        y, x = np.indices(self.n.shape)
        self.whole, self.crease_there, self.of_part, self.near = self.cells(x, y)

    def sample(self, n: np.ndarray) -> np.ndarray | float:
        """Change of nearness over a step in depth as long as the distance between samples, at nearness n."""
        return n / self.focal if self.perspective else 1 / self.focal

    def change(self, x: np.ndarray, y: np.ndarray, dx: int, dy: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the change of nearness from (x, y) to the next sample, and whether both are on one surface.

        The next sample is at (x + dx, y + dy). The change to a missing sample is -`FALL`, from a missing one `FALL`.
        """
        height, width = self.n.shape
        there = (x >= 0) & (y >= 0) & (x + dx < width) & (y + dy < height)
        here = np.clip(y, 0, height - 1), np.clip(x, 0, width - 1)
        next_ = np.clip(y + dy, 0, height - 1), np.clip(x + dx, 0, width - 1)
        there = there & self.valid[here] & self.valid[next_]
        change = np.where(there, self.n[next_], 0) - np.where(there, self.n[here], 0)
        joined = there & (np.abs(change) <= self.EDGE * self.sample(np.where(there, self.n[here], 0)))
        return np.where(there, change, np.where(self.valid[here], -self.FALL, self.FALL)), joined

    def rise(self, x: np.ndarray, y: np.ndarray, dx: int, dy: int) -> np.ndarray:
        """Return the change from (x, y) to the next sample if both are on one surface, or 0."""
        change, joined = self.change(x, y, dx, dy)
        return np.where(joined, change, 0)

    def bend(self, x: np.ndarray, y: np.ndarray, dx: int, dy: int) -> np.ndarray:
        """Decrease of slope at (x, y), where the surface bends away from the camera; else 0."""
        return np.maximum(self.change(x - dx, y - dy, dx, dy)[0] - self.change(x, y, dx, dy)[0], 0)

    def crease(self, x: np.ndarray, y: np.ndarray, dx: int, dy: int) -> tuple[np.ndarray, np.ndarray]:
        """Return how far a crease between (x, y) and the next sample rises above their chord, and its sharpness.

        Planes that continue the surface from both sides meet in the crease. If the surface also bends farther away, it
        is round: the smallest bend reduces the height and the sharpness.
        """
        first, last = self.bend(x, y, dx, dy), self.bend(x + dx, y + dy, dx, dy)
        joined = [self.change(x + k * dx, y + k * dy, dx, dy)[1] for k in (-1, 0, 1)]
        beside = [self.bend(x + m * dx, y + m * dy, dx, dy) for m in (-1, 2)]
        around = np.min([first, last, *(np.where(joined[k], beside[k // 2], self.FALL) for k in (0, 2))], axis=0)
        peak = first / np.maximum(first + last, 1e-300) * last
        known = joined[1] & (joined[0] | joined[2])
        return np.where(known, peak - 0.375 * around, 0), np.maximum(first, last) - around

    def corners(self, left: np.ndarray, top: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        right, low = np.minimum(left + 1, self.n.shape[1] - 1), np.minimum(top + 1, self.n.shape[0] - 1)
        return [(left, top), (right, top), (left, low), (right, low)]

    def samples(self, left: np.ndarray, top: np.ndarray) -> np.ndarray:
        """Nearness (4, ...) of cells' corners; -inf where there is no sample."""
        return np.array([np.where(self.valid[v, u], self.n[v, u], -np.inf) for u, v in self.corners(left, top)])

    def cells(self, left: np.ndarray, top: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """For each cell: whether it is one surface, its creases' height, its front corners, and their nearness."""
        n, corners = self.samples(left, top), self.corners(left, top)
        beside_empty = ~np.isfinite(n).all(axis=0)
        sample = self.sample(np.where(np.isfinite(n).any(axis=0), n.max(axis=0), 1))
        close = n >= n.max(axis=0) - self.EDGE * sample
        whole = ~beside_empty & close.all(axis=0)
        of_part = np.where(beside_empty, np.isfinite(n), close)
        (_, above), (right, _), (_, low) = corners[:3]
        creases = [self.crease(left, v, 1, 0) for v in (above, low)], [self.crease(u, top, 0, 1) for u in (left, right)]
        twist = np.abs(np.where(whole, n[0], 0) - np.where(whole, n[1] + n[2], 0) + np.where(whole, n[3], 0))
        sharp = np.max([sharp for pair in creases for _, sharp in pair], axis=0)
        peak = sum(np.maximum(a, b) for (a, _), (b, _) in creases) + 0.25 * np.minimum(twist, sharp)
        crease = np.minimum(peak, self.REACH * sample)
        rises = [
            np.maximum(-self.rise(u, v, 1, 0) if k & 1 else self.rise(u - 1, v, 1, 0), 0)
            + np.maximum(-self.rise(u, v, 0, 1) if k & 2 else self.rise(u, v - 1, 0, 1), 0)
            for k, (u, v) in enumerate(corners)
        ]
        near = np.where(of_part, n + np.minimum(rises, self.REACH * sample), -np.inf).max(axis=0)
        return whole, crease, of_part, near

    def at(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Nearness at (x, y); -inf where there is no surface."""
        height, width = self.n.shape
        cx, cy = np.clip(x, 0, width - 1), np.clip(y, 0, height - 1)
        left, top = (np.clip(np.floor(c).astype(int), 0, max(size - 2, 0)) for c, size in ((cx, width), (cy, height)))
        fx, fy = cx - left, cy - top
        weights = np.array([(1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy])
        n, near = self.samples(left, top), self.near[top, left]
        flat = (weights * np.where(np.isfinite(n), n, 0)).sum(axis=0)
        part = (weights * self.of_part[:, top, left]).sum(axis=0)
        torn = flat + np.minimum(part * ((0.5 / self.outline) ** 2 - 1), 1) * (
            np.where(np.isfinite(near), near, 0) - flat
        )
        beside = np.where(np.isfinite(n).all(axis=0), torn, np.where(part >= self.outline, near, -np.inf))
        return np.where(self.whole[top, left], flat + self.crease_there[top, left], beside)


def depth_object(views: Sequence[DepthImage]) -> Inside:
    """Return a test for points behind every view's surface; with more than six views, `outline` is less than 0.5."""
    surfaces = [DepthSurface(view, min(0.5, 3 / len(views))) for view in views]

    def inside(points: np.ndarray) -> np.ndarray:
        left = np.arange(len(points))  # points that passed all views so far
        for view, surface in zip(views, surfaces, strict=True):
            x, y, z, on_image = seen_at(view.camera, points[left])
            left = left[on_image & (nearness(z, view.camera) <= surface.at(x, y))]
        return np.isin(np.arange(len(points)), left)

    return inside


def visual_hull(views: Sequence[Silhouette | DepthImage]) -> Inside:
    """Return a test for points within every silhouette, whose outline is where its interpolated mask is 0.5."""

    def inside(points: np.ndarray) -> np.ndarray:
        left = np.arange(len(points))
        for view in views:
            x, y, _, on_image = seen_at(view.camera, points[left])
            left = left[on_image & (bilinear(view.valid.astype(float), x, y) >= 0.5)]
        return np.isin(np.arange(len(points)), left)

    return inside


def first_depth(inside: Inside, camera: Camera, box: Box, step: float) -> np.ndarray:
    """Depth (H, W) at which each pixel's ray first enters a solid within the box, in steps of `step`; inf if never."""
    origin, direction = np.split(rays_of(camera), 2, axis=1)  # the point of depth z is origin + z * direction

    # The box is between three pairs of planes: a ray is inside from the last entry to the first exit of the three.
    start, along = origin @ box.axes.T, direction @ box.axes.T
    along = np.where(np.abs(along) < 1e-15, 1e-15, along)
    crossings = np.stack([(box.low - start) / along, (box.high - start) / along])
    front, back = np.maximum(crossings.min(axis=0).max(axis=1), 0), crossings.max(axis=0).min(axis=1)

    depth, z = np.full(len(front), np.inf), front.copy()
    left = np.flatnonzero(front <= back)
    while len(left):
        hit = inside(origin[left] + z[left, None] * direction[left])
        depth[left[hit]] = z[left[hit]]
        left = left[~hit]
        z[left] += step
        left = left[z[left] <= back[left]]

    some = np.flatnonzero(np.isfinite(depth))
    behind, before = depth[some], np.maximum(depth[some] - step, front[some])
    for _ in range(12):
        middle = 0.5 * (before + behind)
        hit = inside(origin[some] + middle[:, None] * direction[some])
        behind, before = np.where(hit, middle, behind), np.where(hit, before, middle)
    depth[some] = behind
    return depth.reshape(camera.height, camera.width)
