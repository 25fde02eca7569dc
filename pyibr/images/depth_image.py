"""An image with depth: a sampled surface.

Depth in pyibr is planar: the z of a surface point in the camera's frame, in scene units. A sample whose depth is not
finite or not > 0 is invalid: it has no surface. Infinite depth means empty space; any other invalid depth is unknown.
"""

from __future__ import annotations

import itertools
import math
from functools import cached_property, partial
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera
from pyibr.core.checks import (
    Float64,
    Immutable,
    checked_bool,
    checked_colors,
    describe,
    fits,
    instance_of,
    locked,
    one_of,
    plain_array,
    positive,
    positive_or_infinite,
    shape_text,
)
from pyibr.core.errors import ArgumentError
from pyibr.core.undistortion import rays_of
from pyibr.images.noise import DepthNoise, Noise, checked_noise
from pyibr.images.pictures import Pictured

Color = NDArray[np.uint8] | NDArray[np.float32]
Features = NDArray[np.uint8] | NDArray[np.float16] | NDArray[np.float32]
Depth = NDArray[np.float32]
Side = Literal["front", "back", "both"]
"""Side of a depth image's surface: the front faces its camera."""
DefaultDepth = Literal["farthest"]

_UNIT = 1e-3  # tolerance of squared lengths: float32 or rounded normals are not exactly of length 1
_LEAST_NEAR = 1e-3  # least nearness half a pixel beside a sample, relative to the sample's nearness
_EVEN = 0.005  # relative difference of nearness below which neighbours are one surface
_CHANNELS_MAX = 1024  # of features
_CHUNK = 1 << 15  # samples per chunk: float64 values of larger chunks take several times longer


class DepthImage(Immutable, Pictured):
    """An image with a depth for each pixel, and the camera that took it: a sampled surface.

    Parameters
    ----------
    color : (H, W, 3) uint8, or float32 in [0, 1]; or None
        With None, the image holds depth alone: `pyibr.warp` then renders only depth, and pictures show the view in
        white.
    depth : (H, W) float32
        Planar z in scene units. Infinite depth means that the ray meets no surface; other views' surfaces end there.
        NaN or a depth <= 0 is unknown and does not affect other views. Convert other kinds of depth first, with
        `depth_from_uint16`, `depth_from_disparity`, `depth_from_euclidean` or `depth_from_mpeg`.
    camera : Camera
        Its size is (W, H). An image with a lens is drawn after `pyibr.undistorted` removes the distortion.
    far : float
        Samples at this depth or beyond are not surface: their rays pass through empty space.
    default_depth : float or "farthest", optional
        Depth for samples without a surface, such as sky and windows, so that new views show their colours instead of
        holes; "farthest" takes the depth of the farthest sample. `depth` is copied, and `far` becomes infinite.
    normals : (H, W, 3) float32, optional
        Surface normals in the camera's frame (x right, y down, z forward), towards the camera, of any length; NaN or 0
        where unknown. A `Light` with `relight` shades by them. Unknown normals are computed from the depths.
    noise : float, (a, b, c) or callable, optional
        Noise of the depth. A number is the standard deviation of 1 / depth, as for stereo and structured light
        (`disparity_noise`); for an orthographic camera, it is the standard deviation of the depth. Three numbers give
        a z^2 + b z + c at depth z. A function maps depths, (n,) float64, to deviations, (n,). By default, the noise is
        estimated from the samples. Depth edges are found, and views weighted for blending, with regard to the noise;
        `clean_depth` takes the same argument.
    features : (H, W, C) uint8, float16 or float32, optional
        Further values of each sample, such as a network's features or labels: 1 to 1,024 channels of any range.
        `pyibr.warp` carries them over to `Frame.features`; pictures, files, light and fills do not use them.
    guessed : bool
        The samples are guesses of surface that other views do not see (`background_layer`). `warp` and `render` show
        them only in holes, as one surface without depth edges; `valid` stays False there. They cast no shadows, and
        solids refuse them.

    Attributes
    ----------
    noise : (a, b, c)
        The depth's noise has a standard deviation of about a z^2 + b z + c at depth z. If not given, it is estimated on
        first use.
    color, depth, camera, far, normals, features, guessed
        As given, except where `default_depth` changes them. `color` has the shape (H, W, 0) if there is none; `normals`
        have length 1, NaN where unknown, or are None. C-contiguous arrays are not copied, and are read-only through
        this object. Do not change the arrays or their originals afterwards: copies on the device would not follow.

    Raises
    ------
    ArgumentError
        If shapes, dtypes and camera do not fit together, or most normals point away from the camera.

    Examples
    --------
    >>> import numpy as np
    >>> import pyibr as ibr
    >>> camera = ibr.Camera([[50, 0, 3], [0, 50, 6], [0, 0, 1]], (7, 13))
    >>> view = ibr.DepthImage(np.zeros((13, 7, 3), np.uint8), np.full((13, 7), 2, np.float32), camera)
    >>> bool(view.valid.all())
    True
    """

    color: Color
    depth: Depth
    camera: Camera
    far: float
    normals: NDArray[np.float32] | None
    features: Features | None
    guessed: bool

    def __init__(
        self,
        color: Color | None,
        depth: Depth,
        camera: Camera,
        *,
        far: float = math.inf,
        default_depth: float | DefaultDepth | None = None,
        normals: NDArray[np.float32] | None = None,
        noise: Noise | DepthNoise | None = None,
        features: Features | None = None,
        guessed: bool = False,
    ) -> None:
        instance_of("camera", camera, Camera, "a pyibr.Camera")
        shape = camera.height, camera.width
        self.camera = camera
        limit = positive_or_infinite("far", far, "a depth > 0")
        given_color = np.empty((*shape, 0), np.uint8) if color is None else checked_colors("color", color, (*shape, 3))
        self.color = locked(given_color)
        stored = checked_depth(depth, shape)
        self.depth = locked(stored if default_depth is None else _backed(stored, limit, default_depth))
        self.far = limit if default_depth is None else math.inf
        self.normals = None if normals is None else locked(_checked_normals(normals, camera))
        if not isinstance(noise, DepthNoise):  # a DepthNoise comes from another image with the same depth
            given = None if noise is None else checked_noise(noise, self.depth, self.far, camera.projection)
            noise = DepthNoise(self.depth, self.far, given)
        self.depth_noise = noise  # shared with images of the same depth in other colours
        self.features = None if features is None else locked(checked_features("features", features, shape))
        self.guessed = checked_bool("guessed", guessed)

    def __reduce__(self) -> tuple[partial[DepthImage], tuple[object, ...]]:
        color = self.color if self.has_color else None
        options = {"far": self.far, "normals": self.normals, "noise": self.depth_noise.given}
        options |= {"features": self.features, "guessed": self.guessed}
        return partial(DepthImage, **options), (color, self.depth, self.camera)

    def _with_color(self, color: Color | None) -> DepthImage:
        """The same image in other colours."""
        return DepthImage(
            color,
            self.depth,
            self.camera,
            far=self.far,
            normals=self.normals,
            noise=self.depth_noise,
            features=self.features,
            guessed=self.guessed,
        )

    def __repr__(self) -> str:
        color = self.color.dtype if self.has_color else "depth alone"
        return f"<DepthImage {self.camera.width}x{self.camera.height} {color} far={self.far:g}>"

    @property
    def has_color(self) -> bool:
        """Tell whether the image has colours."""
        return self.color.shape[2] > 0

    @cached_property
    def shown_color(self) -> Color:
        """(H, W, 3) colours; white if there are none. Computed on first use."""
        return self.color if self.has_color else locked(np.full((*self.depth.shape, 3), 255, np.uint8))

    @property
    def in_color(self) -> DepthImage:
        """The same image with `shown_color`; itself if it has colours. Computed on first use."""
        return self if self.has_color else self._in_white

    @cached_property
    def valid(self) -> NDArray[np.bool_]:
        """(H, W) True where the depth is finite, > 0, < `far`, and the lens has a ray. Computed on first use."""
        valid = (self.depth > 0) & (self.depth < self.far)
        if self.camera.lens is not None:
            valid &= np.isfinite(rays_of(self.camera)[..., 0])
        return locked(valid)

    @cached_property
    def sees_empty_space(self) -> bool:
        """Tell whether any depth is infinite, or `far` or more. Computed on first use."""
        return bool((self.depth >= self.far).any())

    @property
    def known_depth(self) -> Depth:
        """(H, W) depth, NaN where invalid."""
        return np.where(self.valid, self.depth, np.float32(np.nan))

    @property
    def in_float(self) -> DepthImage:
        """The same image with float32 colours; itself if it has them. Cached, so that its buffers are reused."""
        return self if self.color.dtype == np.float32 else self._from_bytes

    # The two properties above are not cached: an image that refers to itself is freed late, by garbage collection.
    @cached_property
    def _in_white(self) -> DepthImage:
        return self._with_color(self.shown_color)

    @cached_property
    def _from_bytes(self) -> DepthImage:
        return self._with_color((self.shown_color * np.float32(1 / 255)).astype(np.float32))

    @property
    def noise(self) -> tuple[float, float, float]:
        return self.depth_noise.deviation

    @property
    def steps(self) -> tuple[float, float, float]:
        """(a, b, c): if depths are quantized, levels at depth z lie a z^2 + b z + c apart. Estimated on first use."""
        return self.depth_noise.steps

    @property
    def points(self) -> Float64:
        """(N, 3) float64: positions of the valid samples in the world, in scene units, row by row."""
        return self._points_of(self.valid)

    def _points_of(self, which: NDArray[np.bool_]) -> Float64:
        z = self.depth[which].astype(np.float64)
        local = np.column_stack([rays_of(self.camera)[which], z])
        if self.camera.projection == "perspective":
            local[:, :2] *= z[:, None]
        return local @ self.camera.world_from_camera[:3, :3].T + self.camera.center

    @cached_property
    def bounds(self) -> tuple[Float64, Float64]:
        """(low, high), each (3,), in the world: the box around the valid samples. Computed on first use."""
        return self.bounds_of(self.valid)

    @cached_property
    def surface_bounds(self) -> tuple[Float64, Float64]:
        """(low, high), each (3,): the box around the surface, which extends to the edges of the samples' pixels."""
        low, high = self.bounds
        beyond = self._beyond(low, high)
        return np.minimum(low, beyond.min(axis=0, initial=np.inf)), np.maximum(
            high, beyond.max(axis=0, initial=-np.inf)
        )

    def _beyond(self, low: Float64, high: Float64) -> Float64:
        """(N, 3) float64: surface points at the pixel edges of samples next to the border, to holes and to steps.

        Samples whose pixels lie inside the box from `low` to `high` are left out.
        """
        if self.camera.lens is not None:
            return np.empty((0, 3))
        perspective = self.camera.projection == "perspective"
        with np.errstate(divide="ignore"):
            z = self.depth.astype(np.float64)
            near = np.pad(np.where(self.valid, 1 / z if perspective else -z, np.nan), 1, constant_values=np.nan)
        here = near[1:-1, 1:-1]
        change = {(1, 0): near[1:-1, 2:] - here, (-1, 0): near[1:-1, :-2] - here}
        change |= {(0, 1): near[2:, 1:-1] - here, (0, -1): near[:-2, 1:-1] - here}
        even = [np.abs(by) <= _EVEN * np.abs(here) for by in change.values()]  # False next to missing samples
        y, x = np.nonzero(self.valid & ~np.logical_and.reduce(even))
        here = here[y, x]
        rises: dict[tuple[int, int], list[Float64]] = {}  # least and greatest change to the edge of the pixel
        for (dx, dy), by in change.items():
            straight = np.clip(-change[-dx, -dy][y, x], -np.abs(here), np.abs(here))  # extrapolated
            ways = [np.nan_to_num(by[y, x]) / 2, np.nan_to_num(straight) / 2, np.zeros(len(here))]
            rises[dx, dy] = [np.min(ways, axis=0), np.max(ways, axis=0)]
        reaches = self._may_leave(low, high, np.column_stack([x, y]).astype(np.float64), here, rises)
        x, y, here = x[reaches], y[reaches], here[reaches]
        rises = {side: [rise[reaches] for rise in both] for side, both in rises.items()}
        pixels, depths = list[Float64](), list[Float64]()
        for (dx, dy), which in itertools.product(itertools.product((-1, 1), repeat=2), (0, 1)):
            reach = here + rises[dx, 0][which] + rises[0, dy][which]
            reach = np.maximum(reach, _LEAST_NEAR * here) if perspective else reach
            for i, j in ((dx / 2, 0.0), (0.0, dy / 2), (dx / 2, dy / 2)):
                pixels.append(np.column_stack([x + i, y + j]).astype(np.float64))
                depths.append(1 / reach if perspective else -reach)
        points = self.camera.unproject(np.concatenate(pixels), np.concatenate(depths))
        return points[np.isfinite(points).all(axis=1)]

    def _may_leave(
        self, low: Float64, high: Float64, pixels: Float64, near: Float64, rises: dict[tuple[int, int], list[Float64]]
    ) -> NDArray[np.bool_]:
        """Tell which samples' pixels may leave a box, by a limit of their size."""
        sizes = {side: np.abs(both).max(axis=0) for side, both in rises.items()}
        rise = np.maximum(sizes[1, 0], sizes[-1, 0]) + np.maximum(sizes[0, 1], sizes[0, -1])
        to_camera, (width, height) = np.linalg.inv(self.camera.K), self.camera.size
        half = 0.5 * np.abs(to_camera[:2, :2]).sum()
        if self.camera.projection == "perspective":
            corners = np.array([[x, y, 1] for x in (0, width) for y in (0, height)])
            longest = np.linalg.norm(corners @ to_camera.T, axis=1).max()
            depth, farthest = 1 / near, 1 / np.maximum(near - rise, _LEAST_NEAR * near)
            reach = longest * (farthest - depth) + half * farthest
        else:
            depth, reach = -near, rise + half
        points = self.camera.unproject(pixels, depth)
        return np.asarray(((points - reach[:, None] <= low) | (points + reach[:, None] >= high)).any(axis=1))

    def bounds_of(self, which: NDArray[np.bool_], axes: Float64 | None = None) -> tuple[Float64, Float64]:
        """(low, high), each (3,): the box around the samples selected by `which`, (H, W) bool, all of them valid.

        The box is aligned with the rows of `axes`, (3, 3), or with the world's axes.
        """
        rows_of = np.eye(3) if axes is None else axes
        center = rows_of @ self.camera.center
        if not which.any():
            return center, center
        if self.camera.lens is not None:
            points = self._points_of(which) @ rows_of.T
            return np.nanmin(points, axis=0), np.nanmax(points, axis=0)
        turn, x = rows_of @ self.camera.world_from_camera[:3, :3], np.arange(self.camera.width)
        across, perspective = turn[:, :2] @ np.linalg.inv(self.camera.K)[:2], self.camera.projection == "perspective"
        low, high = np.full(3, np.inf), np.full(3, -np.inf)
        rows = max(_CHUNK // self.camera.width, 1)
        for first in range(0, self.camera.height, rows):
            part = slice(first, first + rows)
            z = np.where(which[part], self.depth[part], np.float64(np.nan))
            y = np.arange(first, first + len(z))[:, None]
            for axis, ((a, b, c), along) in enumerate(zip(across, turn[:, 2], strict=True)):
                aside = a * x + (b * y + c)
                values = (aside + along) * z if perspective else aside + along * z
                low[axis] = np.fmin(low[axis], np.fmin.reduce(values, axis=None))
                high[axis] = np.fmax(high[axis], np.fmax.reduce(values, axis=None))
        return low + center, high + center


def _backed(depth: Depth, far: float, default_depth: float | DefaultDepth) -> Depth:
    """Return the depth, with `default_depth` for samples without a surface in front of `far`."""
    valid = (depth > 0) & (depth < far)
    if isinstance(default_depth, str):
        one_of("default_depth", default_depth, DefaultDepth, " or a depth > 0")
        if not valid.any():
            raise ArgumentError("default_depth", "a depth > 0 for a view with no samples", describe(default_depth))
        behind = depth[valid].max()
    else:
        with np.errstate(over="ignore"):
            behind = np.float32(positive("default_depth", default_depth, 'a depth > 0 or "farthest"'))
        if not 0 < behind < np.inf:
            raise ArgumentError("default_depth", "a depth in the range of float32", describe(default_depth))
    return np.where(valid, depth, behind)


def _checked_normals(normals: object, camera: Camera) -> NDArray[np.float32]:
    """Normals of unit length, NaN where unknown."""
    shape = camera.height, camera.width, 3
    expected = f"float32 of shape {shape_text(shape)}, normals in the camera's frame"
    array = plain_array("normals", normals, expected, math.nan)
    if not fits(array, shape) or array.dtype.kind != "f":
        raise ArgumentError("normals", expected, describe(array))
    made = array.astype(np.float32, copy=False)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        squares = np.einsum("yxc,yxc->yx", made, made)[..., None]
        if not (abs(squares - 1) < _UNIT).all():  # unit normals are kept without a copy
            largest = abs(made).max(axis=-1, keepdims=True)  # squares may exceed float32
            near_1 = made / largest
            known = np.isfinite(largest) & (largest > 0)
            made = np.where(known, near_1 / np.linalg.norm(near_1, axis=-1, keepdims=True), np.float32(np.nan))
        along = made[..., 2]
        if camera.projection == "perspective":
            along = along + np.einsum("yxc,yxc->yx", made[..., :2], rays_of(camera).astype(np.float32))
        away, towards = np.count_nonzero(along > 0), np.count_nonzero(along < 0)
    if away > towards:
        expected = "normals towards the camera: in its frame (x right, y down, z forward) most have z < 0"
        raise ArgumentError("normals", expected, f"{away} of {away + towards} that point away from it")
    return made


def checked_features(argument: str, features: object, shape: tuple[int, int]) -> Features:
    """Return features of an image of `shape` with at least one channel, or raise ArgumentError."""
    expected = f"uint8, float16 or float32 of shape {shape_text((*shape, None))}, 1 to {_CHANNELS_MAX} channels"
    array = plain_array(argument, features, expected)
    if not fits(array, (*shape, None)) or array.dtype.name not in ("uint8", "float16", "float32"):
        raise ArgumentError(argument, expected, describe(array if isinstance(features, np.ndarray) else features))
    if not 1 <= array.shape[2] <= _CHANNELS_MAX:
        raise ArgumentError(argument, expected, describe(array))
    return array


def checked_depth(depth: object, shape: tuple[int | None, ...], argument: str = "depth") -> Depth:
    """Return planar depth of `shape` (None fits any length) as float32, NaN where masked, or raise ArgumentError."""
    expected = f"float32 of shape {shape_text(shape)}, planar z in scene units"
    array = plain_array(argument, depth, expected, math.nan)
    if not fits(array, shape) or 0 in array.shape or array.dtype.kind != "f":
        hint = " (depth_from_uint16 converts integers with a scale)" if array.dtype.kind in "iu" else ""
        raise ArgumentError(argument, expected, describe(array if isinstance(depth, np.ndarray) else depth) + hint)
    if array.dtype == np.float32:
        return array
    with np.errstate(over="ignore"):  # depths beyond the range of float32 become infinite
        return array.astype(np.float32)


def check_seen(view: DepthImage, number: int) -> None:
    """Raise ArgumentError if a view of a solid is a guess, which would cut the solid's parts in front of it away."""
    if view.guessed:
        raise ArgumentError("views", "views that saw the object", f"a guess (guessed=True) as view {number}")
