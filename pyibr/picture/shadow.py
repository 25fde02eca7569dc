"""Shadow maps: depths of the scene from the light (Williams 1978)."""

from __future__ import annotations

import weakref
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera
from pyibr.core.checks import Float64, Immutable
from pyibr.opencl.device_cache import cached_on_device
from pyibr.opencl.headers import struct
from pyibr.opencl.launch import Struct
from pyibr.opencl.memory import DeviceArray, copy, empty, upload
from pyibr.picture.light import Light
from pyibr.picture.target import Target

Bounds = tuple[NDArray[Any], NDArray[Any]]

_ANGLE_MAX = 120.0  # degrees that one perspective map may cover: for wider angles, texels at its edge get too large
_MARGIN = 4  # texels left free around a map: points are moved by up to 2 texels, and reads reach 1 texel farther
_THIN = 1e-6  # least extent of a map, relative to the longer side
_ANGLE_MIN = 1e-3  # degrees that a perspective map covers at least


@dataclass(frozen=True)
class Lighting:
    """A light and its shadow maps.

    Attributes
    ----------
    light : Light
    maps : DeviceArray or None
        (M * size, size) float32: planar depths, M maps one below the other; None without shadows.
    cameras : list of Camera
        Cameras of the maps.
    opaque : DeviceArray or None
        The maps of opaque things alone. Their shadows fall on things that are blended, such as Gaussians.
    """

    light: Light
    maps: DeviceArray | None = None
    cameras: Sequence[Camera] = ()
    opaque: DeviceArray | None = None

    @property
    def defines(self) -> dict[str, int]:
        """Defines of kernels with a light."""
        return {"LIT": 1} if self.maps is None else {"LIT": 1, "SHADOWED": 1}

    def arguments(self, *, bias: float = 0.0, origin: Float64 | None = None, opaque: bool = False) -> dict[str, Any]:
        """Return the arguments of kernels with a light, by name.

        Parameters
        ----------
        bias : float
            Shadow bias in scene units, as for `pyibr.picture.deferred.entry_for`.
        origin : (3,), optional
            Origin of the kernel's points, in the world.
        opaque : bool
            Whether only opaque things cast shadows.
        """
        start = np.zeros(3) if origin is None else origin
        made: dict[str, Any] = {"light": Struct("Light", self.light.struct(start))}
        if self.maps is not None:
            maps = self.opaque if opaque else self.maps
            made |= {"shadow_maps": maps, "shadow_views": upload(self._views(start))}
            made |= {"shadow": Struct("Shadow", self._shadow(bias))}
        return made

    def _views(self, origin: Float64) -> NDArray[np.float32]:
        """Return the maps' cameras in the kernels' format, for points relative to an origin."""
        shift = np.eye(4)
        shift[:3, 3] = origin
        from_origin = [camera.camera_from_world @ shift for camera in self.cameras]
        pixel_maps = [
            np.append(camera.pixel_matrix @ one, one[2]) for camera, one in zip(self.cameras, from_origin, strict=True)
        ]
        return np.array(pixel_maps, np.float32)

    def _shadow(self, bias: float) -> NDArray[np.void]:
        """Return a record of the kernels' struct Shadow."""
        values = np.zeros((), struct("lib/light.h", "Shadow"))
        values["maps"], values["size"] = len(self.cameras), self.light.shadow_size
        values["texel_x"], values["texel_y"] = 1 / self.cameras[0].K[0, 0], 1 / self.cameras[0].K[1, 1]
        values["bias"] = min(bias, float(np.finfo(np.float32).max))  # noise of extreme depths may exceed float32
        return values


@dataclass(frozen=True)
class _CachedMaps:
    """Shadow maps of a light's last scene. They hold no reference to the light, so that it can be freed."""

    things: Sequence[weakref.ref[Immutable]]
    maps: DeviceArray
    cameras: Sequence[Camera]
    opaque: DeviceArray

    def is_of(self, things: Sequence[object]) -> bool:
        return len(things) == len(self.things) and all(a() is b for a, b in zip(self.things, things, strict=True))


def lighting(
    light: Light,
    things: Sequence[object],
    bounds: Sequence[Bounds],
    draw: Callable[[Target], None],
    blend: Callable[[Target], None] | None,
    dtype: np.dtype[Any],
) -> Lighting:
    """Return the lighting of a scene; draw its shadow maps, if the light casts shadows.

    A light keeps the maps of its last scene: pictures from other cameras reuse them as long as no thing changes. Maps
    are kept only if all things are `Immutable`; others may change unnoticed.

    bounds: (low, high) of each thing, in the world. draw: draws the opaque things into a target whose colours have the
    `dtype` of the picture. blend: adds the other things, if there are any.
    """
    if not light.shadow_size:
        return Lighting(light)
    last = cached_on_device(light, "seen", lambda: list[_CachedMaps]())
    for seen in list(last):  # a copy: another thread may draw maps of another scene
        if seen.is_of(things):
            return Lighting(light, seen.maps, seen.cameras, seen.opaque)
    last.clear()
    cameras = light_cameras(light, bounds)
    size = light.shadow_size
    opaque = maps = empty((len(cameras) * size, size), np.float32)
    if blend is not None:
        maps = empty(opaque.shape, np.float32)
    for number, camera in enumerate(cameras):
        target = Target(camera, dtype, from_light=True)
        draw(target)
        copy(target.depth, opaque, number * size * size)
        if blend is not None:
            blend(target)
            copy(target.depth, maps, number * size * size)
    fixed = [thing for thing in things if isinstance(thing, Immutable)]
    if len(fixed) == len(things):
        last[:] = [_CachedMaps([weakref.ref(thing) for thing in fixed], maps, cameras, opaque)]
    return Lighting(light, maps, cameras, opaque)


def light_cameras(light: Light, bounds: Sequence[Bounds]) -> list[Camera]:
    """Return one camera that sees the scene from the light, or six for a wide spot or a point light near the scene."""
    low = np.min([np.asarray(b[0], np.float64) for b in bounds], axis=0)
    high = np.max([np.asarray(b[1], np.float64) for b in bounds], axis=0)
    corners = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1).T
    middle, n = 0.5 * (low + high), light.shadow_size
    if light.position is None and light.direction is not None:
        return [_far_camera(light.direction, corners, n)]
    assert light.position is not None
    if light.direction is not None:
        axis, angle = light.direction, light.angle
    else:  # covers the sphere around the box
        axis = middle - light.position
        radius, distance = float(np.linalg.norm(high - low)) / 2, float(np.linalg.norm(axis))
        angle = 2 * float(np.degrees(np.arcsin(radius / distance))) if radius < distance else 180.0
    if angle <= _ANGLE_MAX:
        return [_camera(light.position, axis, n, max(angle, _ANGLE_MIN))]
    axes = [sign * one for one in np.eye(3) for sign in (1.0, -1.0)]
    return [_camera(light.position, one, n, 90) for one in axes]


def _pose(position: Float64, forward: Float64) -> Float64:
    forward = forward / np.abs(forward).max()  # avoids overflow of squares
    forward /= np.linalg.norm(forward)
    right = np.cross(np.eye(3)[np.abs(forward).argmin()], forward)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([right, np.cross(forward, right), forward])
    pose[:3, 3] = position
    return pose


def _inside(n: int) -> int:
    """Texels per side without the margins."""
    return max(n - 2 * _MARGIN, n // 2)


def _camera(position: Float64, forward: Float64, n: int, angle: float) -> Camera:
    focal = 0.5 * _inside(n) / np.tan(np.radians(angle) / 2)
    return Camera([[focal, 0, (n - 1) / 2], [0, focal, (n - 1) / 2], [0, 0, 1]], (n, n), _pose(position, forward))


def _far_camera(direction: Float64, corners: Float64, n: int) -> Camera:
    """An orthographic camera around the corners of the scene's box."""
    pose = _pose(np.zeros(3), direction)
    inside = corners @ pose[:3, :3]
    low, high = inside.min(axis=0), inside.max(axis=0)
    extent = np.maximum(high - low, _THIN * (float((high - low).max()) or 1.0))
    pose[:3, 3] = pose[:3, :3] @ np.array([*(0.5 * (low + high))[:2], low[2] - 0.01 * extent.max()])
    fx, fy = _inside(n) / extent[:2]
    return Camera([[fx, 0, (n - 1) / 2], [0, fy, (n - 1) / 2], [0, 0, 1]], (n, n), pose, projection="orthographic")
