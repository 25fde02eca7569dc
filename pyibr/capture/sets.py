"""Sets of depth images in folders: sets saved by `pyibr place`, and recordings of colour, depth and poses."""

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
"""File in a set's folder that lists its views."""

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

    The folder holds one of:

    - A set that `save` or `pyibr place` wrote, with a `frusta.json`.
    - Output of a phone or a network, or a data set, in one of the layouts that the manual lists. Its cameras, axes and
      scale are read, too.
    - Plain files ``NAME.color.png`` and ``NAME.depth.png``, or folders ``color`` (or ``rgb``) and ``depth``, in any
      readable formats, with equal numbers or times in their names.

    Depth from another camera than the picture's, or with fewer samples, is registered to the picture.

    For plain files, ``NAME.json`` holds the camera of a frame (as `Camera.save` writes it, in the folder or in
    ``camera/``). Otherwise ``camera.json``, ``camera-intrinsics.txt`` or ``intrinsics.K.txt`` (the 3 x 3 numbers of K)
    holds the camera of all frames, and ``NAME.pose.txt``, ``groundtruth.txt``, ``trajectory.log`` or ``poses.txt``
    (see `pyibr.io.read_poses`) hold the poses. Frames without a usable pose, picture or depth are left out, with a
    warning of the logger ``pyibr``. Colours of OpenEXR files, which are linear in light, become sRGB; values above 1
    become white.

    Parameters
    ----------
    folder : path
        Folder, or a file that is a whole recording: Record3D's ``.r3d``, ``.bag`` of ROS 1, a video with a track
        of colours and a track of depth, such as Azure Kinect's ``.mkv``.
    camera : Camera, optional
        Camera of all frames of a recording, instead of its own; the recording's poses still apply.
    min_confidence : float, optional
        Samples of lower confidence are left out. In the recording's own units; the default depends on its layout.
    sharpen : bool, optional
        Sharpen soft depth edges (`sharpen_depth`). By default only for relative depth.
    **how
        Options of `read_depth` for a recording: depth_scale, depth_offset, depth_kind, channel (also the topic of
        depth in a ROS bag, the track of depth in a video), part, near and far.
        The layout defines the defaults of scale, offset and kind.

    Returns
    -------
    list of DepthImage
        In the order of the set, or of the numbers in the frames' names.

    Raises
    ------
    FileFormatError
        If the folder is missing or holds no depth images, or if a file cannot be read.
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
    if not place.exists() or not may_be_recording(place, how.get("channel")):
        raise FileFormatError(f"{place}: no such folder or recording")
    if (place / SET_FILE).exists():
        return [entry.read(place) for entry in read_set(place)[0]]
    recording = recording_in(place, how.get("channel"))
    recording = recording if camera is None else with_camera(recording, camera)
    if not recording.cameras and recording.known is None:
        first = recording.colors[0]
        own = f"{first.stem.removesuffix('.color')}.json"
        raise FileFormatError(f"{place}: has neither {own} nor camera.json for {first.name}")
    if recording.left_out:
        lone = listed(file.name for file in recording.left_out)
        _log.warning(
            "%s: %d files are left out, because picture or depth is missing: %s", place, len(recording.left_out), lone
        )
    shots = shots_of(recording, cameras_of(recording))
    found = [shot for shot in shots if shot is not None]
    if len(found) < len(shots):
        _log.warning("%s: %d frames without a usable pose are left out", place, len(shots) - len(found))
    video = None if recording.video is None else Video(recording.video).frames([shot.number for shot in found])
    views, lost, unsure = list[DepthImage](), list[FileFormatError](), list[float]()
    for shot in found:
        shown = None if video is None else next(video)  # nothing is read after a video's damaged frame
        try:
            color = shot.stored.picture(cast("Path", shot.color)) if shown is None else shown
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
        _log.info("%s: %.1f %% of the samples are left out for low confidence", place, 100 * np.mean(unsure))
    return views


def _view(
    shot: Shot, color: NDArray[Any], least: float | None, sharpen: bool | None, how: DepthReading
) -> tuple[DepthImage, float]:
    """Return the view of a frame, and the fraction of its samples left out for low confidence."""
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
    """Write depth images into a folder, which `load` reads back bit for bit, and which other programs read, too.

    The folder holds `frusta.json`, colours as PNG and depth as NPY. For nerfstudio and instant-ngp, a
    `transforms.json` with depth as 16-bit PNG is added, unless it cannot describe a camera: an orthographic one, or
    its lens.

    Parameters
    ----------
    views : DepthImage or sequence of DepthImage
    folder : path
        Created if missing. Files of an earlier set are overwritten; files of views beyond the last one stay.

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
    """A view of a set, as listed in the set's file."""

    camera: Camera
    far: float
    guessed: bool
    color: str  # name of a file in the folder; empty if not saved
    depth: str
    more: dict[str, Any]  # other fields of the entry, for the program that wrote them

    def read(self, folder: Path) -> DepthImage:
        """Read the view."""
        if not self.color or not self.depth:
            raise FileFormatError(
                f"{folder / SET_FILE}: has only cameras; capture their images from the mesh with pyibr place"
            )
        color, depth = read_color(folder / self.color), read_depth(folder / self.depth)
        try:
            return DepthImage(color, depth, self.camera, far=self.far, guessed=self.guessed)
        except ArgumentError as error:
            raise FileFormatError(f"{folder / self.depth}: {error}") from error


def read_set(path: str | PathLike[str]) -> tuple[list[SetEntry], dict[str, Any]]:
    """Read the views of a set from its folder or file, and the file's other fields."""
    file = checked_path(path)
    file = file / SET_FILE if file.is_dir() else file
    return parse_set(read_json(file, "frusta JSON"), file)


def parse_set(data: object, file: Path) -> tuple[list[SetEntry], dict[str, Any]]:
    """Parse a set from a JSON file's contents, as `read_set` does; `file` is for error messages."""
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
    folder, views
        As for `save`.
    more : sequence of dict, optional
        Fields of each view's entry besides its camera, `far` and files.
    **about
        Fields of the set.
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
        listed.append(entry_json(view.camera, view.far, view.guessed) | names | (more[number] if more else {}))
    write_json(place / SET_FILE, {**about, "views": listed})  # last, because it names the other files


def entry_json(camera: Camera, far: float, guessed: bool = False) -> dict[str, Any]:
    """Return a view's entry in the list: its camera, the depth from which it is empty, and whether it is a guess."""
    entry: dict[str, Any] = {"camera": camera.to_json()}
    return entry | ({"far": far} if far < np.inf else {}) | ({"guessed": True} if guessed else {})


def _entry_of(data: object, file: Path) -> SetEntry:
    if not isinstance(data, dict) or "camera" not in data:
        raise FileFormatError(f"{file}: expected views with a camera each, got {describe(cast('object', data))}")
    entry = dict(cast("dict[str, Any]", data))
    camera = Camera.from_json(entry.pop("camera"), file)
    far, guessed = entry.pop("far", np.inf), entry.pop("guessed", False)
    names = [entry.pop(key, "") for key in ("color", "depth")]
    if not isinstance(far, (int, float)) or not far > 0:
        raise FileFormatError(f"{file}: far: expected a depth > 0, got {describe(far)}")
    if not isinstance(guessed, bool):
        raise FileFormatError(f"{file}: guessed: expected true or false, got {describe(guessed)}")
    for name in names:
        if not isinstance(name, str) or Path(name).name != name:
            raise FileFormatError(f"{file}: expected the name of a file beside it, got {describe(name)}")
    return SetEntry(camera, float(far), guessed, names[0], names[1], entry)
