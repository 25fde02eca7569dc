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
    """The least and the greatest depth that was read so far."""

    def __init__(self) -> None:
        self._range = np.inf, -np.inf

    def add(self, depth: Depth) -> None:
        """Take a frame's depth into it."""
        known = depth[np.isfinite(depth) & (depth > 0)]
        if known.size:
            self._range = min(self._range[0], float(known.min())), max(self._range[1], float(known.max()))

    def __str__(self) -> str:
        low, high = self._range
        return f"depth from {low:.3g} to {high:.3g}" if low <= high else "no depth"


class DepthOptions(NamedTuple):
    """Options of reading depth: as it is stored, --default-depth, --clean, --noise with --baseline.

    `steady`: they come one after the other, and each is cleaned by what is known from the last; else they are all of
    one scene. `recorded`: a frame may lack depth altogether, and errors name it. `seen`: what came.
    """

    stored: StoredDepth
    default_depth: float | DefaultDepth | None
    clean: Cleaning | None
    noise: tuple[float, float] | None
    steady: bool
    recorded: bool
    seen: DepthRange


class DepthReader:
    """Depth of frames, one after the other: read and, if that is asked for, cleaned by what is known from the last.

    invented: where the last one that was read and cleaned was not measured.
    """

    def __init__(self, depth_options: DepthOptions, losses: Losses) -> None:
        self._options, self._losses = depth_options, losses
        self._last: DepthImage | None = None
        self.invented: NDArray[np.bool_] | None = None

    def read(self, shot: Shot, color: NDArray[Any] | None = None) -> Depth | None:
        """The frame's depth, None if it is lost; `color` guides the cleaning, if it is of the depth's camera."""
        return self._losses.or_none(lambda: self._read(shot, color))

    def _read(self, shot: Shot, color: NDArray[Any] | None) -> Depth:
        camera = shot.depth_camera or shot.camera
        with self.naming(shot):
            depth, unsure = self._options.stored.read_shot(shot)
            if color is not None and shot.depth_camera is None:
                _check_size(depth, color, shot.camera)
        self._losses.add_unsure(unsure)
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
        """Tell whether it is a frame of a recording without any depth."""
        return self._options.recorded and not (np.isfinite(depth) & (depth > 0)).any()

    def registered(self, shot: Shot, depth: Depth) -> Depth:
        """The frame's depth in the camera of its colours."""
        if shot.depth_camera is None:
            return depth
        if self.is_blank(depth):
            return np.full(shot.camera.size[::-1], np.nan, np.float32)
        return ibr.register(depth, shot.depth_camera, shot.camera, noise=self.noise_of(shot))

    def noise_of(self, shot: Shot) -> float | None:
        """The noise of the frame's depth, as `DepthImage` takes it; what is left of it by cleaning is found."""
        return None if self._options.clean else deviation_of(self._options.noise, shot.depth_camera or shot.camera)

    def naming(self, shot: Shot) -> AbstractContextManager[None]:
        """Errors name the frame of a recording."""
        return _naming(shot) if self._options.recorded else nullcontext()


def views_of(
    source: Source, depth_options: DepthOptions, losses: Losses, exposure: Exposure, skipped: Collection[int] = ()
) -> Iterator[DepthImage | None]:
    """The frames of a source, one after the other; None where one is lost, or its number skipped."""
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
    """Raise ArgumentError if the camera or the depth alone is of another size, and say what helps."""
    size = camera.width, camera.height
    if depth.shape == color.shape[:2] and color.shape[1::-1] != size:
        is_alike = color.shape[1] * size[1] == color.shape[0] * size[0]
        helps = " (Camera.resized makes one of the same view)" if is_alike else ""
        expected = f"that of {color.shape[1]}x{color.shape[0]} pixels, as the picture and its depth have{helps}"
        raise ArgumentError("camera", expected, f"one of {size[0]}x{size[1]}")
    if depth.shape[::-1] != size and color.shape[1::-1] == size:
        expected = f"{size[0]}x{size[1]} samples, as its picture has pixels (else --depth-camera with its own camera)"
        raise ArgumentError("depth", expected, f"{depth.shape[1]}x{depth.shape[0]}")


def _carried(last: DepthImage, camera: Camera) -> Depth:
    """Depth of the last frame as the camera sees it now."""
    if camera == last.camera:
        return last.depth
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # it may see nothing of it
        return ibr.warp(last, camera).depth


@contextmanager
def _naming(shot: Shot) -> Generator[None, None, None]:
    """Errors of a frame's arrays become those of its files."""
    try:
        yield
    except ArgumentError as error:
        if error.argument not in ("color", "depth", "confidence", "camera"):
            raise
        files = " with ".join(str(file) for file in (shot.color, shot.depth) if file)
        raise FileFormatError(f"{files}: {error}") from error
