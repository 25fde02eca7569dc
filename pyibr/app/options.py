"""Options that several commands share."""

from __future__ import annotations

import math
import os
import re
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
import typer
from numpy.typing import NDArray

import pyibr as ibr
from pyibr.core.camera import Camera
from pyibr.core.errors import ArgumentError
from pyibr.images import DepthImage
from pyibr.images.depth_image import DefaultDepth
from pyibr.io import DepthKind, DepthReading
from pyibr.io.depth_frames import DepthFrames, frames_in
from pyibr.io.recordings import Shot
from pyibr.warp.filling import Fill

DepthFiles = Annotated[
    Path,
    typer.Argument(
        metavar="DEPTH",
        help="Planar depth: PNG, TIFF, NPY, NPZ, PFM, EXR, COLMAP .bin; a folder of such files; or a recording",
    ),
]
CameraFile = Annotated[Path | None, typer.Option(metavar="FILE[#NAME]", help="Its camera: a calibration of any kind")]
Holes = Annotated[int, typer.Option(help="Pixels: cleaning fills gaps up to twice as wide; 0: none")]
DefaultDepthText = Annotated[
    str,
    typer.Option(
        metavar="DEPTH", help="Depth for samples without depth, such as sky; farthest: the farthest sample's; none"
    ),
]
ExposureOption = Annotated[
    float, typer.Option("--exposure", metavar="STOPS", help="Brighten colours in EXR by 2^STOPS")
]
NoiseOption = Annotated[
    float | None,
    typer.Option(metavar="PIXELS", help="Noise of the disparity that depth is computed from; needs --baseline"),
]
Baseline = Annotated[
    float | None, typer.Option(help="Baseline of the two cameras that measured the depth, in scene units; for --noise")
]
Take = Annotated[str | None, typer.Option(metavar="A:B:STEP", help="Frames of the recording to use, as 10:90:2")]
FillOption = Annotated[
    Literal["none", Fill], typer.Option("--fill", help="Fill holes: from the background, from all around")
]
Size = Annotated[
    tuple[int, int] | None, typer.Option(metavar="W H", help="Size of the pictures; default: the camera's")
]
Samples = Annotated[int, typer.Option(help="Samples a pixel: 1, 4, 9, 16 ...; several make silhouettes smooth")]
DeviceName = Annotated[str | None, typer.Option(help="OpenCL device: part of its name, or its number")]


_FAR = 10.0  # for relative depth


class Cleaning(NamedTuple):
    """Options of cleaning depth."""

    holes: Holes = 8
    strength: Annotated[float, typer.Option(help="Strength of the smoothing of noise, 0 to 10")] = 1.0


class CleaningOptions(NamedTuple):
    """Options of cleaning, if asked for, and of the noise of measured depth."""

    clean: Annotated[
        bool, typer.Option("--clean", help="Clean the depth: flying pixels, speckle, small holes, noise")
    ] = False
    holes: Holes = 8
    noise: NoiseOption = None
    baseline: Baseline = None

    def checked(self) -> tuple[Cleaning | None, tuple[float, float] | None]:
        """Check the options; return the options of cleaning, None without --clean, and the result of `noise_of`."""
        if not self.clean and self.holes != Cleaning().holes:
            raise ArgumentError("--holes", "--clean with it", str(self.holes))
        return Cleaning(self.holes) if self.clean else None, noise_of(self.noise, self.baseline)


class StoredDepth(NamedTuple):
    """Options of the storage of depth, and of the samples to use."""

    near: Annotated[float, typer.Option(help="Relative depth: the nearest depth")] = 1.0
    far: Annotated[
        float,
        typer.Option(help="Samples at this depth or beyond hold no surface; relative depth: the farthest depth, 10"),
    ] = math.inf
    sharpen: Annotated[
        bool | None, typer.Option("--sharpen/--no-sharpen", help="Sharpen soft edges; default: only for relative depth")
    ] = None
    depth_scale: Annotated[
        float | None, typer.Option(help="Stored depth units per scene unit: 1000 for millimetres to metres")
    ] = None
    depth_offset: Annotated[
        float, typer.Option(help="Stored units added before --depth-scale: Middlebury's doffs, for disparity in pixels")
    ] = 0.0
    depth_kind: Annotated[
        DepthKind,
        typer.Option(
            "--depth-kind",
            "--depth-is",
            help="Stored quantity: z, distance along the rays, inverse (1/z; disparity by its scale), or relative: "
            "inverse without a unit, as networks estimate it",
        ),
    ] = "z"
    min_confidence: Annotated[
        float | None,
        typer.Option(help="Lowest confidence of samples, in its stored unit; default: by the layout"),
    ] = None
    depth_channel: Annotated[
        str | None,
        typer.Option(
            "--depth-channel",
            "--depth-topic",
            "--depth-track",
            metavar="[PART:]NAME",
            help="Channel of depth in EXR, as ViewLayer.Depth.Z; array in NPZ, HDF5; topic in a bag; track in a video",
        ),
    ] = None

    @property
    def how(self) -> DepthReading:
        """Arguments of `read_depth` for these options."""
        part, _, channel = (self.depth_channel or "").rpartition(":")
        far = _FAR if self.far == math.inf else self.far
        return DepthReading(
            depth_scale=self.depth_scale,
            depth_offset=self.depth_offset,
            depth_kind=self.depth_kind,
            near=self.near,
            far=far,
            part=part or None,
            channel=channel or None,
        )

    def read(self, path: Path, camera: Camera | None) -> NDArray[np.float32]:
        """The planar depth of a file with this camera; for several frames only the first, with a note."""
        frames = frames_in(path, self.how.get("channel"))
        if frames is None:
            return self._sharpened(ibr.read_depth(path, camera=camera, **self.how))
        print_note(f"{printable_text(path)}: only the first of {len(frames)} frames is used")
        return self.read_frame(frames, 0, camera)

    def read_frame(self, frames: DepthFrames, number: int, camera: Camera | None) -> NDArray[np.float32]:
        """The planar depth of one frame of a file with several."""
        return self._sharpened(frames.read_one(number, camera, self.how))

    def read_shot(self, shot: Shot) -> tuple[NDArray[np.float32], float]:
        """The planar depth of a frame, and the fraction of its samples left out for low confidence."""
        depth, unsure = shot.read_depth(self.min_confidence, **self.how)
        return self._sharpened(depth), unsure

    def load(self, folder: Path, camera: Camera | None = None) -> list[DepthImage]:
        """The views of a folder.

        camera: replaces the folder's.
        """
        views = ibr.load(folder, camera=camera, min_confidence=self.min_confidence, sharpen=self.sharpen, **self.how)
        return [
            DepthImage(one.color, one.depth, one.camera, far=min(self.empty_from, one.far), normals=one.normals)
            for one in views
        ]

    def _sharpened(self, depth: NDArray[np.float32]) -> NDArray[np.float32]:
        """Sharpen the edges of depth if an option or its kind asks for it."""
        wanted = self.depth_kind == "relative" if self.sharpen is None else self.sharpen
        return ibr.sharpen_depth(depth) if wanted else depth

    @property
    def empty_from(self) -> float:
        """Depth at and beyond which samples hold no surface."""
        return math.inf if self.depth_kind == "relative" else self.far


def given_of(options: Any) -> list[str]:
    """Names of the options in a group that differ from their defaults."""
    defaults = options._field_defaults
    return [f"--{name.replace('_', '-')}" for name, value in options._asdict().items() if value != defaults[name]]


def default_depth_of(text: str) -> float | DefaultDepth | None:
    """Parse the value of --default-depth."""
    if text in ("none", "farthest"):
        return None if text == "none" else "farthest"
    try:
        return float(text)
    except ValueError:
        raise ArgumentError("--default-depth", "a depth > 0, farthest or none", text) from None


def fill_of(text: Literal["none", Fill]) -> Fill | None:
    """Parse the value of --fill."""
    return None if text == "none" else text


def noise_of(pixels: float | None, baseline: float | None) -> tuple[float, float] | None:
    """Check that --noise and --baseline are given together, and return them."""
    for name, value, other in (("--noise", pixels, "--baseline"), ("--baseline", baseline, "--noise")):
        if value is None and (pixels, baseline) != (None, None):
            raise ArgumentError(name, f"a number > 0 together with {other}", "none")
        if value is not None and not value > 0:
            raise ArgumentError(name, "a number > 0", str(value))
    return None if pixels is None or baseline is None else (pixels, baseline)


def deviation_of(noise: tuple[float, float] | None, camera: Camera) -> float | None:
    """Convert the result of `noise_of` to the noise of a camera's depth, as for `DepthImage`."""
    return None if noise is None else ibr.disparity_noise(noise[0], float(camera.K[0, 0]), noise[1])


def printable_text(text: object, lines: bool = False) -> str:
    """Convert a file name to printable text; undecodable bytes and control characters are replaced.

    lines: whether the text has several lines.
    """
    shown = os.fsencode(str(text)).decode("utf-8", "replace")
    steers = r"[\x00-\x09\x0b-\x1f\x7f-\x9f]" if lines else r"[\x00-\x1f\x7f-\x9f]"
    return re.sub(steers, lambda found: found[0].encode("unicode_escape").decode("ascii"), shown)


def print_note(text: str) -> None:
    """Print a note that is not an error."""
    typer.secho(text, err=True, fg="yellow")


def device_of(name: str | None) -> AbstractContextManager[object]:
    """Context that uses the device of --device."""
    return ibr.use_device(name) if name else nullcontext()
