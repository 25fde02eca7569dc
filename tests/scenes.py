"""Target cameras for every case of the epipolar geometry, for the scenes of `tools.scenes`."""

from __future__ import annotations  # noqa: I001 (the names of tools.scenes stand in one list)

from dataclasses import dataclass
from functools import cache

import numpy as np

from pyibr.core.camera import Camera, Projection
from pyibr.images import DepthImage
from tools.scenes import (
    Array as Array,
    Size as Size,
    flat as flat,
    holed as holed,
    image_coordinates as image_coordinates,
    pose as pose,
    ramp_and_empty as ramp_and_empty,
    scene as scene,
    smooth as smooth,
    source_camera as source_camera,
    stepped as stepped,
    texture as texture,
)

_CELLS = 6  # the search for cameras divides the target image into 6 x 6 cells, and counts the cells with surface
REGIONS = "ABCDEFGHI"  # row by row: A is above and left of the image, E inside it, I below and right


@dataclass(frozen=True)
class Pose:
    """A target camera and the case of the epipolar geometry that it represents.

    ``signs`` are the signs of the epipoles' third homogeneous coordinates, in the target and in the source image: +1
    in front of the camera, -1 behind it, 0 at infinity (see `epipole_signs`).
    """

    name: str
    camera: Camera
    region: str
    signs: tuple[int, int]


def moved_aside(camera: Camera, x: float, y: float) -> Camera:
    """Return the camera with its picture moved by x pixels to the right and y pixels down."""
    K = camera.K + np.array([[0, 0, x], [0, 0, y], [0, 0, 0]])
    return Camera(K, camera.size, camera.world_from_camera, projection=camera.projection)


def epipole(image: Camera, other: Camera) -> Array:
    """(3,) homogeneous pixel of the camera ``other``'s centre in the image of the camera ``image``.

    An orthographic camera's centre is infinitely far behind it. The third coordinate is positive for a centre in front
    of a perspective ``image``. In an orthographic ``image`` it is 1, or 0 for a centre at infinity.
    """
    image_from_other = image.camera_from_world @ other.world_from_camera
    # The centre at infinity is a direction: its last coordinate is 0.
    center = image_from_other[:, 3] if other.projection == "perspective" else -image_from_other[:, 2]
    affine = image.projection == "orthographic"
    return image.K @ np.array([center[0], center[1], center[3] if affine else center[2]])


def epipole_signs(source: Camera, target: Camera) -> tuple[int, int]:
    """Signs of the epipoles' third homogeneous coordinates, in the target and in the source image."""

    def sign(point: Array) -> int:
        return 0 if abs(point[2]) <= 1e-12 * np.abs(point).max() else int(np.sign(point[2]))

    return sign(epipole(target, source)), sign(epipole(source, target))


def epipole_region(source: Camera, target: Camera) -> str:
    """Place of the epipole in the target: one of `REGIONS`, "infinity" (a direction in the image) or "none".

    There is none between perspective cameras with one centre, nor between parallel orthographic cameras.
    """
    point = epipole(target, source)
    apart = np.linalg.norm(target.center - source.center) > 1e-9
    if source.projection == target.projection == "perspective" and not apart:
        return "none"
    if epipole_signs(source, target)[0] == 0:
        return "infinity" if np.abs(point[:2]).max() > 1e-9 * np.abs(target.K).max() else "none"
    x, y = point[:2] / point[2]
    column = 0 if x < 0 else 1 if x <= target.width - 1 else 2
    row = 0 if y < 0 else 1 if y <= target.height - 1 else 2
    return REGIONS[3 * row + column]


def target_intrinsics(size: Size, projection: str = "perspective", zoom: float = 1.0) -> Array:
    """(3, 3) K of the target cameras: at zoom 1 the longer side sees 80 degrees or 7 scene units."""
    width, height = size
    longer = max(width, height)
    f = zoom * (0.6 * longer if projection == "perspective" else longer / 7)
    return np.array([[f, 0, (width - 1) / 2 - 0.4], [0, f, (height - 1) / 2 + 0.1], [0, 0, 1]])


def target_cameras(
    view: DepthImage, region: str, size: Size | None = None, projection: Projection = "perspective", share: float = 0.2
) -> list[Pose]:
    """Target cameras whose epipole lies in ``region``, one for each possible pair of both epipoles' signs.

    A pair of signs is left out if no camera shows the surface's front in the fraction `share` of the target image. Its
    size is by default the source's. Orthographic targets always have the signs (1, -1): with its centre in front of the
    source camera, such a target would look back and see the surface's back.

    The epipole's pixel and sign fix the direction from the target's centre to the source's, in the target's frame. The
    distance and the target's rotation are free: a search over a fixed grid finds a good view of the surface.
    """
    size = size or view.camera.size
    found: list[Pose] = []
    for signs in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        if not _possible(signs, view.camera.projection, projection):
            continue
        camera = _search(view, region, signs, size, projection, share)
        if camera is not None:
            name = region + "".join("+" if sign > 0 else "-" for sign in signs)
            found.append(Pose(name, camera, region, signs))
    return found


def special_cameras(view: DepthImage, size: Size | None = None, projection: Projection = "perspective") -> list[Pose]:
    """Identity, pure rotation, and epipoles at infinity (sideways translations along x, y and a diagonal)."""
    size = size or view.camera.size
    source = view.camera
    K = target_intrinsics(size, projection)
    moves = {
        "still": pose(),
        "turned": pose(yaw=12, pitch=-7, roll=20),
        "right": pose(center=(0.8, 0, 0)),
        "left": pose(center=(-0.8, 0, 0)),
        "down": pose(center=(0, 0.8, 0)),
        "up": pose(center=(0, -0.8, 0)),
        "diagonal": pose(center=(0.6, -0.45, 0)),
        "rolled": pose(roll=30, center=(0.5, 0.3, 0)),
    }
    if projection == source.projection == "orthographic":
        moves["slanted"] = pose(yaw=25, pitch=10)
    found: list[Pose] = []
    for name, source_from_target in moves.items():
        camera = Camera(K, size, source.world_from_camera @ source_from_target, projection=projection)
        found.append(Pose(name, camera, epipole_region(source, camera), epipole_signs(source, camera)))
    return found


def some_cameras(
    view: DepthImage, regions: str, size: Size | None = None, projection: Projection = "perspective"
) -> list[Pose]:
    """`target_cameras` of some regions, then `special_cameras`."""
    finite = [pose for region in regions for pose in target_cameras(view, region, size, projection)]
    return finite + special_cameras(view, size, projection)


def _possible(signs: tuple[int, int], source: str, target: str) -> bool:
    if source == target == "orthographic":
        return False  # both epipoles are at infinity
    if target == "orthographic":
        return signs == (1, -1)
    return source == "perspective" or signs[1] == 1


def _search(
    view: DepthImage, region: str, signs: tuple[int, int], size: Size, projection: Projection, share: float
) -> Camera | None:
    source = view.camera
    point, normal = _surface(view)
    best, best_score = None, -np.inf
    for zoom in (1.0, 0.7, 0.5):
        if best is not None:  # zoom out only if no camera sees enough without it
            break
        for pixel in _places(region, size):
            K = target_intrinsics(size, projection, zoom)
            toward = np.linalg.inv(K) @ [*pixel, 1.0]
            rotation, center, turned = _candidates(source, projection, toward, signs[0])
            if source.projection == "perspective":
                forward = center[:, 2] if projection == "perspective" else -rotation[:, 2, 2]
                usable = forward * signs[1] > 0.05
                rotation, center, turned = rotation[usable], center[usable], turned[usable]
            seen = _share_seen(view, point, normal, rotation, center, K, size, projection)
            score = np.where(seen >= share, seen - 0.15 * turned / 180, -np.inf)
            if not len(score) or score.max() <= best_score:
                continue
            index = int(score.argmax())
            source_from_target = np.eye(4)
            source_from_target[:3, :3], source_from_target[:3, 3] = rotation[index], center[index]
            camera = Camera(K, size, source.world_from_camera @ source_from_target, projection=projection)
            if epipole_region(source, camera) == region and epipole_signs(source, camera) == signs:
                best, best_score = camera, float(score[index])
    return best


def _places(region: str, size: Size) -> list[Array]:
    """Three pixels in ``region``, none in the image's middle row or column."""
    column, row = REGIONS.index(region) % 3, REGIONS.index(region) // 3
    shares = (0.45, 0.2, 0.9) if region == "E" else (0.2, 0.6, 1.5)
    inside = [0.2 + 0.3 * s for s in shares], [0.8 - 0.4 * s for s in shares]
    x = [(-s, inside[0][i], 1 + s)[column] for i, s in enumerate(shares)]
    y = [(-s, inside[1][i], 1 + s)[row] for i, s in enumerate(shares)]
    return [np.array(at) * (np.array(size) - 1) for at in zip(x, y, strict=True)]


def _candidates(source: Camera, projection: str, toward: Array, sign: int) -> tuple[Array, Array, Array]:
    """Poses of targets whose epipole lies at the pixel with the ray ``toward``.

    Returns rotations (n, 3, 3) and centres (n, 3), both source_from_target, and the angles (n,) by which the targets
    are turned away from the source, in degrees.
    """
    turns, degrees = _rotations()
    rotation, centers = turns, []
    if projection == "perspective" and source.projection == "orthographic":
        # The pixel's ray must be parallel to the source's rays. The spin about it and the target's centre are free.
        rotation = _aligned(sign * toward, turns)
    for distance in (0.7, 1.4, 2.5):
        if projection == "orthographic":
            # The source's centre must lie on the pixel's ray. The target stands so far back that it sees all.
            center = -turns @ [toward[0], toward[1], 6.0 + distance]
        elif source.projection == "orthographic":
            center = 1.5 * turns[:, :, 2]
            center[:, 2] = 4 - distance
        else:
            center = -distance * turns @ (sign * toward / np.linalg.norm(toward))
        centers.append(center)
    return np.tile(rotation, (3, 1, 1)), np.concatenate(centers), np.tile(degrees, 3)


@cache
def _rotations() -> tuple[Array, Array]:
    """Rotations (n, 3, 3), and the angles (n,) of yaw and pitch together, in degrees."""
    angles = [
        (yaw, pitch, roll)
        for yaw in range(-100, 101, 20)
        for pitch in range(-80, 81, 20)
        for roll in (0, 25)
        if abs(yaw) + abs(pitch) <= 120
    ]
    return np.stack([pose(*a)[:3, :3] for a in angles]), np.array([np.hypot(a[0], a[1]) for a in angles])


def _aligned(toward: Array, spins: Array) -> Array:
    """Rotations (n, 3, 3) that take ``toward`` to (0, 0, -1), each spun about that axis by one of ``spins``."""
    z = -toward / np.linalg.norm(toward)
    x = np.cross(spins[:, 1], z)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return np.stack([x, np.cross(z, x), np.broadcast_to(z, x.shape)], axis=1)


def _surface(view: DepthImage) -> tuple[Array, Array]:
    """Some 200 points of the surface, and normals towards the source, in the source's frame."""
    height, width = view.depth.shape
    y, x = np.mgrid[:height, :width].astype(np.float64)
    z = np.where(view.valid, view.depth, np.nan).astype(np.float64)
    point = np.stack([x, y, np.ones_like(x)], axis=-1) @ np.linalg.inv(view.camera.K).T
    if view.camera.projection == "perspective":
        point *= z[..., None]
    else:
        point[..., 2] = z
    normal = np.full_like(point, np.nan)
    normal[:-1, :-1] = np.cross(point[1:, :-1] - point[:-1, :-1], point[:-1, 1:] - point[:-1, :-1])
    step = max(1, max(width, height) // 15)
    point, normal = point[::step, ::step].reshape(-1, 3), normal[::step, ::step].reshape(-1, 3)
    usable = np.isfinite(point).all(axis=1) & np.isfinite(normal).all(axis=1)
    return point[usable], normal[usable]


def _share_seen(
    view: DepthImage, point: Array, normal: Array, rotation: Array, center: Array, K: Array, size: Size, projection: str
) -> Array:
    """(n,) approximate fraction of each target image that shows the surface's front; 0 for cameras behind it."""
    n = len(center)
    turned = (point @ rotation.transpose(1, 0, 2).reshape(3, 3 * n)).reshape(len(point), n, 3)
    x, y, z = (turned - np.einsum("ni,nij->nj", center, rotation)).transpose(2, 0, 1)  # (points, n) each
    ahead = z > 0.4
    with np.errstate(divide="ignore", invalid="ignore"):
        if projection == "perspective":
            facing = normal @ center.T > (normal * point).sum(axis=1, keepdims=True)
            x, y = x / z, y / z
            allowed = ~_behind_surface(view, center)
        else:
            facing = normal @ rotation[:, :, 2].T < 0
            allowed = ahead.all(axis=0)
        column = np.floor(_CELLS * (K[0, 0] * x + K[0, 2] + 0.5) / size[0])
        row = np.floor(_CELLS * (K[1, 1] * y + K[1, 2] + 0.5) / size[1])
    seen = ahead & facing & allowed & (column >= 0) & (column < _CELLS) & (row >= 0) & (row < _CELLS)
    hit = np.zeros((n, _CELLS**2), dtype=bool)
    hit[np.nonzero(seen)[1], (column[seen] + _CELLS * row[seen]).astype(int)] = True
    return hit.mean(axis=1)


def _behind_surface(view: DepthImage, center: Array) -> Array:
    """(n,) bool: centres, in the source's frame, deeper than 3/4 of the source's depth at the pixel they project to."""
    height, width = view.depth.shape
    scale = center[:, 2:] if view.camera.projection == "perspective" else np.ones((len(center), 1))
    with np.errstate(divide="ignore", invalid="ignore"):
        pixel = center[:, :2] / scale @ view.camera.K[:2, :2].T + view.camera.K[:2, 2]
    inside = (center[:, 2] > 0) & (pixel >= 0).all(axis=1) & (pixel <= [width - 1, height - 1]).all(axis=1)
    column, row = np.round(np.where(inside[:, None], pixel, 0)).astype(int).T
    return inside & ~(center[:, 2] < 0.75 * view.depth[row, column])
