"""Geometry of a camera: its pose and projection, the map between an image's pixels and rays in the world."""

from __future__ import annotations

import math
from functools import cached_property, partial
from typing import Literal, NoReturn, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from pyibr.core.checks import (
    Float64,
    checked_intrinsics,
    checked_pose,
    checked_size,
    describe,
    instance_of,
    numbers,
    one_of,
    positive,
    read_only,
    warn_if_exchanged,
)
from pyibr.core.errors import ArgumentError
from pyibr.core.lens import Lens
from pyibr.core.rotations import rotation_from_opencv

Projection = Literal["perspective", "orthographic"]

_Camera = TypeVar("_Camera", bound="CameraGeometry")


FILM_DIAGONAL = math.hypot(36, 24)  # millimetres


def _focal_of(name: str, degrees: float | None, extent: int) -> float:
    """Focal length in pixels, if `extent` pixels cover these degrees."""
    half = np.radians(positive(name, degrees, "degrees between 0 and 180")) / 2
    if half >= np.pi / 2:
        raise ArgumentError(name, "degrees between 0 and 180", describe(degrees))
    return float(extent / 2 / np.tan(half))


class CameraGeometry:
    """Pose and projection of a `pyibr.Camera`, which adds files and other libraries' cameras."""

    K: Float64
    size: tuple[int, int]
    world_from_camera: Float64
    projection: Projection
    lens: Lens | None

    def __init__(
        self,
        K: ArrayLike,
        size: tuple[int, int],
        world_from_camera: ArrayLike | None = None,
        *,
        projection: Projection = "perspective",
        lens: Lens | None = None,
    ) -> None:
        one_of("projection", projection, Projection)
        if lens is not None and not instance_of("lens", lens, Lens, "a pyibr.Lens or None").bends:
            lens = None
        if lens is not None and projection == "orthographic":
            raise ArgumentError("lens", "None for an orthographic camera", describe(lens))
        pose = np.eye(4) if world_from_camera is None else checked_pose(world_from_camera)
        matrix, extent = checked_intrinsics(K), checked_size(size)
        warn_if_exchanged(matrix, extent, stacklevel=3)
        self.__dict__.update(
            K=read_only(matrix),
            size=extent,
            world_from_camera=read_only(pose),
            projection=projection,
            lens=lens,
        )

    def __setattr__(self, name: str, value: object) -> NoReturn:
        raise AttributeError(f"a {type(self).__name__} is immutable: make a new one instead of setting {name}")

    def __eq__(self, other: object) -> bool:
        return isinstance(other, CameraGeometry) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)

    def __reduce__(self) -> tuple[object, tuple[Float64, tuple[int, int], Float64]]:
        made = partial(type(self), projection=self.projection, lens=self.lens)
        return made, (self.K, self.size, self.world_from_camera)

    def __repr__(self) -> str:
        (fx, skew, cx), (_, fy, cy), _ = self.K.tolist()
        at = ", ".join(f"{v:g}" for v in self.center)
        return (
            f"<{type(self).__name__} {self.projection} {self.width}x{self.height} fx={fx:g} fy={fy:g} cx={cx:g}"
            f" cy={cy:g}{f' skew={skew:g}' if skew else ''}{f' {self.lens.model}' if self.lens else ''} at ({at})>"
        )

    @cached_property
    def _key(self) -> tuple[bytes, tuple[int, int], bytes, str, Lens | None]:
        # + 0.0 turns -0.0 into 0.0, so that equal numbers give equal bytes
        pose = (self.world_from_camera + 0.0).tobytes()
        return (self.K + 0.0).tobytes(), self.size, pose, self.projection, self.lens

    @property
    def width(self) -> int:
        """Width in pixels."""
        return self.size[0]

    @property
    def height(self) -> int:
        """Height in pixels."""
        return self.size[1]

    @cached_property
    def camera_from_world(self) -> Float64:
        """(4, 4) inverse of `world_from_camera`."""
        inverse = np.eye(4)
        inverse[:3, :3] = np.linalg.inv(self.world_from_camera[:3, :3])
        inverse[:3, 3] = -inverse[:3, :3] @ self.center
        return read_only(inverse)

    @property
    def center(self) -> Float64:
        """(3,) origin of the camera's frame in the world: a perspective camera's centre of projection."""
        return self.world_from_camera[:3, 3]

    @property
    def forward(self) -> Float64:
        """(3,) viewing direction (the camera's +z) in the world."""
        return self.world_from_camera[:3, 2]

    @cached_property
    def pixel_matrix(self) -> Float64:
        """(4, 4) map from the camera's frame to homogeneous pixel space.

        (X, Y, Z, 1) becomes (U, V, W, Q) with pixel = (U/W, V/W). A larger Q/W is nearer: it is 1/Z for a
        perspective camera and -Z for an orthographic one. The map ignores a lens.
        """
        matrix = np.zeros((4, 4))
        if self.projection == "perspective":
            matrix[:3, :3] = self.K
            matrix[3, 3] = 1
        else:
            matrix[:2, [0, 1, 3]] = self.K[:2]
            matrix[2, 3] = 1
            matrix[3, 2] = -1
        return read_only(matrix)

    @classmethod
    @np.errstate(over="ignore")
    def look_at(
        cls: type[_Camera],
        eye: ArrayLike,
        target: ArrayLike,
        up: ArrayLike,
        size: tuple[int, int],
        *,
        fov_y: float = 50.0,
        projection: Projection = "perspective",
        height: float | None = None,
    ) -> _Camera:
        """Make a camera at `eye` that sees `target` in the middle of its image.

        Parameters
        ----------
        eye, target, up : array_like (3,)
            World points in scene units, and the world direction that points up in the image.
        size : (width, height)
            In pixels, which are square.
        fov_y : float
            Angle that the image's height covers, in degrees between 0 and 180, for a perspective camera.
        projection : "perspective" or "orthographic"
        height : float
            Scene units that the image's height covers; required for an orthographic camera, else not allowed.

        Examples
        --------
        >>> import pyibr as ibr
        >>> camera = ibr.Camera.look_at((0, 0, 5), (0, 0, 0), (0, 1, 0), (61, 37), fov_y=40)
        >>> camera.forward.tolist()
        [0.0, 0.0, -1.0]
        """
        one_of("projection", projection, Projection)
        size = checked_size(size)
        at = numbers("eye", eye, (3,))
        forward = numbers("target", target, (3,)) - at
        distance = np.linalg.norm(forward)
        if distance == 0:
            raise ArgumentError("target", "a point other than eye", describe(target))
        forward /= distance
        upward = numbers("up", up, (3,))
        right = np.cross(forward, upward)
        sine = np.linalg.norm(right)
        if sine <= 1e-9 * np.linalg.norm(upward):
            raise ArgumentError("up", "a direction not along the line from eye to target", describe(up))
        right /= sine
        if projection == "perspective":
            if height is not None:
                raise ArgumentError("height", "None for a perspective camera (use fov_y)", describe(height))
            focal = _focal_of("fov_y", fov_y, size[1])
        else:
            focal = size[1] / positive("height", height, "scene units > 0 covered by the image's height")
        pose = np.eye(4)
        pose[:3] = np.column_stack([right, np.cross(forward, right), forward, at])
        K = [[focal, 0, (size[0] - 1) / 2], [0, focal, (size[1] - 1) / 2], [0, 0, 1]]
        return cls(K, size, pose, projection=projection)

    @classmethod
    def from_fov(
        cls: type[_Camera],
        size: tuple[int, int],
        *,
        fov_x: float | None = None,
        fov_y: float | None = None,
        focal_35mm: float | None = None,
        world_from_camera: ArrayLike | None = None,
    ) -> _Camera:
        """Make a perspective camera of square pixels, whose axis passes through the middle of the picture.

        Pass exactly one of `fov_x`, `fov_y` and `focal_35mm`.

        Parameters
        ----------
        size : (width, height)
        fov_x, fov_y : float
            Degrees that the width or the height covers, between 0 and 180.
        focal_35mm : float
            The 35 mm equivalent of the focal length in millimetres, as cameras and phones report it; the film's frame
            has a diagonal of 43.27 mm.
        world_from_camera : array_like (4, 4), optional

        Examples
        --------
        >>> import pyibr as ibr
        >>> ibr.Camera.from_fov((640, 480), fov_x=90)
        <Camera perspective 640x480 fx=320 fy=320 cx=319.5 cy=239.5 at (0, 0, 0)>
        """
        width, height = size = checked_size(size)
        given = {"fov_x": fov_x, "fov_y": fov_y, "focal_35mm": focal_35mm}
        named = [name for name, value in given.items() if value is not None]
        if len(named) != 1:
            raise ArgumentError("fov_x", "one of fov_x, fov_y and focal_35mm", " and ".join(named) or "none")
        if focal_35mm is not None:
            focal = positive("focal_35mm", focal_35mm, "millimetres > 0") * math.hypot(width, height) / FILM_DIAGONAL
        else:
            focal = _focal_of(named[0], given[named[0]], width if fov_x is not None else height)
        K = [[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]]
        return cls(K, size, world_from_camera)

    def moved(self: _Camera, dx: float, dy: float, dz: float) -> _Camera:
        """Return this camera moved by (dx, dy, dz) scene units along its own axes: right, down, forward."""
        pose = self.world_from_camera.copy()
        pose[:3, 3] += pose[:3, :3] @ numbers("(dx, dy, dz)", (dx, dy, dz), (3,))
        return type(self)(self.K, self.size, pose, projection=self.projection, lens=self.lens)

    def orbited(self: _Camera, degrees: float, pivot: ArrayLike, *, axis: ArrayLike | None = None) -> _Camera:
        """Return this camera rotated, with its position, about a line in the world.

        Parameters
        ----------
        degrees : float
            Right-handed about `axis`. With the default axis, a positive angle moves a camera that looks at the pivot to
            its right.
        pivot : array_like (3,)
            A world point on the line. If it is on the optical axis, its position in the image does not change.
        axis : array_like (3,)
            The line's direction in the world. Default: the camera's up direction, its -y.
        """
        (angle,) = np.radians(numbers("degrees", [degrees], (1,)))
        direction = -self.world_from_camera[:3, 1] if axis is None else numbers("axis", axis, (3,))
        length = np.linalg.norm(direction)
        if length == 0:
            raise ArgumentError("axis", "a direction", "zeros")
        center = numbers("pivot", pivot, (3,))
        turn = rotation_from_opencv(angle * direction / length)
        pose = np.eye(4)
        pose[:3, :3] = turn @ self.world_from_camera[:3, :3]
        pose[:3, 3] = turn @ (self.center - center) + center
        return type(self)(self.K, self.size, pose, projection=self.projection, lens=self.lens)

    def resized(self: _Camera, size: tuple[int, int]) -> _Camera:
        """Return the camera of the same view at another resolution; the image's borders stay in place."""
        width, height = checked_size(size)
        sx, sy = width / self.width, height / self.height
        scale = np.array([[sx, 0, (sx - 1) / 2], [0, sy, (sy - 1) / 2], [0, 0, 1]])
        return type(self)(
            scale @ self.K, (width, height), self.world_from_camera, projection=self.projection, lens=self.lens
        )

    @np.errstate(all="ignore")
    def project(self, points: ArrayLike) -> tuple[Float64, Float64]:
        """Return the pixels (N, 2) and depths (N,) of world points (N, 3).

        Nothing is clipped to the image. A perspective camera gives NaN for points with depth <= 0, and for points that
        its lens does not see.
        """
        world = numbers("points", points, (None, 3), finite=False)
        local = world @ self.camera_from_world[:3, :3].T + self.camera_from_world[:3, 3]
        depth = local[:, 2].copy()
        if self.projection == "perspective":
            local[:, :2] /= np.where(depth > 0, depth, np.nan)[:, None]
        seen = local[:, :2] if self.lens is None else self.lens.distort(local[:, :2])
        return seen @ self.K[:2, :2].T + self.K[:2, 2], depth

    @np.errstate(all="ignore")
    def unproject(self, pixels: ArrayLike, depth: ArrayLike) -> Float64:
        """Return the world points (N, 3) at `pixels` (N, 2) and planar `depth` (N,). Inverts `project`.

        NaN at pixels where the lens sees nothing.
        """
        at = numbers("pixels", pixels, (None, 2), finite=False)
        z = numbers("depth", depth, (len(at),), finite=False)
        local = np.column_stack([self.ideal_positions(at), z])
        if self.projection == "perspective":
            local[:, :2] *= z[:, None]
        return local @ self.world_from_camera[:3, :3].T + self.center

    def ideal_positions(self, pixels: ArrayLike) -> Float64:
        """Return the points (N, 2) where the rays of `pixels` (N, 2) pass the plane z = 1 of the camera's frame.

        (x, y, 1) is the ray's direction if the camera is perspective. NaN at pixels where its lens sees nothing.
        """
        at = numbers("pixels", pixels, (None, 2), finite=False)
        seen = (at - self.K[:2, 2]) @ np.linalg.inv(self.K[:2, :2]).T
        return seen if self.lens is None else self.lens.undistort(seen)
