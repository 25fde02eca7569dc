"""Clouds of 3D Gaussians, from arrays and files."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pyibr.core.checks import (
    Float64,
    Immutable,
    checked_bool,
    checked_colors,
    describe,
    fits,
    locked,
    number_from,
    numbers,
)
from pyibr.core.errors import ArgumentError
from pyibr.gaussians.drawing import Planes, blend_clouds, planes_of
from pyibr.gaussians.files import LARGEST, read_gaussians, write_gaussians
from pyibr.gaussians.packed import SH0
from pyibr.opencl.device_cache import cached_on_device
from pyibr.picture.shadow import Lighting
from pyibr.picture.target import Target

Float32 = NDArray[np.float32]

_HARMONICS = (1, 4, 9, 16)
_REACH = 3.33  # standard deviations at which an opaque Gaussian's opacity falls to 1/255
_STRAY = 0.005  # greatest share of stray Gaussians at either end of an axis
_ASTRAY = 0.25  # least distance of strays from the box around the others, in lengths of this box
_INSERTIONS = (
    (32, 0x1F00000000FFFF), (16, 0x1F0000FF0000FF), (8, 0x100F00F00F00F00F), (4, 0x10C30C30C30C30C3),
    (2, 0x1249249249249249),
)  # fmt: skip


class Gaussians(Immutable):
    """A cloud of 3D Gaussians, with the conventions of 3D Gaussian Splatting (Kerbl et al. 2023).

    `pyibr.render` blends all Gaussians of a picture together, sorted by the distance of their means, in front of the
    opaque things. The picture does not depend on the order of the Gaussians or of the clouds. `Frame.alpha` is the
    picture's opacity. The depth is that of the Gaussian at which the transmittance falls to one half, on its plane;
    pixels with more transmittance and nothing opaque behind are not valid. With a light that casts shadows, Gaussians
    cast shadows from this depth on other things, and shadows of opaque things darken them.

    Parameters
    ----------
    means : array_like (N, 3)
        Centres in the world, in scene units. Kept as float32.
    scales : array_like (N, 3)
        Standard deviations along the Gaussian's own axes, in scene units, at least 0. A scale of 0 makes it flat.
    rotations : array_like (N, 4)
        Quaternions (w, x, y, z) from the Gaussian's axes to the world's; of any length but 0.
    opacities : array_like (N,)
        Opacities at the centre, 0 to 1. Drawn opacities are at most 0.99, and those below 1/255 count as 0.
    colors : (N, 3) uint8, or float32 in [0, 1], optional
        Colours that do not depend on the direction. Give either these or `sh`.
    sh : array_like (N, K, 3), optional
        Coefficients of spherical harmonics, K = 1, 4, 9 or 16 for degrees 0 to 3, in the order and with the signs of 3D
        Gaussian Splatting. The colour is 0.5 plus their sum for the direction from the camera, at least 0.
    low_pass : float
        Variance in pixels^2 that is added to each Gaussian on the screen, so that none is missed between pixels. 0
        draws them as they are. With several samples per pixel, it counts in the picture's pixels, too.
    antialiased : bool
        Whether Gaussians become fainter as `low_pass` makes them larger, so that they stop as much light in all. Set it
        for scenes that were trained so (Mip-Splatting, Yu et al. 2024; gsplat's "antialiased").
    near : float
        Least depth of a mean, in scene units; nearer Gaussians are not drawn.

    Attributes
    ----------
    means, scales, rotations, opacities, sh
        float32 arrays, read-only; quaternions at unit length, and colours as harmonics of degree 0.

    Raises
    ------
    ArgumentError
        If the arrays do not fit together, hold values that are not finite or out of range, or are empty.

    Examples
    --------
    >>> import pyibr as ibr
    >>> cloud = ibr.Gaussians([[0, 0, 3]], [[1, 1, 0.1]], [[1, 0, 0, 0]], [0.9], colors=[[1.0, 0.0, 0.0]])
    >>> frame = ibr.render(cloud, ibr.Camera([[20, 0, 5], [0, 20, 5], [0, 0, 1]], (11, 11)))
    >>> round(float(frame.alpha[5, 5]), 2), float(frame.depth[5, 5])
    (0.9, 3.0)
    """

    def __init__(
        self,
        means: ArrayLike,
        scales: ArrayLike,
        rotations: ArrayLike,
        opacities: ArrayLike,
        colors: ArrayLike | None = None,
        sh: ArrayLike | None = None,
        *,
        low_pass: float = 0.3,
        antialiased: bool = False,
        near: float = 0.2,
    ) -> None:
        self.means = _checked("means", means, (None, 3), -LARGEST)
        count = len(self.means)
        if not count:
            raise ArgumentError("means", "at least one Gaussian", "an empty array")
        self.scales = _checked("scales", scales, (count, 3), 0.0)
        self.rotations = _unit(numbers("rotations", rotations, (count, 4)))
        self.opacities = _checked("opacities", opacities, (count,), 0.0, 1.0)
        if (colors is None) == (sh is None):
            raise ArgumentError("colors", "either `colors` or `sh`", "neither" if sh is None else "both")
        self.sh = _harmonics_of(colors, count) if sh is None else _checked("sh", sh, (count, None, 3), -LARGEST)
        if self.sh.shape[1] not in _HARMONICS:
            raise ArgumentError("sh", "1, 4, 9 or 16 coefficients, (N, K, 3)", describe(self.sh))
        self.low_pass = number_from("low_pass", low_pass, 0, 1e6, "a variance in pixels^2, from 0 to 1e6")
        self.antialiased = checked_bool("antialiased", antialiased)
        self.near = number_from("near", near, 1e-6, 1e9, "a depth in scene units, from 1e-6 to 1e9")

    def __len__(self) -> int:
        return len(self.means)

    def __repr__(self) -> str:
        return f"<Gaussians {len(self)}, degree {_HARMONICS.index(self.sh.shape[1])}>"

    @classmethod
    def load(cls, path: str | PathLike[str], **options: Any) -> Gaussians:
        """Read a file of 3D Gaussians: .ply, .compressed.ply, .splat, .spz, .ksplat or .sog.

        .splat, .spz and .sog need the extra `gaussians`. PLY files may be packed by gzip (``.ply.gz``). Files have the
        axes of OpenCV, y down; SPZ files, which have y up, are turned by half a turn about x. Gaussians with values
        that are not finite or exceed 1e9, scales below 0, or a quaternion of length 0 are left out, with a UserWarning.
        Infinite logits of opacity mean 1 and 0.

        Parameters
        ----------
        path : path
        **options
            `low_pass`, `antialiased` and `near`, as in the constructor.

        Raises
        ------
        FileFormatError
            If the file is not readable, or holds no Gaussians.
        MissingPackageError
            If the format needs gaussforge, which is not installed.

        Examples
        --------
        >>> import pyibr as ibr
        >>> cloud = ibr.Gaussians([[0, 0, 3]], [[1, 1, 0.5]], [[1, 0, 0, 0]], [0.5], colors=[[1.0, 0.0, 0.0]])
        >>> cloud.save("cloud.ply")
        >>> ibr.Gaussians.load("cloud.ply")
        <Gaussians 1, degree 0>
        """
        return cls(**read_gaussians(path), **options)

    def save(self, path: str | PathLike[str]) -> None:
        """Write a file of 3D Gaussians, or leave the old file. A missing folder is made.

        Only uncompressed PLY keeps all digits. The other formats of `load` round. All but .ksplat limit scales to 2e-9
        and more (SPZ: 4.5e-5 to 400). Harmonics beyond degree 0 are at most 4 in .compressed.ply and 1 in .spz, and are
        left out of .splat, with a UserWarning. Colours of degree 0 are clipped to 0 to 1 in .splat and .ksplat.

        Raises
        ------
        ArgumentError
            If the suffix is unknown; if means exceed 2,047 for .spz or 1e8 for .sog; or if over 65,536 Gaussians have
            harmonics beyond degree 0 for .sog.
        FileFormatError
            If the file cannot be written.
        MissingPackageError
            If the format needs gaussforge, which is not installed.
        """
        names = "means", "scales", "rotations", "opacities", "sh"
        write_gaussians(path, {name: getattr(self, name) for name in names}, lambda: self._order)

    @property
    def bounds(self) -> tuple[Float64, Float64]:
        """(low, high), each (3,), in the world: a box around the Gaussians.

        Clouds of photographs have stray Gaussians. So half a per cent at either end of each axis is left out, if it
        reaches farther than a quarter of the others' extent.
        """
        return self._bounds

    @cached_property
    def _bounds(self) -> tuple[Float64, Float64]:
        reach = _REACH * self.scales.max(axis=1, keepdims=True).astype(np.float64)
        lows: Float64 = np.sort(self.means - reach, axis=0)
        highs: Float64 = np.sort(self.means + reach, axis=0)
        strays = int(_STRAY * len(self))
        low, high = lows[strays], highs[-1 - strays]
        far = _ASTRAY * (high - low)
        return _farther(low, lows[0], far), _farther(high, highs[-1], far)

    def draw(self, target: Target, lighting: Lighting | None) -> None:
        """Draw nothing: Gaussians are not opaque, and are blended after all opaque things."""

    @staticmethod
    def blend_together(things: Sequence[Gaussians], target: Target, lighting: Lighting | None) -> None:
        """Blend clouds together into a target."""
        blend_clouds([cached_on_device(cloud, "planes", cloud._planes) for cloud in things], target, lighting)

    def _planes(self) -> Planes:
        """Upload the cloud to the current device, in an order that depends only on its Gaussians."""
        return Planes(planes_of(self._columns, self._order), self.low_pass, self.antialiased, self.near)

    @property
    def _columns(self) -> list[Float32]:
        """All numbers of a Gaussian, a view for each: mean, scales, rotation, opacity, harmonics."""
        harmonics = self.sh.reshape(len(self), -1).T
        return [*self.means.T, *self.scales.T, *self.rotations.T, self.opacities, *harmonics]

    @cached_property
    def _order(self) -> NDArray[np.int64]:
        """Order on the device: along a Morton curve, on which neighbours lie together; ties by all numbers."""
        low, high = self.means.min(axis=0).astype(np.float64), self.means.max(axis=0).astype(np.float64)
        cells = (self.means - low) * (0x1FFFFF / np.maximum(high - low, 1e-30).max())
        spread = cells.astype(np.uint64).T  # 21 bits, between which two zeros each are inserted
        for shift, mask in _INSERTIONS:
            spread = (spread | (spread << np.uint64(shift))) & np.uint64(mask)
        codes = spread[0] | spread[1] << np.uint64(1) | spread[2] << np.uint64(2)
        order = np.argsort(codes, kind="stable")
        equal = np.diff(codes[order]) == 0
        tied = np.append(equal, False) | np.append(False, equal)
        chosen = order[tied]
        order[tied] = chosen[np.lexsort([column[chosen] for column in (*reversed(self._columns), codes)])]
        return order


def _farther(end: Float64, farthest: Float64, far: Float64) -> Float64:
    """The farthest Gaussians' end of a box, where it is not too far from the others' end."""
    return np.asarray(np.where(np.abs(farthest - end) > far, end, farthest))


def _unit(quaternions: Float64) -> Float32:
    """Return quaternions with unit length, unchanged if they had it, or raise ArgumentError."""
    largest = np.maximum(np.abs(quaternions).max(axis=1, keepdims=True), 1e-300)  # avoids overflow of the squares
    length = np.linalg.norm(quaternions / largest, axis=1, keepdims=True)
    if not (length > 0).all():
        zeros = np.count_nonzero(length == 0)
        raise ArgumentError("rotations", "quaternions (w, x, y, z) of a length > 0", f"{zeros} of length 0")
    is_unit = np.abs(length * largest - 1) < 1e-6
    return locked(np.where(is_unit, quaternions, quaternions / largest / length).astype(np.float32))


def _checked(argument: str, value: Any, shape: tuple[int | None, ...], least: float, most: float = LARGEST) -> Float32:
    """Return finite numbers of a shape, from `least` to `most`, as float32, or raise ArgumentError."""
    is_stored = type(value) is np.ndarray and value.dtype == np.float32 and fits(value, shape)
    array = value if is_stored else numbers(argument, value, shape)  # which takes three times the memory
    low, high = (float(array.min()), float(array.max())) if array.size else (least, least)
    if not (low >= least and high <= most):  # also NaN
        numbers(argument, array, shape)  # raises the usual error if some are not finite
        raise ArgumentError(argument, f"numbers from {least:g} to {most:g}", f"{low} to {high}")
    return locked(array.astype(np.float32, copy=False))


def _harmonics_of(colors: ArrayLike | None, count: int) -> Float32:
    stored = checked_colors("colors", colors, (count, 3))
    shown = stored / np.float64(255) if stored.dtype == np.uint8 else stored.astype(np.float64)
    return locked(((shown - 0.5) / SH0).astype(np.float32)[:, None])
