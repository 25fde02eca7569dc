"""Readers for cameras of several images: calibration files, JSON files, COLMAP models."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import cast

import numpy as np

from pyibr.core.calibrations import cameras_in, chosen, is_matrix, making, read_calibration
from pyibr.core.camera import Camera
from pyibr.core.camera_json import open3d_cameras
from pyibr.core.checks import checked_size
from pyibr.core.errors import FileFormatError
from pyibr.core.files import checked_path, read_text, reading
from pyibr.io import gltf
from pyibr.io.colmap_model import model_in, read_model
from pyibr.io.folders import files_in

_SET = "frusta.json"  # written by `pyibr.save` and `pyibr place`
_NUMBERS = 21  # 9 of K, 9 of R and 3 of t for each picture of Middlebury's multi-view sets; x_camera = R x_world + t


def read_cameras(path: str | PathLike[str], *, size: tuple[int, int] | None = None) -> dict[str, Camera]:
    """Read the cameras of several images.

    Parameters
    ----------
    path : path
        - A file that `Camera.load` reads, of one camera or of several.
        - A JSON list of such cameras, or Open3D's PinholeCameraTrajectory.
        - A set's folder or its `frusta.json`.
        - A folder of JSON files of one camera each, in the order of the numbers in their names.
        - The folder of a COLMAP model (``cameras.bin`` and ``images.bin``, or ``.txt``), also in a subfolder ``0``.
        - A glTF scene, or the parameters of Middlebury's multi-view sets.
    size : (width, height), optional
        The images' size, for files that lack it. From a calibration of several cameras, only cameras of this size are
        read, if there are any.

    Returns
    -------
    dict of str and Camera
        By the image's name (COLMAP, `transforms.json`, Middlebury), the file's name without its suffix (a folder), the
        camera's name in the file, or its number in the list.

    Raises
    ------
    FileFormatError
        If there is no such file, or it holds something else.

    Examples
    --------
    >>> import json
    >>> from pathlib import Path
    >>> from pyibr.io import read_cameras
    >>> one = {"width": 4, "height": 3, "fx": 5, "fy": 5, "cx": 1.5, "cy": 1}
    >>> _ = Path("rig.json").write_text(json.dumps([one, one | {"fx": 6}]))
    >>> {name: camera.K[0, 0].item() for name, camera in read_cameras("rig.json").items()}
    {'0': 5.0, '1': 6.0}
    """
    source = checked_path(path)
    if (source / _SET).is_file():
        source /= _SET
    if source.is_dir():
        if model := model_in(source):
            return read_model(model)
        files = files_in(source, (".json",))
        if not files:
            raise FileFormatError(f"{source}: no cameras in it: expected JSON files, or COLMAP's cameras and images")
        return {file.stem: Camera.load(file) for file in files}
    if source.suffix.lower() in gltf.SUFFIXES:
        return gltf.read_cameras(source, size)
    if _are_parameters(source):
        return _read_parameters(source, size)
    file, name, tree = read_calibration(source)
    data = _listed(tree)
    if isinstance(data, list) and not is_matrix(cast("object", data)):
        several = cast("list[object]", data)
        if not several:
            raise FileFormatError(f"{file}: expected cameras, got an empty list")
        if name is None:
            return {str(k): Camera.from_json(one, f"{file}: camera {k}") for k, one in enumerate(several)}
    with making(file):
        found = chosen(cameras_in(cast("object", data), file, size), name, file, size)
        return {own or "0": Camera(**make()) for own, make in found.items()}


def _listed(data: object) -> object:
    """The cameras of a set's views, or of Open3D's trajectory; other data unchanged."""
    if not isinstance(data, dict):
        return data
    known = cast("dict[str, object]", data)
    if "views" not in known:
        several = open3d_cameras(known)
        return known if several is None else several
    views = known["views"]
    if not isinstance(views, list):
        return views
    entries = cast("list[object]", views)
    return [cast("dict[str, object]", one).get("camera") if isinstance(one, dict) else one for one in entries]


def _are_parameters(path: Path) -> bool:
    """Tell whether a text file begins with a count, and a line of a name and 21 numbers."""
    try:
        first, second = (line.split() for line in read_text(path).splitlines()[:2])
    except (OSError, ValueError):
        return False
    return len(first) == 1 and first[0].isdigit() and len(second) == 1 + _NUMBERS


def _read_parameters(path: Path, size: tuple[int, int] | None) -> dict[str, Camera]:
    """The cameras of a multi-view set by picture name, for pictures of this size."""
    shown = checked_size(size)
    with reading(path, "multi-view parameters") as source:
        lines = [line.split() for line in read_text(source).splitlines()[1:] if line.strip()]
        rows = {line[0]: np.array([float(word) for word in line[1:]]) for line in lines}
        if any(len(row) != _NUMBERS for row in rows.values()):
            raise ValueError("expected 9 numbers of K, 9 of R, 3 of t for each picture")
        return {
            name: Camera.from_opencv(row[:9].reshape(3, 3), row[9:18].reshape(3, 3), row[18:], shown)
            for name, row in rows.items()
        }
