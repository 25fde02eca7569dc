"""Pictures of a page for a camera and a style, with the time of each stage."""

from __future__ import annotations

import time
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

import numpy as np

from pyibr.app.live.stream import Picture
from pyibr.app.view.methods import RenderMethod, Style
from pyibr.app.view.moving import WarpedFrame
from pyibr.app.view.overlays import class_colors, difference, view_colors
from pyibr.core.camera import Camera
from pyibr.core.errors import ArgumentError
from pyibr.images.frame import Frame
from pyibr.images.metrics import psnr
from pyibr.images.pictures import Image, depth_colors
from pyibr.images.srgb import in_bytes
from pyibr.opencl.watch import LaunchTimes, watching

_LINE = (128, 128, 128)  # between panes


@dataclass
class _Stopwatch:
    """Collects seconds by name."""

    stages: dict[str, float] = field(default_factory=dict[str, float])

    @contextmanager
    def timing(self, name: str) -> Generator[None]:
        start = time.perf_counter()
        yield
        self.stages[name] = self.stages.get(name, 0.0) + time.perf_counter() - start


def paint(methods: Mapping[str, RenderMethod], camera: Camera, style: Style) -> Picture:
    """Draw a picture from a camera in a style.

    Raises
    ------
    ArgumentError
        If the style names an unknown method, or has parameters that the things refuse.
    """
    watch = _Stopwatch()
    if style.other is None or style.layout == "one":
        frame = _drawn(methods, camera, style, style.method, watch)
        note = "Warped from the last exact picture" if isinstance(frame, WarpedFrame) else ""
        return Picture(_shown(frame, style, watch), frame.depth, camera, watch.stages, note)
    names, style = (style.method, style.other), replace(style, moving=False)  # only exact frames are compared
    if style.layout == "side by side":
        return _beside(methods, camera, style, watch)
    one, other = (_drawn(methods, camera, style, name, watch) for name in names)
    colors = [_shown(frame, style, watch) for frame in (one, other)]
    note = _apart(one, other)
    with watch.timing("compare"):
        if style.layout == "difference":
            return Picture(difference(colors[0], colors[1], style.gain), one.depth, camera, watch.stages, note)
        border = min(max(round(style.swipe * camera.width), 0), camera.width)
        color, depth = colors[0].copy(), one.depth.copy()
        color[:, border:], depth[:, border:] = colors[1][:, border:], other.depth[:, border:]
        if 0 < border < camera.width:
            color[:, border] = _LINE
    return Picture(color, depth, camera, watch.stages, note)


def kernel_seconds(methods: Mapping[str, RenderMethod], camera: Camera, style: Style) -> dict[str, float]:
    """Seconds of each kernel for a picture, measured by waiting for the queue after each kernel."""
    with watching(LaunchTimes()) as seen:
        paint(methods, camera, style)
    return {name: sum(values) for name, values in seen.of.items()}


def _beside(methods: Mapping[str, RenderMethod], camera: Camera, style: Style, watch: _Stopwatch) -> Picture:
    """Both methods and their difference, each as the middle third of its picture."""
    width = max((camera.width - 2) // 3, 1)
    K = camera.K.copy()
    K[0, 2] -= 0.5 * (camera.width - width)  # keeps the middle in the middle
    narrow = Camera(K, (width, camera.height), camera.world_from_camera)
    one, other = (_drawn(methods, narrow, style, name, watch) for name in (style.method, style.other or style.method))
    colors = [_shown(frame, style, watch) for frame in (one, other)]
    note = _apart(one, other)
    with watch.timing("compare"):
        made = np.empty((camera.height, camera.width, 3), np.uint8)
        made[:] = _LINE
        for number, pane in enumerate([*colors, difference(colors[0], colors[1], style.gain)]):
            first = number * (width + 1)
            made[:, first : first + width] = pane[:, : max(camera.width - first, 0)]
    return Picture(made, None, camera, watch.stages, note)


def _drawn(methods: Mapping[str, RenderMethod], camera: Camera, style: Style, name: str, watch: _Stopwatch) -> Frame:
    method = methods.get(name)
    if method is None:
        raise ArgumentError("way", f"one of {', '.join(methods)}", name)
    with watch.timing("draw" if name == style.method else f"draw {name}"):
        return method.draw(camera, style)


def _shown(frame: Frame, style: Style, watch: _Stopwatch) -> Image:
    if style.show == "color":
        return in_bytes(frame.color)
    with watch.timing("overlay"):
        if style.show == "depth":
            return depth_colors(frame, style.background)
        return class_colors(frame) if style.show == "classes" else view_colors(frame, style.background)


def _apart(one: Frame, other: Frame) -> str:
    """Describe the difference of two frames in common pixels, and the fraction of pixels that only one covers."""
    both, either = one.valid & other.valid, one.valid | other.valid
    only = np.count_nonzero(one.valid ^ other.valid) / max(np.count_nonzero(either), 1)
    if not both.any():
        return "no pixels in common"
    decibels = psnr(in_bytes(one.color), in_bytes(other.color), valid=both)
    return f"{decibels:.1f} dB in common pixels; only one covers {only:.1%}"
