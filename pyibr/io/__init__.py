"""Image and depth files: one module for each format, chosen by the suffix.

| suffix | colour | depth |
|---|---|---|
| .png | 8 or 16 bit | 16 or 8 bit, with a scale |
| .tif | the same, gray floats | floats, or integers with a scale |
| .jpg, .bmp, .webp, .ppm | the same | gray of 8 bit, with a scale |
| .npy, .npz | yes | yes; NPZ files of several arrays need a name |
| .pfm | yes | yes |
| .exr (extra `exr`) | R, G, B | the channel named depth or z, or a chosen one |
| .bin (COLMAP), .dpt (Sintel) | | yes |
| .hdf5, .h5 (extra `hdf5`) | the array named colors | the array named depth, or a chosen one |
| .pgm | 8 or 16 bit | 16 or 8 bit, with a scale |

`read_range_grid` reads scans on a grid (points, no images), `read_relief_map` maps of normals and heights,
`read_cameras` cameras of several images, and `read_poses` their poses.
"""

from __future__ import annotations

import math
import os
from importlib import import_module
from os import PathLike
from typing import Any, Literal, Protocol, TypedDict, cast

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera
from pyibr.core.checks import describe, instance_of, one_of, plain_array
from pyibr.core.errors import ArgumentError, FileFormatError
from pyibr.core.files import check_writable, checked_path, like
from pyibr.core.shown import save_as
from pyibr.images.converters import depth_from_relative, depth_from_uint16
from pyibr.images.pictures import Pictured
from pyibr.io import depth_kinds, image
from pyibr.io.camera_files import CameraForm, write_cameras
from pyibr.io.cameras import read_cameras
from pyibr.io.depth_kinds import DepthKind
from pyibr.io.gaussian_files import refuse_gaussians
from pyibr.io.ply import read_range_grid
from pyibr.io.poses import Poses, read_poses
from pyibr.io.relief_map import read_relief_map, write_relief_map

__all__ = [
    "CameraForm",
    "DepthKind",
    "DepthReading",
    "Poses",
    "check_output",
    "read_cameras",
    "read_color",
    "read_depth",
    "read_poses",
    "read_range_grid",
    "read_relief_map",
    "write_cameras",
    "write_color",
    "write_depth",
    "write_mask",
    "write_relief_map",
]


class DepthReading(TypedDict, total=False):
    """Options of `read_depth` for code that reads several files with them."""

    depth_scale: float | None
    depth_offset: float
    depth_kind: DepthKind
    channel: str | None
    part: str | None
    near: float
    far: float


_PathLike = str | PathLike[str]
_COLOR_MODULES = {".npy": "arrays", ".npz": "arrays", ".pfm": "floats", ".exr": "exr"}
_HDF5 = dict.fromkeys((".hdf5", ".h5"), "arrays")
_MASK_MODULES = {".npy": "arrays"}
_DEPTH_MODULES = {
    **dict.fromkeys((".png", ".tif", ".tiff"), "image"),
    **_COLOR_MODULES,
    **{".bin": "floats", ".pgm": "image", ".dpt": "floats", **_HDF5},
}
COLOR_SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp", ".ppm", *_COLOR_MODULES)
DEPTH_SUFFIXES = tuple(_DEPTH_MODULES)
"""Suffixes of pictures and of depth in recordings; if a frame has several files of depth, the first suffix counts."""
_READABLE = dict.fromkeys(COLOR_SUFFIXES, "image") | _DEPTH_MODULES  # depth, also if it is lossy

_CHOICES = {"channel": (".exr", ".npz", ".hdf5", ".h5"), "part": (".exr",)}

_FLOATS = (".npy", ".npz", ".exr", ".pfm", ".tif", ".tiff")  # float formats, in which saved views store depth
_NO_IMAGES = (".ply", ".pcd", ".las", ".laz", ".obj", ".glb", ".gltf", ".stl", ".off")


class _Format(Protocol):
    """Optional functions of this folder's modules; arrays are as stored, unchecked."""

    def read_color(self, path: _PathLike, **chosen: str) -> NDArray[Any]: ...
    def write_color(self, path: _PathLike, color: NDArray[Any]) -> None: ...
    def read_depth(self, path: _PathLike, **chosen: str) -> NDArray[Any]: ...
    def write_depth(self, path: _PathLike, depth: NDArray[Any]) -> None: ...
    def check_output(self, path: _PathLike) -> None: ...


def read_color(
    path: _PathLike, *, channel: str | None = None, part: str | None = None
) -> NDArray[np.uint8] | NDArray[np.float32]:
    """Read a colour image.

    Parameters
    ----------
    path : path
        Gray becomes R, G, B, and the first of several images is taken. Alpha is dropped, with a UserWarning unless
        all of it is opaque: pyibr draws surfaces, and depth or a mask marks where there are none. 16-bit gray becomes
        float32 in [0, 1], and so does 16-bit RGB of PNG and TIFF. EXR, PFM and NPY are read unchanged: EXR
        is linear in light, and values may exceed 1.
    channel : str, optional
        The layer, or one channel, of an EXR; the array of an NPZ or HDF5. Default: R, G, B of the picture's layer.
    part : str, optional
        The part of an EXR: its name, or its number if it has none. Default: the first part with the channels sought.

    Returns
    -------
    (H, W, 3) uint8 or float32, the top row first.

    Raises
    ------
    FileFormatError
        If the file is missing, truncated, or not a colour image.

    Examples
    --------
    >>> import numpy as np
    >>> import pyibr as ibr
    >>> ibr.write_color("red.png", np.full((2, 3, 3), (255, 0, 0), np.uint8))
    >>> ibr.read_color("red.png")[1, 2].tolist()
    [255, 0, 0]
    """
    refuse_gaussians(path, "an image")
    chosen = _chosen(path, channel, part)
    stored = _module(path, _COLOR_MODULES | _HDF5, "image").read_color(path, **chosen)
    color: NDArray[Any] = stored[..., None] if stored.ndim == 2 else stored
    if color.ndim != 3 or color.shape[2] not in (1, 2, 3, 4) or 0 in color.shape:
        raise FileFormatError(f"{path}: expected an image of shape (H, W, 3), got {describe(stored)}")
    color = image.without_alpha(color, like(path))
    color = color if color.shape[2] == 3 else np.repeat(color, 3, axis=2)
    if color.dtype == np.bool_:
        return color.astype(np.uint8) * np.uint8(255)
    if color.dtype == np.uint16:
        return color.astype(np.float32) / np.float32(65535)
    if color.dtype != np.uint8 and color.dtype.kind != "f":
        raise FileFormatError(f"{path}: expected 8-bit, 16-bit or float colour, got {describe(stored)}")
    return np.ascontiguousarray(color if color.dtype == np.uint8 else color.astype(np.float32))


def write_color(path: _PathLike, color: NDArray[np.uint8] | NDArray[np.float32]) -> None:
    """Write an (H, W, 3) uint8 or float32 image.

    EXR, PFM and NPY keep float32; other formats store 8 bit, with [0, 1] scaled to 0 ... 255 and clipped. EXR
    and PFM store uint8 divided by 255.

    Examples
    --------
    >>> import numpy as np
    >>> import pyibr as ibr
    >>> ibr.write_color("gray.png", np.full((2, 3, 3), 0.5, np.float32))
    >>> int(ibr.read_color("gray.png").max())
    128
    """
    expected = "uint8 or floats of shape (H, W, 3)"
    array = plain_array("color", color, expected)
    if (
        array.ndim != 3
        or array.shape[2] != 3
        or not (array.dtype == np.uint8 or array.dtype.kind == "f")
        or not array.size
    ):
        raise ArgumentError("color", expected, describe(color))
    image = array if array.dtype == np.uint8 else array.astype(np.float32)
    _module(path, _COLOR_MODULES, "image").write_color(path, image)


def write_mask(path: _PathLike, mask: NDArray[np.bool_]) -> None:
    """Write an (H, W) bool mask as an 8-bit gray image, 0 and 255, or unchanged as NPY.

    Examples
    --------
    >>> import numpy as np
    >>> import pyibr as ibr
    >>> ibr.write_mask("mask.png", np.eye(3, dtype=bool))
    >>> ibr.read_color("mask.png")[..., 0].tolist()
    [[255, 0, 0], [0, 255, 0], [0, 0, 255]]
    """
    array = plain_array("mask", mask, "bool of shape (H, W)")
    if array.ndim != 2 or array.dtype != np.bool_ or not array.size:
        raise ArgumentError("mask", "bool of shape (H, W)", describe(mask))
    _module(path, _MASK_MODULES, "image").write_color(path, array)


def check_output(path: _PathLike, kind: Literal["color", "depth", "mask"]) -> None:
    """Raise the errors of a write in advance: an unknown suffix, a missing package, a folder as the path.

    Examples
    --------
    >>> from pyibr.io import check_output
    >>> check_output("new.png", "color")
    """
    if kind == "depth":
        module = _module(path, _DEPTH_MODULES)
    else:
        module = _module(path, _COLOR_MODULES if kind == "color" else _MASK_MODULES, "image")
    check = getattr(module, "check_output", None)
    if check is not None:
        check(path)
    check_writable(path)


@np.errstate(all="ignore")
def read_depth(
    path: _PathLike,
    *,
    depth_scale: float | None = None,
    depth_offset: float = 0.0,
    depth_kind: DepthKind = "z",
    camera: Camera | None = None,
    channel: str | None = None,
    part: str | None = None,
    near: float = 1.0,
    far: float = 10.0,
) -> NDArray[np.float32]:
    """Read planar depth.

    Parameters
    ----------
    path : path
        A gray PNG, PGM, TIFF or JPEG, or an NPY, NPZ, PFM, EXR, COLMAP, Sintel or HDF5 file. Gray may be stored in
        three channels, of 16 bits, too. In arrays, axes of length 1 are dropped.
    depth_scale : float
        Stored units per scene unit: 1000 for millimetres to metres, 5000 for the TUM data sets. Required for
        integers, where 0 means no depth; 1 for floats if not given.
    depth_offset : float
        Stored units to add before the division by the scale: for disparity in pixels, the difference of the two
        principal points (`doffs` in Middlebury's calib.txt).
    depth_kind : {"z", "distance", "inverse", "relative"}
        Kind of the stored values: planar z; distances from the camera's centre along its rays; 1 / z, such as
        disparity, whose scale is focal length times baseline (times the stored units per pixel); or relative inverse
        depth, which networks estimate from one picture. Relative depth is larger where the surface is nearer, is stored
        in 8 or 16 bits or as floats, and needs no scale.
    camera : Camera, optional
        The depth's camera, needed for distances.
    channel : str, optional
        The channel of an EXR, such as ``"ViewLayer.Depth.Z"``; the array of an NPZ or HDF5. Default: the one named
        depth or z. No channel of X, Y and Z is taken, and R, G or B only if all three are equal.
    part : str, optional
        The part of an EXR: its name, or its number if it has none. Default: the first part with the channels sought.
    near, far : float
        Depths of the nearest and the farthest sample of relative depth, see `depth_from_relative`.

    Returns
    -------
    (H, W) float32
        Planar z in scene units, the top row first.

    Raises
    ------
    FileFormatError
        If the file is missing, truncated, or does not hold depth.
    ArgumentError
        If the file holds integers and there is no scale, or distances without a camera of the same size.

    Examples
    --------
    >>> import numpy as np
    >>> import pyibr as ibr
    >>> ibr.write_depth("depth.png", np.array([[1.5, np.nan]], np.float32), depth_scale=1000)
    >>> ibr.read_depth("depth.png", depth_scale=1000).tolist()
    [[1.5, nan]]
    """
    one_of("depth_kind", depth_kind, DepthKind)
    refuse_gaussians(path, "an image of depth")
    chosen = _chosen(path, channel, part)
    if depth_kind == "relative":
        return depth_from_relative(_relative(path, chosen), near=near, far=far)
    stored = _module(path, _READABLE).read_depth(path, **chosen)
    if stored.ndim > 2:  # as networks return, (1, H, W) for example
        stored = stored.reshape([length for length in stored.shape if length != 1] or stored.shape)
    if stored.ndim != 2 or stored.dtype.kind not in "uif" or 0 in stored.shape:
        raise FileFormatError(f"{path}: expected depth of shape (H, W), got {describe(stored)}")
    values = depth_kinds.scaled(stored, depth_scale, depth_offset, path)
    if depth_kind == "z" and checked_path(path).suffix.lower() not in (".bin", ".dpt"):  # these hold no network's map
        depth_kinds.warn_of_relative(stored, path)
    return depth_kinds.planar(values, depth_kind, camera, path)


@np.errstate(all="ignore")
def write_depth(
    path: _PathLike,
    depth: NDArray[np.float32] | NDArray[np.uint16],
    *,
    depth_scale: float | None = None,
    depth_offset: float = 0.0,
    depth_kind: DepthKind = "z",
    camera: Camera | None = None,
) -> None:
    """Write (H, W) depth so that `read_depth` with the same arguments returns it: float32, or uint16 with its scale.

    PNG needs a scale, and stores the nearest integer and 0 for invalid depth; ArgumentError if a depth does not
    fit in 16 bits. The other formats store floats, invalid ones unchanged.

    Examples
    --------
    >>> import numpy as np
    >>> import pyibr as ibr
    >>> ibr.write_depth("depth.npy", np.array([[1.5, np.nan]], np.float32))
    >>> ibr.read_depth("depth.npy").tolist()
    [[1.5, nan]]
    """
    expected = "float32, or uint16 with its scale, of shape (H, W)"
    array = plain_array("depth", depth, expected, math.nan)
    if array.ndim != 2 or (array.dtype.kind != "f" and array.dtype != np.uint16) or not array.size:
        raise ArgumentError("depth", expected, describe(depth))
    if array.dtype == np.uint16:
        array = depth_from_uint16(array, depth_kinds.required(depth_scale, path))
    one_of("depth_kind", depth_kind, DepthKind)
    module, whole = _module(path, _DEPTH_MODULES), checked_path(path).suffix.lower() == ".png"
    module.write_depth(path, depth_kinds.stored(array, depth_kind, camera, path, depth_scale, depth_offset, whole))


@save_as.register
def _(thing: Pictured, path: _PathLike) -> None:
    suffix = checked_path(path).suffix.lower()
    if suffix == ".json":
        thing.camera.save(path)
    elif suffix in _FLOATS:
        write_depth(path, thing.known_depth)
    elif not thing.color.shape[2]:
        raise ArgumentError("path", f"a depth file ({', '.join(_FLOATS)}), as there is no colour", str(path))
    else:
        write_color(path, thing.color)


def _relative(path: _PathLike, chosen: dict[str, str]) -> NDArray[Any]:
    """(H, W) levels of a network's map, also from a gray picture."""
    if checked_path(path).suffix.lower() in _COLOR_MODULES | _HDF5:
        values = np.squeeze(_module(path, _DEPTH_MODULES).read_depth(path, **chosen))
    else:
        values = _module(path, {}, "image").read_color(path)
    values = image.gray_of(values, path)
    if values.ndim != 2 or values.dtype.kind not in "uif" or 0 in values.shape:
        raise FileFormatError(f"{path}: expected a gray map of shape (H, W), got {describe(values)}")
    return values


def _chosen(path: _PathLike, channel: str | None, part: str | None) -> dict[str, str]:
    """The given choices, after a check that the file's format has them."""
    suffix = checked_path(path).suffix.lower()
    given = {name: value for name, value in (("channel", channel), ("part", part)) if value is not None}
    for name, value in given.items():
        if suffix not in _CHOICES[name]:
            raise ArgumentError(name, f"none, or a file of {' or '.join(_CHOICES[name])}, for {path}", repr(value))
        instance_of(name, value, str, "a name")
    return given


def _module(path: _PathLike, modules: dict[str, str], default: str | None = None) -> _Format:
    if os.path.isdir(checked_path(path)):  # noqa: PTH112 - False for a name that is too long
        raise FileFormatError(f"{path}: expected a file, got a folder")
    suffix = checked_path(path).suffix.lower()
    name = modules.get(suffix, default)
    if name is None and suffix in _NO_IMAGES:
        raise FileFormatError(f"{path}: expected an image of depth, got a {suffix} file, which holds points or a mesh")
    if name is None:
        known = ", ".join(sorted(modules))
        raise FileFormatError(f"{path}: no depth format {suffix or 'without a suffix'}; known are {known}")
    return cast(_Format, import_module(f"pyibr.io.{name}"))
