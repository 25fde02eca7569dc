"""Cameras of single pictures, from files or from lens data."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import typer
from numpy.typing import NDArray

from pyibr.app.options import print_note, printable_text
from pyibr.core.calibrations import listed
from pyibr.core.camera import Camera
from pyibr.core.errors import ArgumentError, FileFormatError
from pyibr.io import read_cameras, read_color, read_depth, read_poses
from pyibr.io.image import focal_35mm_of
from pyibr.io.layouts import recording_in
from pyibr.io.recordings import Stored, posed, size_of
from pyibr.warp.register import warn_of_one_place

ExtrinsicsFile = Annotated[
    Path | None, typer.Option("--extrinsics", help="The transform from the depth's camera to the colours' camera")
]
_FOV = 60.0  # degrees along the longer side, if nothing else is known


class LensOptions(NamedTuple):
    """Options that describe a camera without a file."""

    fov: Annotated[float | None, typer.Option(metavar="DEGREES", help="Without a camera: horizontal field of view")] = (
        None
    )
    focal_35mm: Annotated[
        float | None,
        typer.Option("--focal-35mm", metavar="MM", help="Without a camera: the focal length, on 35 mm film"),
    ] = None

    def camera_of(self, picture: Path, file: Path | None, size: tuple[int, int] | None = None) -> Camera:
        """The picture's camera, from the file, these options, EXIF data, or a default, which is reported.

        size: (width, height), if `picture` cannot be read as a picture.
        """
        given = {"--camera": file, "--fov": self.fov, "--focal-35mm": self.focal_35mm}
        named = [name for name, value in given.items() if value is not None]
        if len(named) > 1:
            raise ArgumentError(named[1], f"none together with {named[0]}", str(given[named[1]]))
        if file is not None:
            return camera_in(file, picture)
        width, height = size = size or size_of(picture)
        if self.fov is not None:
            return Camera.from_fov(size, fov_x=self.fov)
        focal = focal_35mm_of(picture, size) if self.focal_35mm is None else self.focal_35mm
        if focal is not None:
            if self.focal_35mm is None:
                print_note(f"{printable_text(picture)}: lens of {focal:.3g} mm (on 35 mm film) by its EXIF data")
            return Camera.from_fov(size, focal_35mm=focal)
        print_note(
            f"{printable_text(picture)}: assumed {_FOV:g} degrees across; else set --camera, --fov or --focal-35mm"
        )
        return Camera.from_fov(size, fov_x=_FOV) if width >= height else Camera.from_fov(size, fov_y=_FOV)

    def camera_of_folder(self, folder: Path, file: Path | None, channel: str | None) -> Camera | None:
        """The camera of a recording's pictures; None if no option replaces the recording's own."""
        if file is None and self == LensOptions():
            return None
        recording = recording_in(folder, channel)
        return self.camera_of(recording.colors[0], file, recording.size)


def camera_in(file: Path, picture: Path, read: Callable[[Path], NDArray[Any]] = read_color) -> Camera:
    """The file's camera; among several, the camera with the picture's name, or with its size as `read` gives it."""
    found: dict[str, Camera] = {}
    with suppress(ArgumentError):  # the file lacks the size
        found = read_cameras(file)
    if len(found) != 1:
        found = read_cameras(file, size=size_of(picture, read))
    own = [camera for name, camera in found.items() if len(found) == 1 or name in (picture.name, picture.stem)]
    if not own:
        raise FileFormatError(f"{file}: expected one camera, as {file}#NAME; got {listed(found)}")
    return own[0]


def depth_camera_in(file: Path, depth: Path, stored: Stored, color: Camera, extrinsics: Path | None) -> Camera:
    """The file's camera; among several, the one with the depth's name or size. extrinsics: to the colours' camera."""
    own = camera_in(file, depth, stored.depth or (lambda path: read_depth(path, depth_scale=1)))
    if extrinsics is None:
        warn_of_one_place(own, color)
        return own
    return posed(own, color.world_from_camera @ read_poses(extrinsics).world_from_camera[0])
