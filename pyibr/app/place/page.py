"""The page for placing frusta: gizmos, controls, pictures, and a brush for the picture in the page's corner."""

from __future__ import annotations

import json
import math
import threading
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast, get_args

import numpy as np

from pyibr.app.live.page_space import PageSpace
from pyibr.app.live.pages import Pages
from pyibr.app.live.panel import Panel, told, uploaded
from pyibr.app.live.stream import Picture, SentPicture, Stream
from pyibr.app.place.brush import SHEET, Brush
from pyibr.app.place.captures import Captures
from pyibr.app.place.gizmos import Gizmos
from pyibr.app.place.inset import Kind, draw_inset, own_picture
from pyibr.app.place.model import Placement
from pyibr.app.view.methods import Layout, RenderMethod, Style
from pyibr.app.view.painting import paint
from pyibr.capture.frusta import Frustum, frusta_of
from pyibr.capture.proposal import propose_frusta
from pyibr.capture.sets import parse_set
from pyibr.core.camera import Camera
from pyibr.core.errors import ArgumentError, Error
from pyibr.core.files import checked_path
from pyibr.images import Frame
from pyibr.images.depth_image import Side
from pyibr.opencl.program import telling_builds
from pyibr.picture.drawable import as_drawable
from pyibr.picture.render import render
from pyibr.picture.unseen import MarkedUnseen
from pyibr.warp.view import WarpedView

if TYPE_CHECKING:
    from viser import ClientHandle

_SHOWN: dict[str, tuple[str, str | None, Layout]] = {
    "mesh": ("mesh", None, "one"),
    "set": ("set", None, "one"),
    "mesh | set": ("mesh", "set", "swipe"),
    "mesh, set, difference": ("plain", "set", "side by side"),
    "difference": ("plain", "set", "difference"),
}
"""Methods and layout by the text of the page's control."""

_NEW = 40.0  # opening angle of a new frustum in degrees
_BEFORE = 0.6  # distance of a new frustum from the surface, as a fraction of the camera's
_NONE = "none"


class PlacePage:
    """The shared part of all browsers that place frusta on one mesh; `folder` is the initial folder for saving sets."""

    def __init__(
        self, pages: Pages, placement: Placement, captures: Captures, page_space: PageSpace, folder: Path
    ) -> None:
        self.pages, self.placement, self.captures, self.page_space = pages, placement, captures, page_space
        self._proposing = threading.Event()
        self._measured: tuple[object, float] | None = None
        self.browsers: set[BrowserPage] = set()
        self._quiet = False
        mesh = captures.surface.mesh
        self._methods: Mapping[str, RenderMethod] = {
            "mesh": RenderMethod(lambda: [mesh], self._draw_marked),
            "plain": RenderMethod(lambda: [mesh], lambda things, camera, _: render(things[0], camera, captures.light)),
            "set": RenderMethod(lambda: [mesh], self._draw_set),
        }
        self.panel = Panel(pages.server.gui)
        with self.panel.controls:
            self._add_frusta_controls()
            self._add_cover_controls()
            self._add_corner_controls()
            self._add_picture_controls()
            self._add_file_controls(folder)
        self.gizmos = Gizmos(pages.server.scene, placement, page_space, captures.nearest, self._choose)
        placement.listeners.append(self._changed)
        self._changed()

    # ---- pictures

    def picture(self, camera: Camera, full: tuple[int, int]) -> Picture:
        """Draw the picture of a page with a canvas of `full` pixels, from a camera."""
        state = self.placement.state
        method, other, layout = _SHOWN[self._shown.value]
        style = Style(method, other, layout, self._swipe.value, self._gain.value)
        with telling_builds(self.panel.say):
            picture = paint(self._methods, camera, style)
        color = picture.color if picture.color.flags.writeable else picture.color.copy()
        if state.current is not None and self._corner.value != _NONE:
            view = self.captures.view(state.current)
            own = own_picture(view, cast("Kind", self._corner.value), state.current.mask)
            draw_inset(color, own, full)
            if picture.depth is not None:
                before = np.zeros((*picture.depth.shape, 1), np.uint8)
                draw_inset(before, np.full((1, 1, 1), 255, np.uint8), full)
                picture.depth[before[..., 0] > 0] = SHEET * self.page_space.unit  # so that nothing occludes the corner
        return replace(picture, color=color)

    def tell(self, shown: SentPicture) -> None:
        """Show the picture's data and the unseen fraction of the surface."""
        if not shown.full:
            return
        state, picture = self.placement.state, shown.picture
        key = state.frusta, state.side
        if self._measured is None or self._measured[0] != key:
            self._measured = key, self.captures.unseen(state.frusta, state.side)
            self.gizmos.follow()  # the depths at which the surface begins are known now
        lines = [
            f"**{len(state.frusta)} frusta**, {self._measured[1]:.1%} of the surface unseen",
            f"{picture.camera.width}x{picture.camera.height}, {1e3 * shown.seconds:.0f} ms",
        ]
        self.panel.say("  \n".join([*lines, picture.note] if picture.note else lines))

    def tell_error(self, error: Exception) -> None:
        """Show an error."""
        self.panel.say(f"**Not done:** {told(error)}")

    def _draw_marked(self, things: Any, camera: Camera, style: Style) -> Frame:
        state = self.placement.state
        views, part = self.captures.views(state.frusta), self.captures.surface.within
        marked = MarkedUnseen(as_drawable(things[0]), views, state.side, within=part)
        return render(marked, camera, self.captures.light)

    def _draw_set(self, things: Any, camera: Camera, style: Style) -> Frame:
        views = [view for view in self.captures.views(self.placement.state.frusta) if view.valid.any()]
        if views:
            side = self.placement.state.side
            return render([WarpedView(view, side=side) for view in views], camera)
        height, width = camera.height, camera.width
        nothing = np.full((height, width), np.nan, np.float32)
        return Frame(np.zeros((height, width, 3), np.uint8), nothing, np.zeros((height, width), np.bool_), camera)

    def _changed(self) -> None:
        state = self.placement.state
        self._quiet = True  # controls are set to the current state; this must not trigger their actions
        names = tuple(str(number + 1) for number in range(len(state.frusta))) or (_NONE,)
        self._chosen.options = names
        self._chosen.value = _NONE if state.chosen is None else str(state.chosen + 1)
        if state.current is not None:
            self._across.value, self._down.value = (round(angle, 2) for angle in state.current.fov)
            self._far.value = state.current.far if math.isfinite(state.current.far) else 0.0
        self._side.value = state.side
        past, future = self.placement.steps
        self._undo.disabled, self._redo.disabled = not past, not future
        self._quiet = False
        self.gizmos.follow()
        self._redraw()

    def _redraw(self) -> None:
        for browser in list(self.browsers):
            browser.refresh()

    # ---- controls

    def _add_frusta_controls(self) -> None:
        gui = self.pages.server.gui
        step = float(10.0 ** np.floor(np.log10(self.page_space.unit) - 1))
        with gui.add_folder("Frusta", order=1):
            self._chosen: Any = gui.add_dropdown("Chosen", (_NONE,))
            add = gui.add_button("Add a frustum here")
            self._across = gui.add_number("Degrees across", 40.0, min=1.0, max=150.0, step=1.0)
            self._down = gui.add_number("Degrees down", 40.0, min=1.0, max=150.0, step=1.0)
            self._far = gui.add_number("Far plane (0: none)", 0.0, min=0.0, step=step)
            delete = gui.add_button("Delete")
            self._undo, self._redo = gui.add_button("Undo"), gui.add_button("Redo")

        self._when_turned(self._chosen, lambda: self._choose(int(self._chosen.value) - 1))
        across, down, far = self._across, self._down, self._far
        for handle in (across, down, far):
            self._when_turned(handle, lambda: self.placement.open(across.value, down.value, far.value or math.inf))
        add.on_click(lambda event: self.add_at(event.client))
        delete.on_click(lambda _: self.placement.delete())
        self._undo.on_click(lambda _: self.placement.undo())
        self._redo.on_click(lambda _: self.placement.redo())

    def _when_turned(self, handle: Any, act: Callable[[], object]) -> None:
        """Act when a user changes a control, but not while another thread sets it to the current state."""

        def turned(_: Any) -> None:
            with self.placement.lock:
                if not self._quiet:
                    self.panel.attempt(act)

        handle.on_update(turned)

    def _choose(self, number: int) -> None:
        self.panel.attempt(lambda: self.placement.choose(number))  # the frustum may have been deleted since the click

    def add_at(self, client: ClientHandle | None) -> None:
        """Add a frustum in front of the surface in the middle of a browser's page."""
        cameras = [one.stream.camera for one in self.browsers if client is not None and one.stream.client == client]
        if cameras and cameras[0] is not None:
            camera = cameras[0]
            self.panel.attempt(
                lambda: self.placement.add(self.pages.call(lambda: self._before(camera), self.panel.say))
            )

    def _before(self, camera: Camera) -> Frustum:
        frame = render(self.captures.surface.mesh, camera.resized((65, 49)))
        low, high = self.captures.surface.bounds
        around = float(np.linalg.norm(high - low))
        middle = frame.depth[16:33, 24:41]
        seen = middle[np.isfinite(middle)]
        depth = (
            float(np.median(seen)) if len(seen) else max(float(np.linalg.norm(camera.center - (low + high) / 2)), 1e-9)
        )
        back = min(_BEFORE * depth, around)
        eye = camera.center + (depth - back) * camera.forward
        up = -camera.world_from_camera[:3, 1]
        size = self.placement.size
        return Frustum.look_at(eye, eye + camera.forward, up, size, fov=_NEW, far=back + 0.25 * around)

    def _add_cover_controls(self) -> None:
        gui = self.pages.server.gui
        with gui.add_folder("Cover", order=2):
            self._count = gui.add_number("Frusta to propose", 4, min=1, max=64, step=1)
            propose = gui.add_button("Propose")
            self._side: Any = gui.add_dropdown("Side", get_args(Side))

        propose.on_click(lambda _: self.panel.attempt(self.propose))
        self._when_turned(self._side, lambda: self.placement.look_from(cast("Side", self._side.value)))

    def propose(self) -> None:
        """Add frusta that see most of the unseen surface; do nothing while a proposal is running."""
        if self._proposing.is_set():
            return
        self._proposing.set()
        try:
            state = self.placement.state
            made = self.pages.call(
                lambda: propose_frusta(
                    self.captures.surface.mesh,
                    int(self._count.value),
                    self.placement.size,
                    known=state.frusta,
                    side=state.side,
                    surface=self.captures.surface,
                    progress=self._tell_progress,
                ),
                self.panel.say,
            )
            self.placement.add(*made)
        finally:
            self._proposing.clear()

    def _tell_progress(self, done: int, of: int, unseen: float) -> None:
        self.panel.say(f"**Proposing** {done} of {of}: {unseen:.1%} of the surface would be unseen")
        if self.pages.closed:
            raise Error("the page is closed")

    def _add_corner_controls(self) -> None:
        gui = self.pages.server.gui
        with gui.add_folder("Picture of the chosen frustum", order=3, expand_by_default=False):
            self._corner: Any = gui.add_dropdown("In the corner", (*get_args(Kind), _NONE))
            self._brush = gui.add_checkbox("Brush", True, hint="Drag over the corner to mark parts as empty")
            self._radius = gui.add_slider("Radius", 0.01, 0.3, 0.01, 0.06)
            self._erases = gui.add_checkbox("Erase", False)
            clean = gui.add_button("Clear paint")

        for handle in (self._corner, self._brush):
            self._when_turned(handle, self._redraw)
        clean.on_click(lambda _: self.placement.clean())

    def paint_at(self, at: tuple[float, float], gesture: object) -> None:
        """Paint at the brush's position, in fractions of the width and height of the picture in the page's corner."""
        self.placement.paint(at, self._radius.value, self._erases.value, gesture)

    @property
    def paints(self) -> bool:
        """True while a drag over the corner paints."""
        return self._brush.value and self._corner.value != _NONE and self.placement.state.current is not None

    def _add_picture_controls(self) -> None:
        gui = self.pages.server.gui
        with gui.add_folder("Picture", order=4):
            self._shown: Any = gui.add_dropdown("Show", tuple(_SHOWN))
            self._swipe: Any = gui.add_slider("Line", 0.0, 1.0, 0.01, 0.5, visible=False)
            self._gain: Any = gui.add_slider("Difference times", 1.0, 32.0, 1.0, 4.0, visible=False)
            self.panel.add_dark()

        @self._shown.on_update
        @self._swipe.on_update
        @self._gain.on_update
        def _(_: Any) -> None:
            layout = _SHOWN[self._shown.value][2]
            self._swipe.visible, self._gain.visible = layout == "swipe", layout not in ("one", "swipe")
            self.gizmos.show(layout != "side by side")
            self._redraw()

    def _add_file_controls(self, folder: Path) -> None:
        gui = self.pages.server.gui
        with gui.add_folder("Files", order=5, expand_by_default=False):
            self._folder = gui.add_text("Folder", str(_whole(folder)))
            save, load = gui.add_button("Save the set"), gui.add_button("Open the set")
            send = gui.add_button("Download the frusta")
            take = gui.add_upload_button("Upload frusta", mime_type="application/json")
        save.on_click(lambda _: self.panel.attempt(self.save))
        load.on_click(lambda _: self.panel.attempt(lambda: self.placement.load(self._named_folder())))
        send.on_click(lambda event: self._send(event.client))
        take.on_upload(lambda _: self.panel.attempt(lambda: self._take(take.value)))

    def save(self) -> None:
        """Write the set into the folder that the page names."""
        folder, state = self._named_folder(), self.placement.state
        self.placement.save(folder, self.pages.call(lambda: self.captures.views(state.frusta), self.panel.say))
        self.panel.answer(f"**Saved** {len(state.frusta)} frusta to {folder}")

    def _named_folder(self) -> Path:
        """The folder that the page names; the page then shows its absolute path."""
        folder = _whole(self._folder.value)
        self._folder.value = str(folder)
        return folder

    def _send(self, client: ClientHandle | None) -> None:
        if client is not None:
            data = self.placement.about | {"views": [one.to_json() for one in self.placement.state.frusta]}
            client.send_file_download(
                "frusta.json", (json.dumps(data, indent=1) + "\n").encode(), save_immediately=True
            )

    def _take(self, file: Any) -> None:
        entries, about = parse_set(uploaded(file), Path(file.name))
        self.placement.take(frusta_of(entries, file.name), about)


class BrowserPage:
    """One browser's view of the page: its camera's picture, and its brush."""

    def __init__(self, shared: PlacePage, client: ClientHandle) -> None:
        self._shared = shared
        self.stream = Stream(
            client, shared.pages.renderer, shared.page_space, self._paint, shared.tell, shared.tell_error
        )
        self._brush = Brush(client, self.stream, lambda: shared.paints, shared.paint_at)
        self.stream.with_depth = True
        self.stream.moved = self._brush.move
        shared.browsers.add(self)
        self.stream.follow()

    def refresh(self) -> None:
        """Draw the page again after a change."""
        self._brush.show()
        self.stream.refresh()

    def leave(self) -> None:
        """Stop drawing, because the page is closed."""
        self._shared.browsers.discard(self)
        self.stream.leave()

    def _paint(self, camera: Camera, rests: bool) -> Picture:
        full = self.stream.camera or camera
        return self._shared.picture(camera, full.size)


def _whole(folder: str | Path) -> Path:
    """The absolute path of a folder, with ~ as the user's home."""
    try:
        return checked_path(folder).expanduser().absolute()
    except RuntimeError:  # unknown user after ~
        raise ArgumentError("folder", "a folder, with ~ for your home", repr(str(folder))) from None
