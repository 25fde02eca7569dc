"""The brush of a browser's page: an invisible sheet in front of the camera, over the corner, that receives drags."""

from __future__ import annotations

from collections.abc import Callable
from threading import RLock
from typing import TYPE_CHECKING, Any

import numpy as np

from pyibr.app.live.stream import Stream
from pyibr.app.place.inset import inset_box, inset_position
from pyibr.core.camera import Camera

if TYPE_CHECKING:
    from viser import ClientHandle, MeshHandle

SHEET = 0.02
"""Distance of the sheet from the camera, in units of the page."""


class Brush:
    """The sheet of one browser, which follows its camera.

    `paints` returns whether a drag over the corner paints now. `paint_at` is called with the brush's position, in
    widths and heights of the corner's picture, and its gesture.
    """

    def __init__(
        self,
        client: ClientHandle,
        stream: Stream,
        paints: Callable[[], bool],
        paint_at: Callable[[tuple[float, float], object], None],
    ) -> None:
        self._client, self._stream = client, stream
        self._paints, self._paint_at = paints, paint_at
        self._sheet: MeshHandle | None = None
        self._sheet_for: object = None
        self._gesture: object = None
        self._lock = RLock()  # the camera moves on one thread, paint events come on others

    def move(self, camera: Camera) -> None:
        """Place the sheet in front of a camera."""
        key = camera.size, camera.K[0, 0]
        wxyz, position = self._stream.page_space.pose(camera)
        with self._lock, self._client.atomic():
            if self._sheet is None or self._sheet_for != key:
                self._sheet, self._sheet_for = self._sheet_before(camera), key
            self._sheet.wxyz, self._sheet.position = tuple(wxyz), tuple(position)
            self.show()

    def show(self) -> None:
        """Show the sheet only while a drag would paint."""
        with self._lock:
            if self._sheet is not None:
                self._sheet.visible = self._paints()

    def _sheet_before(self, camera: Camera) -> MeshHandle:
        left, top, side = inset_box(camera.size)
        pixels = np.array([[left, top], [left + side, top], [left + side, top + side], [left, top + side]]) - 0.5
        corners = np.column_stack([camera.ideal_positions(pixels), np.ones(4)]) * SHEET
        faces = np.array([[0, 2, 1], [0, 3, 2]], np.uint32)  # backs point away: viser colours backs of hovered meshes
        sheet = self._client.scene.add_mesh_simple(
            "/brush",
            corners.astype(np.float32),
            faces,
            opacity=0.0,
            side="double",
            cast_shadow=False,
            receive_shadow=False,
        )

        async def dragged(event: Any) -> None:  # on the server's own thread, so that positions arrive in order
            if event.phase == "start":
                self._gesture = object()
            self._touch(event.end_screen_pos, self._gesture)

        async def clicked(event: Any) -> None:
            self._touch(event.screen_pos, object())

        sheet.on_drag(dragged)
        sheet.on_click(clicked)
        return sheet

    def _touch(self, at: tuple[float, float], gesture: object) -> None:
        camera = self._stream.camera
        place = None if camera is None else inset_position(camera.size, at)
        if place is not None and self._paints():
            self._paint_at(place, gesture)
