"""Output of networks: MoGe's folders, NPZ files of Depth Anything 3 and VGGT, Depth Pro's depth and focal length."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera
from pyibr.core.errors import FileFormatError
from pyibr.images.srgb import in_bytes
from pyibr.io import image, read_color
from pyibr.io.arrays import names_in, read_array
from pyibr.io.folders import files_in
from pyibr.io.layouts.parts import camera_of, inverted, matrix, object_in
from pyibr.io.recordings import COLOR_SUFFIXES, Recording, Stored, size_of

_NAMES = {
    "color": ("image", "images"),
    "depth": ("depth",),
    "confidence": ("conf", "depth_conf"),
    "extrinsics": ("extrinsics", "extrinsic"),
    "intrinsics": ("intrinsics", "intrinsic"),
}
"""Names of arrays in Depth Anything 3's and VGGT's files."""

_ALIKE = 0.25  # fraction of the colours' spread: in a depth map, neighbours in order of depth differ by less
_FOCAL = ("focallength_px", "focal_length", "focallength")
_PLACES = ("", "exports/npz", "exports/mini_npz")


def find_moge(folder: Path) -> Recording | None:
    """Find image.jpg, depth.exr (or .npy) and fov.json with angles in degrees; mask.png marks pixels with depth."""
    angles = folder / "fov.json"
    color, depth = (
        next((folder / f"{name}{suffix}" for suffix in suffixes if (folder / f"{name}{suffix}").is_file()), None)
        for name, suffixes in (("image", COLOR_SUFFIXES), ("depth", (".exr", ".npy", ".npz", ".pfm")))
    )
    if not angles.is_file() or color is None or depth is None:
        return None
    size, told = size_of(color), object_in(angles)
    try:
        half = [np.tan(np.radians(float(told[name])) / 2) for name in ("fov_x", "fov_y")]
    except (KeyError, TypeError, ValueError) as error:
        raise FileFormatError(f"{angles}: expected fov_x and fov_y in degrees: {error}") from error
    (width, height), mask = size, folder / "mask.png"
    K = matrix(width / 2 / half[0], (width - 1) / 2, (height - 1) / 2, height / 2 / half[1])
    confidence = functools.partial(image.read_color, mask) if mask.is_file() else None
    camera = camera_of(angles, K, size)
    return Recording(
        [color], [depth], known=lambda: [camera], stored=[Stored(confidence=confidence, least=1)], is_still=True
    )


def find_stack(folder: Path) -> Recording | None:
    """Find an NPZ of all frames: depth, conf, extrinsics (camera from world), intrinsics, image; or picture files."""
    places = [folder / place for place in _PLACES if (folder / place).is_dir()]
    files = [file for place in places for file in files_in(place, (".npz",))]
    for file in files:
        names = _keys(file, is_alone=len(files) == 1)
        if {"depth", "extrinsics", "intrinsics"} <= names.keys():
            return _stacked(folder, file, names)
    return None


def find_depth_pro(folder: Path) -> Recording | None:
    """Find NPZ files of depth, maybe with the focal length in pixels, each beside the picture of the same stem.

    Apple's program writes the depth alone, and its colour map as JPEG of the same stem, which is no picture.
    """
    pictures = [picture for picture in files_in(folder, COLOR_SUFFIXES) if picture.suffix != ".npz"]
    stems = {picture.stem for picture in pictures}
    files = [file for file in files_in(folder, (".npz",)) if file.stem.removesuffix("_depth") in stems]
    found = {
        file: next((name for name in _FOCAL if name in keys), "")
        for file in files
        if "depth" in (keys := names_in(file))
    }
    colors = list[Path]()
    for file in found:
        alike = [picture for picture in pictures if picture.stem == file.stem.removesuffix("_depth")]
        own = [picture for picture in alike if found[file] or not _is_map(picture, file)]
        if not own:
            raise FileFormatError(f"{alike[0]}: is a colour map of {file.name}; expected the photograph beside it")
        colors.append(own[-1])

    def camera(file: Path, color: Path) -> Camera:
        width, height = size_of(color)
        f = float(read_array(file, found[file]).ravel()[0])
        return camera_of(file, matrix(f, (width - 1) / 2, (height - 1) / 2), (width, height))

    known = (lambda: [*map(camera, found, colors)]) if all(found.values()) else None
    return Recording(colors, list(found), known=known, is_still=len(colors) == 1) if found else None


def _is_map(picture: Path, file: Path) -> bool:
    """Tell whether a JPEG shows depth in false colours: samples of nearly equal depth have nearly equal colours."""
    color, depth = image.read_color(picture), np.squeeze(read_array(file, "depth"))
    if picture.suffix.lower() not in (".jpg", ".jpeg") or color.ndim != 3 or color.shape[:2] != depth.shape:
        return False
    ordered = color.reshape(-1, color.shape[2])[np.argsort(depth, axis=None)].astype(np.float32)
    return bool(np.abs(np.diff(ordered, axis=0)).mean() < _ALIKE * np.abs(ordered - ordered.mean(axis=0)).mean())


def _stacked(folder: Path, file: Path, names: dict[str, str]) -> Recording:
    depths = _layers(read_array(file, names["depth"]), file)
    count, height, width = depths.shape
    K = read_array(file, names["intrinsics"]).reshape(-1, 3, 3)
    extrinsics = np.tile(np.eye(4), (count, 1, 1))
    told = read_array(file, names["extrinsics"])
    if (
        told.reshape(-1, *told.shape[-2:]).shape[0] != count
        or len(K) != count
        or told.shape[-2:] not in ((3, 4), (4, 4))
    ):
        raise FileFormatError(f"{file}: expected extrinsics and intrinsics of {count} frames, got {told.shape}")
    extrinsics[:, :3] = told.reshape(count, *told.shape[-2:])[:, :3]
    sure = _layers(read_array(file, names["confidence"]), file) if "confidence" in names else None
    if "color" in names:
        colors, read = [file] * count, _pictures(file, names["color"])
    else:
        beside = [place for place in (folder, folder / "images", folder / "input_images") if place.is_dir()]
        pictures = [one for place in beside for one in files_in(place, COLOR_SUFFIXES) if one.suffix != ".npz"]
        if len(pictures) != count:
            raise FileFormatError(f"{file}: has no image; expected {count} pictures beside it, got {len(pictures)}")
        colors, read = pictures, None
    return Recording(
        colors,
        [file] * count,
        known=lambda: [camera_of(file, one, (width, height)) for one in K],
        placed=[inverted(one) for one in extrinsics],
        stored=[_layer(depths, sure, read, k) for k in range(count)],
        kept=[True] * count,
        is_still=True,
    )


def _layer(
    depths: NDArray[Any], sure: NDArray[Any] | None, read: Callable[[int], NDArray[Any]] | None, k: int
) -> Stored:
    """One frame of the stack; a picture of another size is resized to the size of its depth."""
    height, width = depths.shape[1:]

    def color(path: Path) -> NDArray[Any]:
        return _resized((width, height), path) if read is None else read(k)

    return Stored(color=color, depth=lambda _: depths[k], confidence=None if sure is None else (lambda: sure[k]))


def _resized(size: tuple[int, int], path: Path) -> NDArray[Any]:
    from PIL import Image

    return np.array(Image.fromarray(in_bytes(read_color(path))).resize(size, Image.Resampling.BOX))


def _pictures(file: Path, name: str) -> Callable[[int], NDArray[Any]]:
    """A reader of a stack's pictures by index; the stack is read once."""
    stack = functools.cache(lambda: read_array(file, name))

    def picture(k: int) -> NDArray[Any]:
        one = stack().reshape(-1, *stack().shape[-3:])[k]
        if one.shape[0] in (1, 3) and one.shape[-1] not in (1, 3):
            one = np.moveaxis(one, 0, -1)
        return np.ascontiguousarray(one if one.dtype == np.uint8 else one.astype(np.float32).clip(0, 1))

    return picture


def _layers(stack: NDArray[Any], file: Path) -> NDArray[np.float32]:
    """A stack of depth maps as (N, H, W), without first and last axes of length 1."""
    shape = list(stack.shape)
    while len(shape) > 3 and 1 in (shape[0], shape[-1]):
        del shape[0 if shape[0] == 1 else -1]
    if len(shape) != 3:
        raise FileFormatError(f"{file}: expected depth of shape (N, H, W), got {stack.shape}")
    return stack.reshape(shape).astype(np.float32)


def _keys(file: Path, is_alone: bool) -> dict[str, str]:
    """Name of the array for each kind of content. An unreadable file gives {}, or raises if it is the only file."""
    try:
        there = names_in(file)
    except FileFormatError:
        if is_alone:
            raise
        return {}
    return {what: name for what, names in _NAMES.items() for name in names if name in there}
