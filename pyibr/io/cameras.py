"""The cameras of several images: of JSON files, of a COLMAP model, or of a matrix."""

from __future__ import annotations

from os import PathLike
from typing import cast

import numpy as np

from pyibr.core.camera import Camera
from pyibr.core.camera_json import read_json
from pyibr.core.errors import ArgumentError, FileFormatError
from pyibr.core.files import checked_path, reading
from pyibr.core.open3d_json import open3d_cameras
from pyibr.io.colmap_model import read_model
from pyibr.io.folders import files_in


def read_cameras(path: str | PathLike[str], *, size: tuple[int, int] | None = None) -> dict[str, Camera]:
    """Read the cameras of several images.

    Parameters
    ----------
    path : path
        A JSON file as `Camera.load` reads it, one with a list of such cameras, Open3D's PinholeCameraTrajectory, or a
        set's `frusta.json`; a text file with the 3 x 3 numbers of K; a folder of JSON files of one camera each, in the
        order of the numbers in their names; or the folder of a COLMAP model (``cameras.bin`` and ``images.bin``, or
        ``.txt``), be it in a folder ``0`` there.
    size : (width, height), optional
        Of the images, for a file with K alone.

    Returns
    -------
    dict of str and Camera
        By the image's name (COLMAP), the file's name without its suffix (a folder), or the number in the list.

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
    if source.is_dir():
        for folder in (source, source / "0"):
            if any((folder / f"cameras{suffix}").is_file() for suffix in (".bin", ".txt")):
                return read_model(folder)
        files = files_in(source, (".json",))
        if not files:
            raise FileFormatError(f"{source}: no cameras in it: expected JSON files, or COLMAP's cameras and images")
        return {file.stem: Camera.load(file) for file in files}
    if source.suffix.lower() == ".txt" and size is not None:
        with reading(source, "matrix") as file:
            numbers = np.loadtxt(file, dtype=np.float64, ndmin=2)
        try:
            return {"0": Camera(numbers, size)}
        except ArgumentError as error:
            raise FileFormatError(f"{source}: {error}") from error
    if source.suffix.lower() == ".txt":
        raise ArgumentError("size", f"the (width, height) of the images whose K is in {source}", "none")
    data = _listed(read_json(source, "camera JSON"))
    if not isinstance(data, list):
        return {"0": Camera.from_json(data, source)}
    if not data:
        raise FileFormatError(f"{source}: expected cameras, got an empty list")
    listed = cast("list[object]", data)
    return {str(k): Camera.from_json(one, f"{source}: camera {k}") for k, one in enumerate(listed)}


def _listed(data: object) -> object:
    """The cameras of a set's views, or of Open3D's trajectory; anything else as it is."""
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
