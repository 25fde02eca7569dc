"""True pictures for the warp's tests: Embree, through Open3D, casts rays at the surface that a depth image represents.

The surface is the triangulated pixel grid in the source camera's frame. Embree only finds the triangle that a ray
meets first. The intersection is then computed again in float64 from the triangle's plane, so that the truth is as
precise as the depth image itself. None of the maths here comes from ``pyibr``, so that a mistake in its cameras shows
as a difference.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera
from pyibr.images import DepthImage
from tests.reference.edges import edges_of, triangles_beyond_border, whole_triangles, with_ring
from tests.reference.margins import margins_of

Array = NDArray[Any]

NOTHING = 0xFFFFFFFF  # Embree's number for no triangle
NUDGE = 1e-3  # target pixels by which a ray is moved to find a triangle that it slipped past


@dataclass(frozen=True)
class Truth:
    """First intersection of each target pixel's ray. Where ``valid`` is False, floats are nan and indices -1."""

    depth: Array  #: (H, W) float64, planar z
    valid: Array  #: (H, W) bool
    color: Array  #: (H, W, 3) float64, in the input's range, linear over the triangle in the source image
    view: Array  #: (H, W) int64, index of the view
    source: Array  #: (H, W, 2) float64, the hit's pixel (x, y) in that view
    triangle: Array  #: (H, W) int64, the triangle's index in that view
    nearness: Array  #: (H, W) float64, 1/z for a perspective target, -z for an orthographic one
    gradient: Array  #: (H, W, 2) float64, change of nearness over a pixel in x and in y on the hit's plane

    def interior(self, radius: int = 3, jump: float = 0.01) -> Array:
        """(H, W) bool: valid pixels outside of the `band` along edges, which is ``radius`` pixels wide."""
        return self.valid & ~band(self, radius, jump)


class Surface:
    """The triangulated pixel grid of one depth image, prepared for rays from many cameras.

    Edges are torn as `tests.reference.edges` says, for `edges` "cut"; with `cut_ratio`, where two neighbouring depths
    have a larger ratio.

    `faces` (n, 3) are indices of vertices. Sample (x, y) is vertex y * width + x; vertices of the margins beyond the
    samples follow. `vertices` and `colors` are (n, 3).
    """

    def __init__(self, view: DepthImage, edges: str = "connect", cut_ratio: float | None = None) -> None:
        import open3d as o3d

        self.view = view
        self.camera = view.camera
        torn = edges_of(view, edges, cut_ratio)
        pixels, near, colors, faces = _joined(
            triangles_beyond_border(view, torn), margins_of(view, *with_ring(view, torn)).corners()
        )
        beyond = _unprojected(view.camera, pixels, 1 / near if view.camera.projection == "perspective" else -near)
        count = view.depth.size
        self.faces = np.concatenate([triangulate(view, edges, cut_ratio), faces + count])
        self.vertices = np.nan_to_num(np.concatenate([samples(view), beyond]), nan=0.0, posinf=0.0, neginf=0.0)
        self.colors = np.concatenate([view.color.reshape(count, -1).astype(np.float64), colors])
        used = self.vertices[self.faces.ravel()] if len(self.faces) else np.zeros((1, 3))
        self.box = used.min(axis=0), used.max(axis=0)
        self.scene: Any = o3d.t.geometry.RaycastingScene()
        if len(self.faces):
            self.scene.add_triangles(self.vertices.astype(np.float32), self.faces.astype(np.uint32))

    def _first_triangle(self, origin: Array, direction: Array) -> Array:
        """Indices (n,) of the triangles that rays (n, 3) meet first, or `NOTHING`."""
        if not len(self.faces):
            return np.full(len(origin), NOTHING)
        packed = np.concatenate([origin, direction], axis=-1).astype(np.float32)
        return self.scene.cast_rays(packed)["primitive_ids"].numpy().astype(np.int64)

    def _meet(self, origin: Array, direction: Array, triangle: Array) -> tuple[Array, Array, Array, Array]:
        """Intersect rays with the planes of triangles.

        Returns the points (n, 3), the planes' normals (n, 3), whether each ray comes from the side that the source sees
        (n,), and the points' barycentric weights (n, 3) in the triangles' projection to the source image.
        """
        corner = self.vertices[self.faces[triangle]]  # (n, 3 corners, 3)
        normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        offset = np.einsum("ni,ni->n", normal, corner[:, 0])
        along = np.einsum("ni,ni->n", normal, direction)
        # A ray that crosses the plane in the same direction as the source's rays meets the side that the source sees.
        front = along * (normal[:, 2] if self.camera.projection == "orthographic" else offset) > 0
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (offset - np.einsum("ni,ni->n", normal, origin)) / along
            point = origin + t[:, None] * direction
        pixel = project(self.camera, corner.reshape(-1, 3)).reshape(-1, 3, 2)
        return point, normal, front, barycentric(pixel, project(self.camera, point))

    def cast(self, camera: Camera, side: str = "front") -> Truth:
        """First hits of ``camera``'s rays; a hit on a side that is not shown makes a hole."""
        width, height = camera.size
        y, x = np.mgrid[:height, :width].reshape(2, -1).astype(np.float64)
        origin, direction = rays(camera, self.camera, self.box, x, y)
        triangle = self._first_triangle(origin, direction)
        # Embree lets some rays slip through an edge or a corner that they meet exactly: cast four rays around each.
        for dx, dy in ((1, 1), (-1, -1), (1, -1), (-1, 1)):
            lost = np.flatnonzero(triangle == NOTHING)
            around = rays(camera, self.camera, self.box, x[lost] + NUDGE * dx, y[lost] + NUDGE * dy)
            near = self._first_triangle(*around)
            lost, near = lost[near != NOTHING], near[near != NOTHING]
            met = self._meet(origin[lost], direction[lost], near)[3].min(axis=1) > -1e-6
            triangle[lost[met]] = near[met]

        hit = np.flatnonzero(triangle != NOTHING)
        triangle = triangle[hit]
        point, normal, front, weight = self._meet(origin[hit], direction[hit], triangle)
        shown = {"front": front, "back": ~front, "both": np.ones_like(front)}[side]
        hit, triangle, point, normal, weight = (a[shown] for a in (hit, triangle, point, normal, weight))

        weight = np.clip(weight, 0, 1)
        weight /= weight.sum(axis=1, keepdims=True)
        color = self.colors[self.faces[triangle]]
        target_from_source = camera.camera_from_world @ self.camera.world_from_camera
        here = point @ target_from_source[:3, :3].T + target_from_source[:3, 3]
        nearness, gradient = plane(camera, here, normal @ target_from_source[:3, :3].T)

        def image(values: Array, empty: float = np.nan) -> Array:
            full = np.full((height * width, *values.shape[1:]), empty, dtype=values.dtype)
            full[hit] = values
            return full.reshape(height, width, *values.shape[1:])

        return Truth(
            depth=image(here[:, 2]),
            valid=image(np.ones(len(hit), dtype=bool), False),
            color=image(np.einsum("nk,nkc->nc", weight, color)),
            view=image(np.zeros(len(hit), dtype=np.int64), -1),
            source=image(project(self.camera, point)),
            triangle=image(triangle, -1),
            nearness=image(nearness),
            gradient=image(gradient),
        )


def raycast(
    views: DepthImage | Surface | Sequence[DepthImage | Surface],
    camera: Camera,
    edges: str = "connect",
    cut_ratio: float | None = None,
    side: str = "front",
) -> Truth:
    """True picture of one view or of several.

    Rays are cast at each view alone, since the back of one view's surface hides no other view's surface. The nearest
    hit counts; among equally near hits, that in the earliest view. Pass a `Surface` instead of a view to build it once.
    """
    several = [views] if isinstance(views, DepthImage | Surface) else list(views)
    best: Truth | None = None
    for index, view in enumerate(several):
        surface = view if isinstance(view, Surface) else Surface(view, edges, cut_ratio)
        new = surface.cast(camera, side)
        if best is None:
            best = new
            continue
        nearer = new.valid & ~(best.valid & (best.depth <= new.depth))
        for name in Truth.__dataclass_fields__:
            value = np.where(new.valid, index, -1) if name == "view" else getattr(new, name)
            getattr(best, name)[nearer] = value[nearer]
    assert best is not None
    return best


def triangulate(view: DepthImage, edges: str = "connect", cut_ratio: float | None = None) -> Array:
    """Triangles between samples: (n, 3) indices of samples, y * width + x.

    A cell is split along the diagonal from (x + 1, y) to (x, y + 1). Triangles with a torn edge or a missing corner are
    left out.
    """
    torn = edges_of(view, edges, cut_ratio)
    height, width = view.depth.shape
    number = np.arange(height * width).reshape(height, width)
    a, b, c, d = (number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:])
    faces = np.stack([np.stack([a, b, c], -1), np.stack([d, c, b], -1)], axis=2)
    return faces[whole_triangles(torn)].reshape(-1, 3)


def _joined(one: tuple[Array, ...], other: tuple[Array, ...]) -> tuple[Array, ...]:
    """Join two meshes, each a tuple of its vertices' pixels, nearness and colours, and its faces."""
    values = [np.concatenate(both) for both in zip(one[:3], other[:3], strict=True)]
    return *values, np.concatenate([one[3], other[3] + len(one[0])])


def samples(view: DepthImage) -> Array:
    """Positions of the samples, (height * width, 3) float64, in the camera's frame."""
    height, width = view.depth.shape
    pixels = np.mgrid[:height, :width].reshape(2, -1)[::-1].T.astype(np.float64)
    return _unprojected(view.camera, pixels, view.depth.ravel().astype(np.float64))


def _unprojected(camera: Camera, pixels: Array, z: Array) -> Array:
    """(n, 3) points, in the camera's frame, at pixels (n, 2) and depths z."""
    ray = straight(camera, np.column_stack([pixels, np.ones(len(pixels))]) @ np.linalg.inv(camera.K).T)
    if camera.projection == "perspective":
        return ray * z[:, None]
    return np.column_stack([ray[:, :2], z])


def rays(camera: Camera, frame: Camera, box: tuple[Array, Array], x: Array, y: Array) -> tuple[Array, Array]:
    """Origins and directions (n, 3) of ``camera``'s rays through pixels (x, y).

    Both are in the frame of the camera ``frame``. Adding a direction to a point increases its planar depth for
    ``camera`` by 1. A perspective ray starts at the camera's centre. An orthographic ray starts so far back that all of
    ``box``, given by two corners in ``frame``, lies ahead.
    """
    pixel = straight(camera, np.stack([x, y, np.ones_like(x)], axis=-1) @ np.linalg.inv(camera.K).T)
    frame_from_camera = frame.camera_from_world @ camera.world_from_camera
    rotation, center = frame_from_camera[:3, :3], frame_from_camera[:3, 3]
    if camera.projection == "perspective":
        direction = pixel @ rotation.T
        return np.broadcast_to(center, direction.shape), direction
    corners = np.stack(np.meshgrid(*np.stack(box, axis=1)), axis=-1).reshape(-1, 3)
    z = (corners - center) @ rotation[:, 2]
    pixel[:, 2] = z.min() - 0.01 * (np.ptp(z) + 1.0)
    return pixel @ rotation.T + center, np.broadcast_to(rotation[:, 2], pixel.shape)


def project(camera: Camera, points: Array) -> Array:
    """(n, 2) pixels of points that are given in the camera's frame."""
    scale = points[:, 2:] if camera.projection == "perspective" else 1.0
    plane_points = bent(camera, points[:, :2] / scale)
    return plane_points @ camera.K[:2, :2].T + camera.K[:2, 2]


def straight(camera: Camera, ray: Array) -> Array:
    """Undistorted directions (..., 3), z = 1, for distorted ones; OpenCV computes the lens."""
    if camera.lens is None or not ray.size:
        return ray
    import cv2

    seen, coefficients = ray[..., :2].copy().reshape(-1, 1, 2), np.array(camera.lens.coefficients)
    if camera.lens.model == "kannala_brandt":
        ideal = cv2.fisheye.undistortPoints(seen, np.eye(3), coefficients)
    else:
        done = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 500, 1e-13)
        ideal = cv2.undistortPoints(seen, np.eye(3), coefficients, R=None, P=None, criteria=done)
    return np.concatenate([ideal.reshape(*ray.shape[:-1], 2), ray[..., 2:]], axis=-1)


def bent(camera: Camera, points: Array) -> Array:
    """Distorted positions (n, 2) on the plane z = 1, for undistorted ones; OpenCV computes the lens."""
    if camera.lens is None or not len(points):
        return points
    import cv2

    coefficients = np.array(camera.lens.coefficients)
    if camera.lens.model == "kannala_brandt":
        return cv2.fisheye.distortPoints(points[None], np.eye(3), coefficients)[0]
    ahead = np.column_stack([points, np.ones(len(points))])
    return cv2.projectPoints(ahead, np.zeros(3), np.zeros(3), np.eye(3), coefficients)[0][:, 0]


def barycentric(corner: Array, point: Array) -> Array:
    """(n, 3) barycentric weights of points (n, 2) in triangles with the corners ``corner`` (n, 3, 2)."""
    u, v, p = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0], point - corner[:, 0]
    area = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    b = (p[:, 0] * v[:, 1] - p[:, 1] * v[:, 0]) / area
    c = (u[:, 0] * p[:, 1] - u[:, 1] * p[:, 0]) / area
    return np.stack([1 - b - c, b, c], axis=-1)


def plane(camera: Camera, point: Array, normal: Array) -> tuple[Array, Array]:
    """Nearness at points of planes, and its change from pixel to pixel in x and y.

    Points and normals are in the camera's frame. On a plane, 1/z is an affine function of a perspective camera's
    pixels, and z of an orthographic camera's.
    """
    inverse = np.linalg.inv(camera.K)
    with np.errstate(divide="ignore", invalid="ignore"):
        if camera.projection == "perspective":
            offset = np.einsum("ni,ni->n", normal, point)
            return 1 / point[:, 2], (normal @ inverse)[:, :2] / offset[:, None]
        return -point[:, 2], (normal[:, :2] @ inverse[:2, :2]) / normal[:, 2:]


def band(truth: Truth, radius: int = 3, jump: float = 0.01) -> Array:
    """(H, W) bool: holes, and the first ``radius`` pixels on either side of an edge, in all eight directions.

    There is an edge between two neighbouring pixels if only one is valid, or if the plane of a pixel's triangle,
    continued to the other pixel, misses the depth there by more than the fraction ``jump``. A plane is therefore no
    edge, however steep; its lower and upper ends are edges if its depth changes by more than ``jump`` per pixel. The
    image's border is no edge.
    """
    edge = ~truth.valid
    depth = truth.depth if np.any(truth.nearness < 0) else None  # orthographic: nearness is -z

    def mark(here: tuple[slice, slice], there: tuple[slice, slice], axis: int) -> None:
        n0, n1 = truth.nearness[here], truth.nearness[there]
        g0, g1 = truth.gradient[here][..., axis], truth.gradient[there][..., axis]
        s0, s1 = (n0, n1) if depth is None else (depth[here], depth[there])
        with np.errstate(invalid="ignore", over="ignore"):
            smooth = (np.abs(n0 + g0 - n1) <= jump * np.abs(s1)) & (np.abs(n1 - g1 - n0) <= jump * np.abs(s0))
        edge[here] |= ~smooth
        edge[there] |= ~smooth

    mark(np.s_[:, :-1], np.s_[:, 1:], 0)
    mark(np.s_[:-1, :], np.s_[1:, :], 1)
    return dilate(edge, radius - 1)  # the pixels on both sides of an edge are marked already


def dilate(mask: Array, radius: int) -> Array:
    """``mask`` grown by ``radius`` pixels in all eight directions."""
    height, width = mask.shape
    grown = np.zeros_like(mask)
    padded = np.pad(mask, radius)
    for dy in range(2 * radius + 1):
        for dx in range(2 * radius + 1):
            grown |= padded[dy : dy + height, dx : dx + width]
    return grown


def depth_change_one_pixel(
    truth: Truth, views: DepthImage | Sequence[DepthImage], camera: Camera, reach: float = 1.0
) -> Array:
    """(H, W) float64: largest change of depth around each true hit, within ``reach`` source pixels in x and in y.

    The true depth is compared with the depths, seen from the target, of all valid samples so close to the hit. Holes
    are nan.
    """
    several = [views] if isinstance(views, DepthImage) else list(views)
    change = np.full(truth.depth.shape, np.nan)
    for index, view in enumerate(several):
        mine = truth.view == index
        target_from_source = camera.camera_from_world @ view.camera.world_from_camera
        height, width = view.depth.shape
        with np.errstate(invalid="ignore"):
            depth = samples(view) @ target_from_source[2, :3] + target_from_source[2, 3]
        depth = np.where(view.valid, depth.reshape(height, width), np.nan)
        x, y = truth.source[mine].T
        largest = np.zeros(len(x))
        steps = range(-int(np.ceil(reach)), int(np.ceil(reach)) + 2)
        for dy in steps:
            for dx in steps:
                sx, sy = np.floor(x).astype(int) + dx, np.floor(y).astype(int) + dy
                near = (np.abs(sx - x) <= reach) & (np.abs(sy - y) <= reach)
                near &= (sx >= 0) & (sx < width) & (sy >= 0) & (sy < height)
                sample = depth[np.clip(sy, 0, height - 1), np.clip(sx, 0, width - 1)]
                difference = np.abs(sample - truth.depth[mine])
                largest = np.fmax(largest, np.where(near, difference, 0.0))
        change[mine] = largest
    return change
