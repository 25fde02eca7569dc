"""Frames of sources as depth images: read, cleaned, registered."""

from __future__ import annotations

import functools
import warnings
from collections.abc import Collection, Generator, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import pyibr as ibr
from pyibr.app.commands.exposure import Exposure
from pyibr.app.commands.sources import Losses, Source
from pyibr.app.options import Cleaning, StoredDepth, deviation_of
from pyibr.core.camera import Camera
from pyibr.core.errors import ArgumentError, FileFormatError
from pyibr.images import DepthImage
from pyibr.images.depth_image import DefaultDepth
from pyibr.io.recordings import Shot

Depth = NDArray[np.float32]


class DepthRange:
    """Smallest and largest depth read so far."""

    def __init__(self) -> None:
        self._range = np.inf, -np.inf

    def add(self, depth: Depth) -> None:
        """Extend the range by a frame's depth."""
        known = depth[np.isfinite(depth) & (depth > 0)]
        if known.size:
            self._range = min(self._range[0], float(known.min())), max(self._range[1], float(known.max()))

    def __str__(self) -> str:
        low, high = self._range
        return f"depth from {low:.3g} to {high:.3g}" if low <= high else "no depth"


class DepthOptions(NamedTuple):
    """Options for reading depth: its storage, --default-depth, --clean, --noise with --baseline.

    `steady`: frames form a sequence, and the last frame helps to clean the next; else all show one scene.
    `recorded`: frames may lack depth, and errors name the frame. `seen`: collects the depth range.
    """

    stored: StoredDepth
    default_depth: float | DefaultDepth | None
    clean: Cleaning | None
    noise: tuple[float, float] | None
    steady: bool
    recorded: bool
    seen: DepthRange


class DepthReader:
    """Reads the depth of a sequence of frames, and cleans it, if asked for, with the last frame's help.

    invented: mask of the samples of the last cleaned frame that were not measured.
    """

    def __init__(self, depth_options: DepthOptions, losses: Losses) -> None:
        self._options, self._losses = depth_options, losses
        self._last: DepthImage | None = None
        self.invented: NDArray[np.bool_] | None = None

    def read(self, shot: Shot, color: NDArray[Any] | None = None) -> Depth | None:
        """The frame's depth, None if it is lost; `color` guides the cleaning if depth and colours share a camera."""
        return self._losses.or_none(lambda: self._read(shot, color))

    def _read(self, shot: Shot, color: NDArray[Any] | None) -> Depth:
        camera = shot.depth_camera or shot.camera
        with self.naming(shot):
            depth, unsure = self._options.stored.read_shot(shot)
            if color is not None and shot.depth_camera is None:
                _check_size(depth, color, shot.camera)
        self._losses.unsure.append(unsure)
        self._options.seen.add(depth)
        how = self._options.clean
        if how is None:
            return depth
        before = _carried(self._last, camera) if self._last is not None and self._options.steady else None
        with self.naming(shot):
            guide = color if shot.depth_camera is None else None
            told = deviation_of(self._options.noise, camera)
            depth, self.invented = ibr.clean_depth(depth, guide, before=before, noise=told, **how._asdict())
            if np.isfinite(depth).any():
                self._last = DepthImage(None, depth, camera)
        return depth

    def is_blank(self, depth: Depth) -> bool:
        """Tell whether the frame belongs to a recording and has no depth."""
        return self._options.recorded and not (np.isfinite(depth) & (depth > 0)).any()

    def registered(self, shot: Shot, depth: Depth) -> Depth:
        """Register the frame's depth to the camera of its colours."""
        if shot.depth_camera is None:
            return depth
        if self.is_blank(depth):
            return np.full(shot.camera.size[::-1], np.nan, np.float32)
        return ibr.register(depth, shot.depth_camera, shot.camera, noise=self.noise_of(shot))

    def noise_of(self, shot: Shot) -> float | None:
        """Noise of the frame's depth for `DepthImage`; None after cleaning: the remaining noise is estimated."""
        return None if self._options.clean else deviation_of(self._options.noise, shot.depth_camera or shot.camera)

    def naming(self, shot: Shot) -> AbstractContextManager[None]:
        """Context in which errors name the frame of a recording."""
        return _naming(shot) if self._options.recorded else nullcontext()


def views_of(
    source: Source, depth_options: DepthOptions, losses: Losses, exposure: Exposure, skipped: Collection[int] = ()
) -> Iterator[DepthImage | None]:
    """Yield the frames of a source; None if a frame is lost or its number skipped."""
    depths = DepthReader(depth_options, losses)
    for shot, stored in zip(source.shots, source.colors(losses, skipped), strict=True):
        color = None if stored is None else exposure.shown(stored, shot.color)
        depth = None if color is None else depths.read(shot, color)
        if color is None or depth is None:
            yield None
        else:
            yield losses.or_none(functools.partial(_view_of, shot, color, depth, depths, depth_options))


def _view_of(
    shot: Shot, color: NDArray[Any], depth: Depth, depths: DepthReader, depth_options: DepthOptions
) -> DepthImage:
    with depths.naming(shot):
        default_depth = None if depths.is_blank(depth) else depth_options.default_depth
        view = DepthImage(
            color,
            depths.registered(shot, depth),
            shot.camera,
            far=depth_options.stored.empty_from,
            default_depth=default_depth,
            noise=depths.noise_of(shot),
        )
        if not depth_options.recorded and not view.valid.any():
            raise ArgumentError("depth", "at least one valid sample", f"none in {shot.depth}")
    return view


def _check_size(depth: Depth, color: NDArray[Any], camera: Camera) -> None:
    """Raise ArgumentError with a hint if only the camera or only the depth has another size."""
    size = camera.width, camera.height
    if depth.shape == color.shape[:2] and color.shape[1::-1] != size:
        is_alike = color.shape[1] * size[1] == color.shape[0] * size[0]
        helps = " (Camera.resized converts it)" if is_alike else ""
        expected = f"a camera of {color.shape[1]}x{color.shape[0]} pixels, as picture and depth have{helps}"
        raise ArgumentError("camera", expected, f"a camera of {size[0]}x{size[1]}")
    if depth.shape[::-1] != size and color.shape[1::-1] == size:
        expected = f"{size[0]}x{size[1]} samples, the size of its picture (or give --depth-camera)"
        raise ArgumentError("depth", expected, f"{depth.shape[1]}x{depth.shape[0]}")


def _carried(last: DepthImage, camera: Camera) -> Depth:
    """Warp the last frame's depth to the current camera."""
    if camera == last.camera:
        return last.depth
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # the last frame may be out of view
        return ibr.warp(last, camera).depth


@contextmanager
def _naming(shot: Shot) -> Generator[None, None, None]:
    """Context that turns errors of a frame's arrays into errors of its files."""
    try:
        yield
    except ArgumentError as error:
        if error.argument not in ("color", "depth", "confidence", "camera"):
            raise
        files = " with ".join(str(file) for file in (shot.color, shot.depth) if file)
        raise FileFormatError(f"{files}: {error}") from error
