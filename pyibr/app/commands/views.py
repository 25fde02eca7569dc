"""Frames of sources as depth images: read, cleaned, registered."""

from __future__ import annotations

import warnings
from collections.abc import Generator, Iterator
from contextlib import contextmanager, nullcontext
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import pyibr as ibr
from pyibr.app.commands.sources import Shot, Source
from pyibr.core.camera import Camera
from pyibr.core.errors import ArgumentError
from pyibr.images import DepthImage
from pyibr.images.depth_image import Backdrop

Depth = NDArray[np.float32]


class Reading(NamedTuple):
    """How frames are read: --depth-scale, --far, --backdrop, --clean.

    `steady`: they come one after the other, and each is cleaned by what is known from the last; else they are all of
    one scene. `recorded`: a frame may lack depth altogether, and errors name the frame.
    """

    scale: float | None
    far: float
    backdrop: float | Backdrop | None
    clean: bool
    steady: bool
    recorded: bool


def views_of(source: Source, reading: Reading) -> Iterator[DepthImage]:
    """The frames of a source, one after the other."""
    last: DepthImage | None = None
    for shot, color in zip(source.shots, source.colors(), strict=True):
        depth = ibr.read_depth(shot.depth, reading.scale)
        with _naming(shot) if reading.recorded else nullcontext():
            if reading.clean:
                camera = shot.depth_camera or shot.camera
                before = _carried(last, camera) if last is not None and reading.steady else None
                guide = color if shot.depth_camera is None else None
                depth = ibr.clean_depth(depth, guide, before=before).depth
                if np.isfinite(depth).any():
                    last = DepthImage(None, depth, camera)
            view = _view(shot, color, depth, reading)
        yield view


def _view(shot: Shot, color: NDArray[Any], depth: Depth, reading: Reading) -> DepthImage:
    is_blank = reading.recorded and not (np.isfinite(depth) & (depth > 0)).any()
    if shot.depth_camera is not None:
        height, width = shot.camera.size[::-1]
        nothing = np.full((height, width), np.nan, np.float32)
        depth = nothing if is_blank else ibr.register(depth, shot.depth_camera, shot.camera)
    view = DepthImage(color, depth, shot.camera, reading.far, None if is_blank else reading.backdrop)
    if not reading.recorded and not view.valid.any():
        raise ArgumentError("depth", "at least one valid sample", f"none in {shot.depth}")
    return view


def _carried(last: DepthImage, camera: Camera) -> Depth:
    """Depth of the last frame as the camera sees it now."""
    if camera == last.camera:
        return last.depth
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # it may see nothing of it
        return ibr.warp(last, camera).depth


@contextmanager
def _naming(shot: Shot) -> Generator[None, None, None]:
    """Errors name the frame."""
    try:
        yield
    except ArgumentError as error:
        if error.argument not in ("color", "depth"):
            raise
        name = f"{shot.color} with {shot.depth}: {error.argument}"
        raise ArgumentError(name, error.expected, error.got) from error
