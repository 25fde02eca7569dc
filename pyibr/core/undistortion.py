"""Cameras of undistorted images: pinholes that replace a lens, and the pixel maps between both images.

An undistorted image has the same or finer sampling than the lens's image everywhere. It reaches up to `ANGLE_MAX`
degrees from the axis. A target that sees farther is drawn as several images, the faces of a cube.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera
from pyibr.core.checks import Float64, Immutable, locked, read_only
from pyibr.core.errors import ArgumentError

ANGLE_MAX = 75.0
"""Largest angle from the axis in an undistorted image, in degrees; farther out, many pixels would show little."""

_Made = TypeVar("_Made")

_MARGIN = 2  # pixels around the seen part: neighbours that distinguish edges from slopes
_BORDER = 0.75  # pixels outside the image that still show its border: half an oblique undistorted pixel
_PIXELS_RATIO_MAX = 100  # limit of an undistorted image's pixels per pixel of the lens's image; real cameras: up to 15
_REACH_PART = 1 - 1e-9  # fraction of a lens's reach that stays inside the reach despite rounding
_FACES = (  # right, down and forward axes of a cube's faces in the camera's frame, the front first
    ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    ((0, 0, -1), (0, 1, 0), (1, 0, 0)),
    ((0, 0, 1), (0, 1, 0), (-1, 0, 0)),
    ((1, 0, 0), (0, 0, -1), (0, 1, 0)),
    ((1, 0, 0), (0, 0, 1), (0, -1, 0)),
)


def _cached(count: int) -> Callable[[Callable[[Camera], _Made]], Callable[[Camera], _Made]]:
    """Cache `count` results of a function of a camera's lens and pixels; it gets the camera at the origin."""

    def decorated(function: Callable[[Camera], _Made]) -> Callable[[Camera], _Made]:
        known = functools.lru_cache(maxsize=count)(function)

        @functools.wraps(function)
        def of_camera(camera: Camera) -> _Made:
            return known(_unposed(camera))

        return of_camera

    return decorated


def _unposed(camera: Camera) -> Camera:
    return Camera(camera.K, camera.size, lens=camera.lens)


def rays_of(camera: Camera) -> Float64:
    """(H, W, 2) points of the pixels' rays on the plane z = 1 of the camera's frame; NaN outside the lens's view."""
    return _rays_through(camera) if camera.lens else _rays(camera)


@_cached(4)
def _rays_through(camera: Camera) -> Float64:
    return read_only(_rays(camera))


def _rays(camera: Camera) -> Float64:
    pixels = np.stack(np.meshgrid(*map(np.arange, camera.size)), -1).reshape(-1, 2)
    return camera.ideal_positions(pixels).reshape(camera.height, camera.width, 2)


def undistorted_camera(camera: Camera) -> Camera:
    """The pinhole camera of the undistorted image, which reaches up to `ANGLE_MAX` degrees from the axis."""
    if camera.lens is None:
        return camera
    unposed = _undistorted(camera)
    return Camera(unposed.K, unposed.size, camera.world_from_camera)


@_cached(32)
def _undistorted(camera: Camera) -> Camera:
    rays = rays_of(camera)
    own = np.isfinite(rays[..., 0]) & ~sees_too_far(camera)
    return _camera_around(camera, rays, own)


def covering_camera(argument: str, camera: Camera) -> Camera:
    """`undistorted_camera` of a lens within `ANGLE_MAX` degrees of its axis, or raise ArgumentError."""
    if camera.lens is not None and sees_too_far(camera).any():
        raise ArgumentError(argument, f"a camera that sees up to {ANGLE_MAX:g} degrees from its axis", repr(camera))
    return undistorted_camera(camera)


def check_no_lens(argument: str, camera: Camera) -> None:
    """Raise ArgumentError if a camera has a lens, for functions that support none."""
    if camera.lens is not None:
        raise ArgumentError(argument, "a camera without a lens", repr(camera))


def distorted_pixels(camera: Camera, pixels: Float64) -> Float64:
    """(N, 2) pixels of a lens's image for pixels (N, 2) of its undistorted image."""
    unposed = _unposed(camera)
    return unposed.project(_undistorted(unposed).unproject(pixels, np.ones(len(pixels))))[0]


def origins_in_lens(camera: Camera, pixels: Float64) -> Float64:
    """`distorted_pixels` of points that the lens sees: pixels beyond its reach by rounding are moved back into it."""
    unposed = _unposed(camera)
    points = _undistorted(unposed).unproject(pixels, np.ones(len(pixels)))
    if camera.lens is not None:
        away = np.hypot(points[:, 0], points[:, 1])
        points[:, :2] *= np.minimum(_REACH_PART * camera.lens.reach / np.maximum(away, 1e-300), 1.0)[:, None]
    return unposed.project(points)[0]


@_cached(4)
def sees_too_far(camera: Camera) -> NDArray[np.bool_]:
    """(H, W) bool, the pixels of a lens's image that see more than `ANGLE_MAX` degrees from the axis."""
    return locked(np.hypot(*np.moveaxis(rays_of(camera), 2, 0)) > math.tan(math.radians(ANGLE_MAX)))


class PixelPositions(Immutable):
    """Positions of one image's pixels in another image.

    places: (2, H, W) float32, u and v in the other image; NaN for pixels outside it.
    """

    def __init__(self, places: NDArray[np.float32]) -> None:
        self.places = places


@_cached(8)
def positions_in_lens(camera: Camera) -> PixelPositions:
    """Positions of the undistorted image's pixels; pixels up to half a pixel outside go to the lens's border."""
    pinhole = _undistorted(camera)
    pixels = np.stack(np.meshgrid(*map(np.arange, pinhole.size)), -1).reshape(-1, 2)
    at = distorted_pixels(camera, pixels.astype(np.float64)).reshape(pinhole.height, pinhole.width, 2)
    last = np.array(camera.size) - 1
    inside = np.asarray(((at >= -_BORDER) & (at <= last + _BORDER)).all(axis=2), np.bool_)
    at = np.clip(np.where(inside[..., None], at, 0), 0, last)
    unseen = np.isnan(rays_of(camera)[..., 0])
    if unseen.any():  # next to samples that the lens does not see, the nearest sample is used alone
        x, y = np.moveaxis(at.astype(np.intp), 2, 0)
        beside, below = np.minimum(x + 1, last[0]), np.minimum(y + 1, last[1])
        some = unseen[y, x] | unseen[y, beside] | unseen[below, x] | unseen[below, beside]
        at = np.where(some[..., None], np.floor(at + 0.5), at)
        x, y = np.moveaxis(at.astype(np.intp), 2, 0)
        inside &= ~(some & unseen[y, x])
    return PixelPositions(np.where(inside, np.moveaxis(at, 2, 0), np.nan).astype(np.float32))


class CubeFace(Immutable):
    """An undistorted image of a part of a lens's view, and its camera.

    places: (3, H, W) float32, u and v of the lens's pixels in the undistorted image, NaN for pixels of other faces; and
    the ratio of depth in the lens's frame to depth in the face's frame.
    """

    def __init__(self, camera: Camera, places: NDArray[np.float32]) -> None:
        self.camera = camera
        self.places = places


@_cached(8)
def undistorted_face(camera: Camera) -> CubeFace:
    """The undistorted image as a face, with the positions of the lens's samples in it, NaN beyond `ANGLE_MAX`."""
    rays = rays_of(camera)
    within = np.isfinite(rays[..., 0]) & ~sees_too_far(camera)
    return _face(_undistorted(camera), np.where(within[..., None], rays, np.nan), np.ones(within.shape))


@_cached(8)
def cube_faces(camera: Camera) -> tuple[CubeFace, ...]:
    """The faces that a target with a lens is drawn as, with poses relative to it: one, or up to five of a wide lens."""
    rays = rays_of(camera)
    seen = np.isfinite(rays[..., 0])
    if not (seen & sees_too_far(camera)).any():
        return (undistorted_face(camera),)
    directions = np.concatenate([rays, np.ones((*seen.shape, 1))], axis=2)
    turned = [directions @ np.array(face, np.float64).T for face in _FACES]
    nearest = np.where(seen, np.argmax([there[..., 2] for there in turned], axis=0), -1)
    faces: list[CubeFace] = []
    for number, there in enumerate(turned):
        own = nearest == number
        if own.any():
            ahead = np.where(own, there[..., 2], np.nan)
            onto = there[..., :2] / ahead[..., None]
            faces.append(_face(_camera_around(camera, onto, own, np.array(_FACES[number]).T), onto, 1 / ahead))
    return tuple(faces)


def _camera_around(camera: Camera, rays: Float64, own: NDArray[np.bool_], turn: Float64 | None = None) -> Camera:
    """A pinhole whose image holds the `own` part of `rays`, (H, W, 2) points on the plane z = 1 of a turned frame."""
    at = np.where(own[..., None], rays * np.diag(camera.K)[:2], np.nan)
    steps = [np.hypot(*np.moveaxis(np.diff(at, axis=axis), 2, 0)) for axis in (0, 1)]
    least = min((float(np.nanmin(step)) for step in steps if np.isfinite(step).any()), default=1.0)
    K = np.diag([camera.K[0, 0], camera.K[1, 1], least]) / least
    low, high = (edge(at, axis=(0, 1)) / least if own.any() else np.zeros(2) for edge in (np.nanmin, np.nanmax))
    K[:2, 2] = _MARGIN - low
    extent = np.ceil(high - low) + 1
    if not extent.prod() <= _PIXELS_RATIO_MAX * camera.width * camera.height:
        came = f"{extent[0]:g} x {extent[1]:g} for {camera.width} x {camera.height}"
        raise ArgumentError(
            "lens", f"a lens whose undistorted image has at most {_PIXELS_RATIO_MAX} times the pixels", came
        )
    size = extent.astype(int) + 2 * _MARGIN
    pose = np.eye(4)
    pose[:3, :3] = np.eye(3) if turn is None else turn
    return Camera(K, (int(size[0]), int(size[1])), pose)


def _face(pinhole: Camera, rays: Float64, depth: Float64) -> CubeFace:
    """A face from `rays` on the plane z = 1 of its frame, and ratios `depth` of the lens's depth to the face's."""
    at = rays * np.diag(pinhole.K)[:2] + pinhole.K[:2, 2]
    return CubeFace(pinhole, np.stack([at[..., 0], at[..., 1], depth]).astype(np.float32))
