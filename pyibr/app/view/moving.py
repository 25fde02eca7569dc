"""Pictures for a moving camera, warped from the last exact ones where these take long to draw."""

from __future__ import annotations

import contextvars
import math
import threading
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera
from pyibr.core.rotations import rvec_from_rotation
from pyibr.images import DepthImage, Frame
from pyibr.warp.view import WarpedView
from pyibr.warp.warp import warp

Draw = Callable[[Camera], Frame]

_FAST = 0.015  # seconds: things that are drawn in less are drawn exactly for a moving camera, too
_PACE = 1 / 40  # seconds from warp to warp while an exact picture is drawn, which needs time, too
_KEPT, _LOOKS = 4, 4  # numbers of exact pictures for each look, and of looks
_NEAR = 0.03  # shift of a picture, in widths, from which the next exact picture is drawn meanwhile
_FAR = 0.8  # shift from which the warp would show too little
_BORDER = 0.125  # width beside an exact picture for a moving camera, in sides: what its motion will uncover
_CUT_RATIO = 1.2  # greatest ratio of neighbouring depths, which are rough where Gaussians intersect
_REACH = 8  # pixels: reach of a surface's depth into its faint border
_BEYOND = 100.0  # depth of empty pixels, in greatest depths


class WarpedFrame(Frame):
    """A frame that was warped from an exact picture. Faint borders of surface count as surface, and are valid."""


@dataclass(frozen=True)
class _Exact:
    """An exact picture."""

    frame: Frame
    camera: Camera  # of the page: the frame may have a border around its picture
    look: object
    seconds: float  # that it took

    @cached_property
    def near(self) -> float:
        """Depth of near surface: a tenth of the pixels with surface are nearer."""
        depth = self.frame.depth[self.frame.valid]
        return float(np.percentile(depth[::16], 10)) if depth.size else 1.0

    @cached_property
    def beyond(self) -> float:
        """Depth far behind all surface, for pixels without any."""
        return _BEYOND * float(self.frame.depth[self.frame.valid].max(initial=0.0)) or _BEYOND

    @cached_property
    def thing(self) -> WarpedView:
        """The picture as a thing that is warped, holes filled.

        Colours stay as they are, mixed with what is behind them: without motion, the warp shows the exact picture.
        """
        view = DepthImage(self.frame.color, _with_faint(self.frame, self.beyond), self.frame.camera)
        return WarpedView(view, cut_ratio=_CUT_RATIO, fill="background")

    def prepare(self) -> None:
        """Warp the picture a little, which builds the kernels and the surface."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # the picture may be empty
            warp(self.thing, self.camera.moved(*(0.01 * self.near * np.array([2, 1, 1]))))

    def shift(self, camera: Camera) -> float:
        """Shift of the picture's content in another camera's picture, in picture widths."""
        one, other = self.camera, camera
        focal = other.K[0, 0] / other.width
        angle = np.linalg.norm(rvec_from_rotation(one.world_from_camera[:3, :3].T @ other.world_from_camera[:3, :3]))
        moved = np.linalg.norm(other.center - one.center) / self.near
        return float(focal * (angle + moved) + abs(np.log(focal * one.width / one.K[0, 0])))


class LastPictures:
    """The last exact pictures of a scene, from which pictures for a moving camera are warped.

    While the camera moves away from them, the next one is drawn on another thread, whose call lets the warps pass.
    """

    def __init__(self) -> None:
        self._kept: list[_Exact] = []
        self._lock = threading.Lock()
        self._drawing: threading.Thread | None = None
        self._failed: object = None  # look of the last picture that could not be drawn
        self._warped = 0.0  # time of the last warp

    def draw(self, exact: Draw, camera: Camera, look: object) -> Frame:
        """Draw an exact frame, and keep it. `look`: all on which the picture depends, except the camera."""
        start = time.perf_counter()
        frame = exact(camera)
        made = _Exact(frame, camera, look, time.perf_counter() - start)
        if not self._kept and made.seconds >= _FAST:  # so that the first motion does not wait for builds
            self._start(made.prepare, look)
        self._keep(made)
        return frame

    def draw_moving(self, exact: Draw, camera: Camera, look: object) -> Frame:
        """Warp a kept picture of the same look, as a `WarpedFrame`; draw an exact frame if none shows enough."""
        if self._drawing is not None:
            self._drawing.join(max(self._warped + _PACE - time.monotonic(), 0.0))
        self._warped = time.monotonic()
        known = [(one.shift(camera), number, one) for number, one in enumerate(self._kept) if one.look == look]
        shift, _, last = min(known, default=(math.inf, 0, None))
        if last is None or shift > _FAR or last.seconds < _FAST:
            return self.draw(exact, camera, look)
        if shift > _NEAR or last.camera.width < camera.width:
            self._begin(exact, camera, look)
        frame = warp(last.thing, camera)
        empty = ~(frame.depth < 0.5 * last.beyond)
        frame.depth[empty], frame.valid[empty] = np.nan, False
        return WarpedFrame(frame.color, frame.depth, frame.valid, camera)

    def _begin(self, exact: Draw, camera: Camera, look: object) -> None:
        """Begin to draw an exact picture on another thread."""

        def draw() -> None:
            start = time.perf_counter()
            made = _Exact(exact(_wider(camera)), camera, look, time.perf_counter() - start)
            warp(made.thing, camera.resized((1, 1)))  # prepares the surface
            self._keep(made)

        if look != self._failed:
            self._start(draw, look)

    def _start(self, work: Callable[[], None], look: object) -> None:
        """Start work for a look on another thread, unless some is being done."""
        if self._drawing is not None and self._drawing.is_alive():
            return

        def guarded() -> None:
            try:
                work()
            except Exception:  # the page tells of it when the camera rests
                self._failed = look

        self._failed = None
        self._drawing = threading.Thread(target=contextvars.copy_context().run, args=(guarded,))
        self._drawing.start()

    def _keep(self, made: _Exact) -> None:
        with self._lock:
            same = [one for one in self._kept if one.look == made.look][: _KEPT - 1]
            others = [one for one in self._kept if one.look != made.look][: _KEPT * (_LOOKS - 1)]
            self._kept = [made, *same, *others]


def _wider(camera: Camera) -> Camera:
    """A pinhole camera with a border around its picture."""
    border = [round(_BORDER * side) for side in camera.size]
    K = camera.K.copy()
    K[:2, 2] += border
    size = camera.width + 2 * border[0], camera.height + 2 * border[1]
    return Camera(K, size, camera.world_from_camera, projection=camera.projection)


def _with_faint(frame: Frame, beyond: float) -> NDArray[np.float32]:
    """A frame's depth; faint pixels beside surface get its depth, and all others without depth that of `beyond`."""
    padded = np.pad(np.where(frame.valid, frame.depth, np.float32(beyond)), 1, constant_values=beyond)
    depth, pitch = padded.reshape(-1), frame.camera.width + 2
    if frame.alpha is not None:
        rows, columns = np.nonzero(~frame.valid & (frame.alpha > 0))
        places = (rows + 1) * pitch + columns + 1
        for _ in range(_REACH):
            beside = np.stack([depth[places + step] for step in (-1, 1, -pitch, pitch)]).min(axis=0)
            depth[places] = beside
            places = places[beside == np.float32(beyond)]
    return padded[1:-1, 1:-1]
