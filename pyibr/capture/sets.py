"""Sets of depth images in folders: those that `pyibr place` saves, and frames of colour and depth with their poses."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from pyibr.cleaning import sharpen_depth
from pyibr.core.calibrations import listed
from pyibr.core.camera import Camera
from pyibr.core.camera_json import read_json, write_json
from pyibr.core.checks import describe, instance_of
from pyibr.core.errors import ArgumentError, FileFormatError
from pyibr.core.files import checked_path, written_together
from pyibr.images import DepthImage
from pyibr.images.srgb import srgb_from_linear
from pyibr.io import DepthReading, read_color, read_depth, write_color, write_depth
from pyibr.io.exr import is_light
from pyibr.io.layouts import may_be_recording, recording_in
from pyibr.io.layouts.transforms import write_transforms
from pyibr.io.recordings import Shot, cameras_of, shots_of, with_camera
from pyibr.io.video import Video
from pyibr.warp import register

if TYPE_CHECKING:
    from typing_extensions import Unpack

SET_FILE = "frusta.json"
"""The file in a set's folder that lists its views."""

_log = logging.getLogger("pyibr")


def load(
    folder: str | PathLike[str],
    *,
    camera: Camera | None = None,
    min_confidence: float | None = None,
    sharpen: bool | None = None,
    **how: Unpack[DepthReading],
) -> list[DepthImage]:
    """Read a folder of depth images.

    A set that `save` or `pyibr place` has written (with a `frusta.json`); what data sets, phones and networks leave, in
    the layouts that the manual lists, with their cameras, axes and scale; or files ``NAME.color.png`` and
    ``NAME.depth.png``, or folders ``color`` (or ``rgb``) and ``depth``, in any formats that can be read, of the same
    numbers or times. Depth of another camera than the picture's, or with fewer samples, is registered to it.

    Of plain files the camera of a frame is in ``NAME.json`` (as `Camera.save` writes it, in the folder or in
    ``camera/``); or that of all is in ``camera.json``, or in ``camera-intrinsics.txt`` or ``intrinsics.K.txt`` with the
    3 x 3 numbers of K, and ``NAME.pose.txt``, ``groundtruth.txt``, ``trajectory.log`` or ``poses.txt`` (see
    `pyibr.io.read_poses`) tell the poses. Frames without a usable pose, picture or depth are left out, which the logger
    ``pyibr`` tells. Colours of OpenEXR files, which are linear in light, become sRGB, what is brighter than 1 white.

    Parameters
    ----------
    folder : path
        Or a file that is a recording by itself: Record3D's ``.r3d``, ``.bag`` of ROS 1.
    camera : Camera, optional
        Of all frames of a recording, instead of its own; where they were is told by its poses.
    min_confidence : float, optional
        Samples that the recording is less sure of are left out. In the units of its own confidence; by default what
        its layout says.
    sharpen : bool, optional
        Make soft edges of depth sharp (`sharpen_depth`). By default of relative depth.
    **how
        depth_scale, depth_offset, depth_kind, channel, part, near and far, as `read_depth` has them, of a recording. By
        default scale, offset and kind are the layout's.

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
    if not place.exists() or not may_be_recording(place):
        raise FileFormatError(f"{place}: no such folder, nor recording")
    if (place / SET_FILE).exists():
        return [entry.read(place) for entry in read_set(place)[0]]
    recording = recording_in(place) if camera is None else with_camera(recording_in(place), camera)
    if not recording.cameras and recording.known is None:
        first = recording.colors[0]
        own = f"{first.stem.removesuffix('.color')}.json"
        raise FileFormatError(f"{place}: has neither {own} nor camera.json for {first.name}")
    if recording.left_out:
        lone = listed(file.name for file in recording.left_out)
        _log.warning(
            "%s: %d files are left out, as picture or depth is missing: %s", place, len(recording.left_out), lone
        )
    shots = shots_of(recording, cameras_of(recording))
    found = [shot for shot in shots if shot is not None]
    if len(found) < len(shots):
        _log.warning("%s: %d frames without a usable pose are left out", place, len(shots) - len(found))
    video = None if recording.video is None else Video(recording.video).frames([shot.number for shot in found])
    views, lost, unsure = list[DepthImage](), list[FileFormatError](), list[float]()
    for shot in found:
        try:
            color = shot.stored.color(cast("Path", shot.color)) if video is None else next(video)
            view, share = _view(shot, color, min_confidence, sharpen, how)
            views.append(view)
            unsure.append(share)
        except FileFormatError as error:
            lost.append(error)
    if lost and not views:
        raise lost[0]
    if lost:
        _log.warning("%s: %d of %d frames are left out: %s", place, len(lost), len(shots), lost[0])
    if any(unsure):
        _log.info("%s: %.1f %% of the samples are not sure enough; left out", place, 100 * np.mean(unsure))
    return views


def _view(
    shot: Shot, color: NDArray[Any], least: float | None, sharpen: bool | None, how: DepthReading
) -> tuple[DepthImage, float]:
    """The view of a frame, and which share of its samples is left out for want of confidence."""
    try:
        depth, unsure = shot.read_depth(least, **how)
        if sharpen or (sharpen is None and how.get("depth_kind") == "relative"):
            depth = sharpen_depth(depth)
        if shot.depth_camera is not None:
            depth = register(depth, shot.depth_camera, shot.camera)
        shown = srgb_from_linear(color) if shot.color is not None and is_light(shot.color) else color
        return DepthImage(shown, depth, shot.camera), unsure
    except ArgumentError as error:
        if error.argument not in ("color", "depth", "confidence"):
            raise
        raise FileFormatError(f"{shot.depth}: {error}") from error


def save(views: DepthImage | Iterable[DepthImage], folder: str | PathLike[str]) -> None:
    """Write depth images into a folder that `load` reads back to the same bits, and other programs, too.

    Beside pyibr's own files (`frusta.json`, colours as PNG, depth as NPY) there is a `transforms.json` as nerfstudio
    and instant-ngp read it, with depth as 16-bit PNG, unless it cannot tell a camera: an orthographic one, or its lens.

    Parameters
    ----------
    views : DepthImage or sequence of DepthImage
    folder : path
        Made if it is missing. Files of a former set there are overwritten; those of views beyond the last one stay.

    Examples
    --------
    >>> import numpy as np
    >>> import pyibr as ibr
    >>> camera = ibr.Camera([[50, 0, 3], [0, 50, 6], [0, 0, 1]], (7, 13))
    >>> view = ibr.DepthImage(np.zeros((13, 7, 3), np.uint8), np.full((13, 7), 2, np.float32), camera)
    >>> ibr.save([view, view], "saved")
    >>> [one.camera == camera for one in ibr.load("saved")]
    [True, True]
    """
    place = checked_path(folder)
    listed = [views] if isinstance(views, DepthImage) else list(views)
    for view in listed:
        instance_of("views", view, DepthImage, "depth images")
    with written_together():
        _write(place, listed, None, {})
        write_transforms(place, listed)


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
    with written_together():
        _write(checked_path(folder), views, more, about)


def _write(
    place: Path, views: Sequence[DepthImage], more: Sequence[dict[str, Any]] | None, about: dict[str, object]
) -> None:
    listed: list[dict[str, Any]] = []
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
