"""Sets of depth images in folders: those that `pyibr place` saves, and frames of colour and depth with their poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any, cast

import numpy as np

from pyibr.core.camera import Camera
from pyibr.core.camera_json import read_json, write_json
from pyibr.core.checks import describe
from pyibr.core.errors import ArgumentError, FileFormatError
from pyibr.core.files import checked_path, written_together
from pyibr.images import DepthImage
from pyibr.io import DepthKind, read_color, read_depth, write_color, write_depth
from pyibr.io.recordings import cameras_of, posed, recording_in

SET_FILE = "frusta.json"
"""The file in a set's folder that lists its views."""


def load(
    folder: str | PathLike[str], *, depth_scale: float | None = None, depth_kind: DepthKind = "z"
) -> list[DepthImage]:
    """Read a folder of depth images.

    A set that `pyibr place` has saved (with a `frusta.json`), or a recording of colour and depth: files
    ``NAME.color.png`` and ``NAME.depth.png``, or folders ``color`` (or ``rgb``) and ``depth``, in any formats that can
    be read, of the same numbers or times; TUM RGB-D with its lists; COLMAP's dense workspace, with its cameras.

    The camera of a frame is in ``NAME.json`` (as `Camera.save` writes it, in the folder or in ``camera/``); or that of
    all is in ``camera.json``, or in ``camera-intrinsics.txt`` or ``intrinsics.K.txt`` with the 3 x 3 numbers of K, and
    ``NAME.pose.txt``, ``groundtruth.txt``, ``trajectory.log`` or ``poses.txt`` (see `pyibr.io.read_poses`) tell the
    poses. Frames of which no pose of their time is known are left out.

    Parameters
    ----------
    folder : path
    depth_scale : float, optional
        Stored units per scene unit, for integer depth: see `read_depth`.
    depth_kind : {"z", "distance", "inverse"}
        What a recording's depth is stored as: see `read_depth`.

    Returns
    -------
    list of DepthImage
        In the order of the set, or of the numbers in the frames' names.

    Raises
    ------
    FileFormatError
        If there is no such folder, nothing of that in it, or a file cannot be read.
    ArgumentError
        If depth is stored as integers and there is no scale.

    Examples
    --------
    >>> import numpy as np
    >>> import pyibr as ibr
    >>> ibr.Camera([[50, 0, 3], [0, 50, 6], [0, 0, 1]], (7, 13)).save("room/camera.json")
    >>> for name, x in (("a", 0.0), ("b", 0.1)):
    ...     ibr.write_color(f"room/{name}.color.png", np.zeros((13, 7, 3), np.uint8))
    ...     ibr.write_depth(f"room/{name}.depth.npy", np.full((13, 7), 2, np.float32))
    ...     pose = np.eye(4)
    ...     pose[0, 3] = x
    ...     np.savetxt(f"room/{name}.pose.txt", pose)
    >>> [view.camera.center.tolist() for view in ibr.load("room")]
    [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]]
    """
    place = checked_path(folder)
    if not place.is_dir():
        raise FileFormatError(f"{place}: no such folder")
    if (place / SET_FILE).exists():
        return [entry.read(place) for entry in read_set(place)[0]]
    recording = recording_in(place)
    if not recording.cameras:
        first = recording.colors[0]
        own = f"{first.stem.removesuffix('.color')}.json"
        raise FileFormatError(f"{place}: has neither {own} nor camera.json for {first.name}")
    cameras = cameras_of(recording)
    frames = zip(recording.colors, recording.depths, cameras, strict=True)
    return [
        _view(c, d, posed(camera, pose), depth_scale, depth_kind) for c, d, (camera, pose) in frames if pose is not None
    ]


def _view(color: Path, depth: Path, camera: Camera, scale: float | None, kind: DepthKind) -> DepthImage:
    image = read_color(color)
    depths = read_depth(depth, depth_scale=scale, depth_kind=kind, camera=camera)
    try:
        return DepthImage(image, depths, camera)
    except ArgumentError as error:
        raise FileFormatError(f"{depth}: {error}") from error


@dataclass(frozen=True)
class SetEntry:
    """A view of a set, as its file lists it.

    Attributes
    ----------
    camera : Camera
    far : float
    color, depth : str
        Names of files in the folder; empty if they were not saved.
    more : dict
        What else there is, for who has written it.
    """

    camera: Camera
    far: float
    color: str
    depth: str
    more: dict[str, Any]

    def read(self, folder: Path) -> DepthImage:
        """The view."""
        if not self.color or not self.depth:
            raise FileFormatError(
                f"{folder / SET_FILE}: has cameras alone; capture them from the mesh with pyibr place"
            )
        color, depth = read_color(folder / self.color), read_depth(folder / self.depth)
        try:
            return DepthImage(color, depth, self.camera, far=self.far)
        except ArgumentError as error:
            raise FileFormatError(f"{folder / self.depth}: {error}") from error


def read_set(path: str | PathLike[str]) -> tuple[list[SetEntry], dict[str, Any]]:
    """The views of a set, of its folder or its file, and what else the file says."""
    file = checked_path(path)
    file = file / SET_FILE if file.is_dir() else file
    return parse_set(read_json(file, "frusta JSON"), file)


def parse_set(data: object, file: Path) -> tuple[list[SetEntry], dict[str, Any]]:
    """Take a set out of a JSON file's contents, as `read_set` does; the file's name is for error messages."""
    if not isinstance(data, dict) or not isinstance(cast("dict[str, object]", data).get("views"), list):
        raise FileFormatError(f"{file}: expected a JSON object with a list of views")
    entries = dict(cast("dict[str, Any]", data))
    return [_entry_of(one, file) for one in cast("list[object]", entries.pop("views"))], entries


def write_set(
    folder: str | PathLike[str],
    views: Sequence[DepthImage],
    more: Sequence[dict[str, Any]] | None = None,
    **about: object,
) -> None:
    """Write views as a set that `load` reads: colours as PNG (floats as NPY), depth as NPY, and the list.

    Parameters
    ----------
    folder : path
        Made if it is missing. Files of a former set there are overwritten; those of views beyond the last one stay.
    views : sequence of DepthImage
    more : sequence of dict, optional
        What the list says of each view beside its camera, `far` and files.
    **about
        What it says of the set.
    """
    place = checked_path(folder)
    listed: list[dict[str, Any]] = []
    with written_together():
        for number, view in enumerate(views):
            kind = "png" if view.shown_color.dtype == np.uint8 else "npy"
            names = {"color": f"color_{number:02d}.{kind}", "depth": f"depth_{number:02d}.npy"}
            write_color(place / names["color"], view.shown_color)
            write_depth(place / names["depth"], view.depth)
            listed.append(entry_json(view.camera, view.far) | names | (more[number] if more else {}))
        write_json(place / SET_FILE, {**about, "views": listed})  # last: it is what names the others


def entry_json(camera: Camera, far: float) -> dict[str, Any]:
    """Return the list's entry of a view: its camera, and from where on it is empty."""
    return {"camera": camera.to_json()} | ({"far": far} if far < np.inf else {})


def _entry_of(data: object, file: Path) -> SetEntry:
    if not isinstance(data, dict) or "camera" not in data:
        raise FileFormatError(f"{file}: expected views with a camera each, got {describe(cast('object', data))}")
    entry = dict(cast("dict[str, Any]", data))
    camera = Camera.from_json(entry.pop("camera"), file)
    far, names = entry.pop("far", np.inf), [entry.pop(key, "") for key in ("color", "depth")]
    if not isinstance(far, (int, float)) or not far > 0:
        raise FileFormatError(f"{file}: far: expected a depth > 0, got {describe(far)}")
    for name in names:
        if not isinstance(name, str) or Path(name).name != name:
            raise FileFormatError(f"{file}: expected the name of a file beside it, got {describe(name)}")
    return SetEntry(camera, float(far), names[0], names[1], entry)
