"""The picture behind a page, which follows the page's camera."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pyibr.app.live.page_space import PageSpace
from pyibr.app.live.renderer import Renderer
from pyibr.app.live.resolution import Resolution
from pyibr.core.camera import Camera

if TYPE_CHECKING:
    from viser import ClientHandle

MOVING = 1 / 30
"""Seconds that a picture may take while the camera moves; its resolution is reduced to reach this."""

_QUALITY = 85  # JPEG quality while the camera moves; resting pictures are PNG, which is lossless
_PIXELS_MAX = 1 << 23  # most pixels of a picture: more than any screen has
_EMPTY = 167.0  # units of the page: depth of empty pixels, the largest that pages can hold


@dataclass(frozen=True)
class Picture:
    """A picture for a page, with its depth and camera."""

    color: NDArray[np.uint8]  # (H, W, 3)
    depth: NDArray[np.float32] | None  # (H, W), planar z, NaN if empty; None: occludes none of the page's own objects
    camera: Camera
    stages: dict[str, float] = field(default_factory=dict[str, float])  # seconds by stage
    note: str = ""  # further text


@dataclass(frozen=True)
class SentPicture:
    """A picture that was sent to a page."""

    picture: Picture
    full: bool  # whether it has full resolution and no loss; else it was drawn for a moving camera
    seconds: float  # time from the start of drawing to the end of sending


class Stream:
    """Draws the view of a client's camera as the background of the page.

    `paint` makes the picture of a camera; its second argument tells whether the camera rests. `shown` is called after
    each picture, `failed` instead if drawing fails. All are called on the renderer's thread.
    """

    def __init__(
        self,
        client: ClientHandle,
        renderer: Renderer[Request, Picture],
        page_space: PageSpace,
        paint: Callable[[Camera, bool], Picture],
        shown: Callable[[SentPicture], None],
        failed: Callable[[Exception], None],
    ) -> None:
        self.client, self.renderer, self.page_space, self.paint = client, renderer, page_space, paint
        self.shown, self.failed = shown, failed
        self.camera: Camera | None = None
        """The page's camera at full resolution; None before it is known."""
        self.with_depth = False
        """Whether resting pictures are sent with depth, so that they occlude the page's own objects behind them."""
        self.moved: Callable[[Camera], None] = lambda _: None
        """Called with the camera when it has moved, on the server's own thread."""
        self.resolution = Resolution(MOVING)
        self._started = 0.0
        self._moving = threading.Lock()  # the last request holds the newest camera, whichever threads call

    def follow(self) -> None:
        """Start drawing whenever the page's camera moves."""

        async def moved(_: Any) -> None:  # on the server's own thread, so that cameras arrive in order
            self._moved()

        self.client.camera.on_update(moved)
        self._moved()  # viser reports a page as open when its first camera has arrived

    def refresh(self) -> None:
        """Draw again after a change other than the camera's."""
        if self.camera is not None:
            self.resolution.reset()
            self.renderer.ask(self.client.client_id, Request(self, self.camera))

    def leave(self) -> None:
        """Stop drawing, because the page is closed."""
        self.renderer.leave(self.client.client_id)

    def _moved(self) -> None:
        with self._moving:
            full = self._full_camera()
            if full is not None and full != self.camera:
                first, self.camera = self.camera is None, full
                self.moved(full)
                self.renderer.ask(self.client.client_id, Request(self, full), at_once=not first)

    def _full_camera(self) -> Camera | None:
        """The page's current camera; None in a window of size 0."""
        camera = self.client.camera
        width, height = camera.image_width, camera.image_height
        if width < 1 or height < 1:
            return None
        full = self.page_space.camera(camera.wxyz, camera.position, camera.fov, (width, height))
        if width * height <= _PIXELS_MAX:
            return full
        shrunk = (_PIXELS_MAX / (width * height)) ** 0.5
        return full.resized((max(int(width * shrunk), 1), max(int(height * shrunk), 1)))

    def draw(self, camera: Camera, full: bool) -> Picture:
        """Draw the picture of a camera; at reduced resolution to keep up, unless `full`."""
        self._started = time.perf_counter()
        return self.paint(camera if full else camera.resized(self.resolution.size(camera.size)), full)

    def deliver(self, full: bool, picture: Picture) -> None:
        """Send the picture that `draw` has just made."""
        start = time.perf_counter()
        depth = None
        if full and self.with_depth and picture.depth is not None:
            depth = np.where(
                np.isnan(picture.depth), np.float32(_EMPTY), picture.depth / np.float32(self.page_space.unit)
            )
        scene, kind = self.client.scene, "png" if full else "jpeg"
        scene.set_background_image(picture.color, kind, jpeg_quality=_QUALITY, depth=depth)
        self.client.flush()
        end = time.perf_counter()
        picture.stages["send"] = end - start
        if not full:
            self.resolution.took(end - self._started)
        self.shown(SentPicture(picture, full, end - self._started))


@dataclass(frozen=True)
class Request:
    """A camera whose picture a stream wants."""

    stream: Stream
    camera: Camera
