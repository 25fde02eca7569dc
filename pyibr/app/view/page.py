"""The page for looking around: its controls and its pictures."""

from __future__ import annotations

import json
import math
import threading
import time
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from pyibr.app.live.page_space import fov_of
from pyibr.app.live.pages import Pages
from pyibr.app.live.panel import Panel, told, uploaded
from pyibr.app.live.resolution import Resolution
from pyibr.app.live.stream import MOVING, Picture, SentPicture, Stream
from pyibr.app.view.controls import LABELS, Controls
from pyibr.app.view.overlays import legend, view_color
from pyibr.app.view.painting import kernel_seconds, paint
from pyibr.app.view.paths import CameraPath
from pyibr.app.view.scene import Scene
from pyibr.core.camera import Camera
from pyibr.core.errors import Error
from pyibr.images import DepthImage
from pyibr.images.srgb import in_bytes
from pyibr.io.image import encoded
from pyibr.opencl.program import telling_builds

if TYPE_CHECKING:
    from viser import CameraFrustumHandle, ClientHandle

_STATUS_SECONDS = 0.3  # seconds between two updates of the frame times while the camera moves
_THUMB = 96  # longer side of a picture in a frustum, in pixels
_FRUSTUM = 0.2  # size of a source's frustum in units of the page
_CLEAR = 1.0  # units of the page: closer frusta would cover much of the picture
_PLAYED = 1 / 30  # seconds between two cameras of a path


class ViewPage:
    """One browser's page; `device` is the name of the device that draws."""

    def __init__(self, client: ClientHandle, pages: Pages, scene: Scene, device: str) -> None:
        self.client, self.scene, self._pages, self._device = client, scene, pages, device
        self._told = 0.0
        self._playing = threading.Event()
        self._stops = threading.Event()
        self.path: list[Camera] = []
        self.panel = Panel(client.gui)
        self.controls = Controls(self.panel, scene, self._changed)
        self._frusta = self._add_frusta()
        with self.panel.controls:
            self._add_camera_controls()
            self._add_path_controls()
        self.stream = Stream(client, pages.renderer, scene.page_space, self._paint, self._tell, self._tell_error)
        self.stream.resolution = Resolution(MOVING, max(one.coarsest for one in scene.methods.values()))
        self._show_frusta()
        self.stream.follow()

    def leave(self) -> None:
        """Stop drawing, because the page is closed."""
        self._stops.set()
        self.stream.leave()

    # ---- pictures

    def _paint(self, camera: Camera, rests: bool) -> Picture:
        self._hide_frusta_at(camera)
        with telling_builds(self.panel.say):
            return paint(self.scene.methods, camera, replace(self.controls.style(), moving=not rests))

    def _changed(self) -> None:
        self._show_frusta()
        self.stream.refresh()

    def _tell(self, shown: SentPicture) -> None:
        now = time.monotonic()
        if not shown.full and now - self._told < _STATUS_SECONDS:
            return
        self._told = now
        picture, style = shown.picture, self.controls.style()
        stages = ", ".join(f"{name} {1e3 * seconds:.1f}" for name, seconds in picture.stages.items())
        moving = "" if shown.full else ", moving"
        lines = [
            f"**{style.method}** {picture.camera.width}x{picture.camera.height}{moving}",
            f"{1e3 * shown.seconds:.1f} ms ({stages})",
            self._device,
        ]
        if picture.note:
            lines.append(picture.note)
        if meanings := legend(style.show, len(self.scene.sources)):
            explained = any(
                self.scene.methods[name].explains for name in (style.method, style.other) if name is not None
            )
            swatches = " ".join(_swatch(color, text) for color, text in meanings)
            lines.append(swatches if explained else f"{style.method} has no {LABELS[style.show]}")
        if shown.full and self.controls.times.value:
            times = kernel_seconds(self.scene.methods, picture.camera, style)
            longest = sorted(times.items(), key=lambda item: -item[1])[:8]
            lines.append("Kernels: " + ", ".join(f"{name} {1e3 * seconds:.2f} ms" for name, seconds in longest))
        self.panel.say("  \n".join(lines))

    def _tell_error(self, error: Exception) -> None:
        self.panel.say(f"{_swatch((220, 60, 60), 'not drawn')}: {told(error)}")

    # ---- sources

    def _add_frusta(self) -> list[CameraFrustumHandle]:
        made: list[CameraFrustumHandle] = []
        for number, source in enumerate(self.scene.sources):
            if source.camera.projection != "perspective":
                continue
            wxyz, position = self.scene.page_space.pose(source.camera)
            frustum = self.client.scene.add_camera_frustum(
                f"/sources/{number}",
                fov_of(source.camera),
                source.camera.width / source.camera.height,
                scale=_FRUSTUM,
                thickness=2.0,
                thickness_units="screen",
                color=view_color(number),
                image=_thumb(source),
                wxyz=tuple(wxyz),
                position=tuple(position),
                cast_shadow=False,
                receive_shadow=False,
            )
            frustum.on_click(lambda _, camera=source.camera: self.go_to(camera))
            made.append(frustum)
        return made

    def _show_frusta(self) -> None:
        style = self.controls.style()
        shown = self.controls.frusta.value and (style.other is None or style.layout != "side by side")
        for frustum in self._frusta:
            frustum.visible = shown
        self.stream.with_depth = shown and bool(self._frusta)

    def _hide_frusta_at(self, camera: Camera) -> None:
        """Hide a source's frustum near the camera, where its picture would occlude much of the view."""
        if not self.stream.with_depth:
            return
        at = self.scene.page_space.point(camera.center)
        for frustum in self._frusta:
            near = float(np.linalg.norm(frustum.position - at)) < _CLEAR
            if frustum.visible == near:
                frustum.visible = not near

    # ---- cameras

    def go_to(self, camera: Camera) -> None:
        """Move the page's view to a camera; pages have square pixels and a central principal point only."""
        page_space, page = self.scene.page_space, self.client.camera
        wxyz, position = page_space.pose(camera)
        ahead = max(float((self.scene.pivot - camera.center) @ camera.forward) / page_space.unit, 0.05)
        with self.client.atomic():
            page.position = tuple(position)
            page.wxyz = tuple(wxyz)
            page.look_at = tuple(position + ahead * camera.forward)
            page.fov = fov_of(camera)

    def _add_camera_controls(self) -> None:
        gui = self.client.gui
        with gui.add_folder("Camera", expand_by_default=False, order=5):
            fov = gui.add_slider("Field of view", 5, 120, 1, round(math.degrees(fov_of(self.scene.start))))
            home = gui.add_button("Back to the start")
            shot = gui.add_button("Screenshot")
            save = gui.add_button("Save camera")
            load = gui.add_upload_button("Load camera", mime_type="application/json")

        @fov.on_update
        def _(_: Any) -> None:
            self.client.camera.fov = math.radians(fov.value)

        home.on_click(lambda _: self.go_to(self.scene.start))
        attempt = self.panel.attempt
        shot.on_click(lambda _: attempt(lambda: self._send("pyibr.png", self.screenshot())))
        save.on_click(lambda _: attempt(lambda: self._send("camera.json", _json(self._camera().to_json()))))
        load.on_upload(lambda _: attempt(lambda: self.go_to(Camera.from_json(uploaded(load.value), load.value.name))))

    def _camera(self) -> Camera:
        if self.stream.camera is None:
            raise Error("the page has not sent its camera yet")
        return self.stream.camera

    def screenshot(self) -> bytes:
        """A PNG file of the picture at full resolution."""
        camera, style = self._camera(), self.controls.style()
        picture = self._pages.call(lambda: paint(self.scene.methods, camera, style), self.panel.say)
        return encoded(picture.color, ".png")

    def _send(self, name: str, content: bytes) -> None:
        self.client.send_file_download(name, content, save_immediately=True)

    # ---- paths

    def _add_path_controls(self) -> None:
        gui = self.client.gui
        with gui.add_folder("Path of cameras", expand_by_default=False, order=6):
            self._count = gui.add_markdown("No cameras yet.")
            add, clear = gui.add_button("Add this camera"), gui.add_button("Clear")
            self._seconds = gui.add_number("Seconds", 5.0, min=0.5, max=600.0, step=0.5)
            play = gui.add_button("Play")
            save = gui.add_button("Save path")
            load = gui.add_upload_button("Load path", mime_type="application/json")

        attempt = self.panel.attempt
        add.on_click(lambda _: attempt(lambda: self._set_path([*self.path, self._camera()])))
        clear.on_click(lambda _: self._set_path([]))
        play.on_click(lambda _: attempt(self.play))
        save.on_click(lambda _: attempt(lambda: self._send("path.json", _json(self._timed_path().to_json()))))
        load.on_upload(lambda _: attempt(lambda: self._load_path(load.value)))

    def _set_path(self, cameras: list[Camera]) -> None:
        self.path = cameras
        count = len(cameras)
        self._count.content = f"{count} camera{'s' * (count != 1)}." if count else "No cameras yet."

    def _timed_path(self) -> CameraPath:
        return CameraPath(self.path, self._seconds.value)

    def _load_path(self, file: Any) -> None:
        path = CameraPath.from_json(uploaded(file), file.name)
        self._seconds.value = path.seconds
        self._set_path(list(path.cameras))

    def play(self) -> None:
        """Move the page's camera along its path; a second call during the move stops it."""
        if self._playing.is_set():
            self._playing.clear()
            return
        path, start = self._timed_path(), time.monotonic()
        self._playing.set()
        while self._playing.is_set() and not self._stops.is_set():
            passed = time.monotonic() - start
            self.go_to(path.at(passed))
            self.client.flush()
            if passed >= path.seconds:
                break
            time.sleep(_PLAYED)
        self._playing.clear()


def _swatch(color: tuple[int, int, int], text: str) -> str:
    red, green, blue = color
    return f'<span style="color: rgb({red},{green},{blue})">&#9632;</span> {text}'


def _json(data: object) -> bytes:
    return (json.dumps(data, indent=1) + "\n").encode("utf-8")


def _thumb(source: DepthImage) -> np.ndarray[Any, Any]:
    from PIL import Image

    image = Image.fromarray(in_bytes(source.shown_color))
    image.thumbnail((_THUMB, _THUMB))
    return np.asarray(image)
