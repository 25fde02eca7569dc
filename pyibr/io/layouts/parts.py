"""Helpers for layouts: tables of numbers, JSON objects, files by number, cameras."""

from __future__ import annotations

import logging
from collections.abc import Callable, Container, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pyibr.core.calibrations import unread_in, warn_of_unread
from pyibr.core.camera import Camera
from pyibr.core.camera_json import read_json
from pyibr.core.checks import Float64
from pyibr.core.conventions import pose_from_extrinsics
from pyibr.core.errors import ArgumentError, FileFormatError
from pyibr.core.files import read_rows, read_text, reading
from pyibr.core.lens import Lens
from pyibr.io import read_depth
from pyibr.io.folders import files_in, number_of
from pyibr.io.poses import rigid_or_none
from pyibr.io.recordings import Recording, size_of

_Key = TypeVar("_Key")

_log = logging.getLogger("pyibr")


def numbers_in(path: Path) -> Float64:
    """(rows, columns) of a text file of numbers."""
    with reading(path, "table of numbers") as source:
        return np.array(read_rows(source))


def values_in(path: Path, mark: str) -> dict[str, str]:
    """Values of a text file's lines `name mark value`, by name."""
    with reading(path, "list of values") as source:
        pairs = [line.partition(mark) for line in read_text(source).splitlines()]
    return {name.strip(): value for name, _, value in pairs}


def object_in(path: Path, keys: str = ".*") -> dict[str, Any]:
    """The object in a JSON file; an empty one if the file holds another type, and so fits no layout.

    keys: pattern of the keys that the layout reads; other keys that look like a lens or a pose give a warning.
    """
    data = read_json(path, "JSON")
    warn_of_unread(path, unread_in(data, keys))
    return cast("dict[str, Any]", data) if isinstance(data, dict) else {}


def camera_of(path: Path, K: ArrayLike, size: tuple[int, int], lens: Lens | None = None) -> Camera:
    """The camera of a file's intrinsics, 3 x 3 or 4 x 4; FileFormatError if its centre is outside the picture."""
    try:
        camera = Camera(np.asarray(K, np.float64)[:3, :3], size, lens=lens)
    except (ArgumentError, ValueError, TypeError, IndexError) as error:
        raise FileFormatError(f"{path}: {error}") from error
    (cx, cy), (width, height) = camera.K[:2, 2], size
    if not (-0.5 <= cx <= width - 0.5 and -0.5 <= cy <= height - 0.5):
        outside = f"({cx:g}, {cy:g}) lies outside of pictures of {width} x {height}"
        raise FileFormatError(f"{path}: its centre {outside}; they seem to be resized")
    return camera


def matrix(focal: float, cx: float, cy: float, fy: float | None = None) -> Float64:
    """K of one focal length, or of two."""
    return np.array([[focal, 0, cx], [0, fy or focal, cy], [0, 0, 1]])


def inverted(camera_from_world: Float64) -> Float64 | None:
    """The pose from a file's camera_from_world; None if that is no rigid motion."""
    exact = rigid_or_none(camera_from_world)
    return None if exact is None else pose_from_extrinsics(exact[:3, :3], exact[:3, 3])


def by_number(folder: Path, suffixes: Sequence[str], word: str = "") -> dict[int, Path]:
    """Files by the last number in their names, in that order."""
    found = {number: file for file in files_in(folder, suffixes, word) if (number := number_of(file)) is not None}
    return dict(sorted(found.items()))


def joined(
    place: Path, colors: Mapping[_Key, Path], depths: Mapping[_Key, Path], *others: Container[_Key]
) -> tuple[list[_Key], Recording]:
    """Keys, such as numbers, of frames in all mappings, and the recording of their files; FileFormatError if none."""
    numbers = [number for number in colors if all(number in other for other in (depths, *others))]
    if not numbers:
        raise FileFormatError(f"{place}: no frame has all its files, among {len(colors)} pictures")
    is_kept = dict.fromkeys(numbers, True)
    found = Recording(
        [colors[number] for number in numbers],
        [depths[number] for number in numbers],
        left_out=[color for number, color in colors.items() if number not in is_kept],
        kept=[number in is_kept for number in colors],
    )
    return numbers, found


def own_camera(name: str, K: Float64, of: tuple[int, int], colors: Sequence[Path]) -> Callable[[], list[Camera]]:
    """A function for the known camera of a data set, resized for pictures of another size."""

    def camera() -> list[Camera]:
        size, known = size_of(colors[0]), Camera(K, of)
        if size == of:
            return [known]
        _log.warning("%s: no camera for %dx%d pixels is given; %s's camera is used, resized", colors[0], *size, name)
        return [known.resized(size)]

    return camera


def beside(
    cameras: Sequence[Camera], depth: Path, read: Callable[[Path], NDArray[Any]] | None = None
) -> list[Camera | None]:
    """Resized cameras of depth with fewer samples than the first picture has pixels; None if the sizes are equal."""
    size = size_of(depth, read or (lambda path: read_depth(path, depth_scale=1)))
    return [None if size == camera.size else camera.resized(size) for camera in cameras]


def without(nothing: float) -> Callable[[Path], NDArray[Any]]:
    """A reader of stored depth that also treats this number as no depth."""

    def read(path: Path) -> NDArray[Any]:
        values = read_depth(path, depth_scale=1)
        return np.where(values == nothing, np.float32(np.nan), values)

    return read
