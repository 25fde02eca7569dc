"""Frusta drawn on a page, and the handles that move, turn and resize the chosen frustum."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from pyibr.app.live.page_space import PageSpace
from pyibr.app.place.model import Placement, State
from pyibr.app.view.overlays import view_color
from pyibr.capture.frusta import Frustum
from pyibr.core.checks import Float64
from pyibr.core.errors import ArgumentError
from pyibr.core.rotations import rotation_from_quaternion

if TYPE_CHECKING:
    from viser import CameraFrustumHandle, SceneApi, TransformControlsHandle

_ENDLESS = 1.5  # units of the page: drawn depth of a frustum without a far plane
_HANDLE = 0.5  # size of the gizmo that moves and turns
_CORNER = 0.3  # size of the gizmo that resizes
_CHOSEN = (255, 255, 255)


class Gizmos:
    """The frusta of a placement in the server's scene, which all pages share.

    `nearest` returns the depth at which the surface begins in a frustum, if it is known; `choose` chooses a frustum by
    its number.
    """

    def __init__(
        self,
        scene: SceneApi,
        placement: Placement,
        page_space: PageSpace,
        nearest: Callable[[Frustum], float | None],
        choose: Callable[[int], None],
    ) -> None:
        self._scene, self._placement, self._page_space = scene, placement, page_space
        self._nearest, self._choose = nearest, choose
        self._drawn: list[tuple[object, CameraFrustumHandle]] = []
        self._gesture: object = None
        self._held: TransformControlsHandle | None = None
        self._visible = True
        self.handle = scene.add_transform_controls("/move", _HANDLE, depth_test=False, visible=False)
        self.corner = scene.add_transform_controls(
            "/resize", _CORNER, disable_rotations=True, disable_sliders=True, depth_test=False, visible=False
        )

        async def moved(event: Any) -> None:  # on the server's own thread, so that positions arrive in order
            self._drag(event, self._moved)

        async def resized(event: Any) -> None:
            self._drag(event, self._resized)

        self.handle.on_update(moved)
        self.corner.on_update(resized)

    def show(self, visible: bool) -> None:
        """Show or hide all frusta; they are hidden while the picture consists of panes with cameras of their own."""
        self._visible = visible
        self.follow()

    def follow(self) -> None:
        """Draw the current placement; locked, as viser refuses handles that another thread has replaced."""
        with self._placement.lock:
            self._follow(self._placement.state)

    def _follow(self, state: State) -> None:
        for number, frustum in enumerate(state.frusta):
            self._draw(number, frustum, number == state.chosen)
        for _, handle in self._drawn[len(state.frusta) :]:
            handle.remove()
        del self._drawn[len(state.frusta) :]
        shown = self._visible and state.current is not None
        self.handle.visible = self.corner.visible = shown
        if state.current is None:
            return
        wxyz, position = self._page_space.pose(state.current.camera)
        corner = self._page_space.point(_corner_of(state.current, self._depth(state.current)))
        for handle, at in ((self.handle, position), (self.corner, corner)):
            if handle is not self._held:  # a handle that is dragged is already in place
                handle.wxyz, handle.position = tuple(wxyz), tuple(at)

    def _draw(self, number: int, frustum: Frustum, chosen: bool) -> None:
        """Draw the chosen frustum at full depth, others up to the plane where their surface begins."""
        known = self._drawn[number] if number < len(self._drawn) else None
        reach = self._depth(frustum) if chosen else self._nearest(frustum) or self._depth(frustum)
        key = frustum, chosen, reach
        if known is not None and known[0] == key:
            known[1].visible = self._visible
            return
        across, down = (math.tan(math.radians(angle) / 2) for angle in frustum.fov)
        wxyz, position = self._page_space.pose(frustum.camera)
        depth = reach / self._page_space.unit
        made = self._scene.add_camera_frustum(
            f"/frusta/{number}",
            2 * math.atan(down),
            across / down,
            scale=depth * (across * down / 3) ** (1 / 3),  # viser scales a frustum by its volume
            thickness=3.0 if chosen else 1.5,
            thickness_units="screen",
            color=_CHOSEN if chosen else view_color(number),
            wxyz=tuple(wxyz),
            position=tuple(position),
            cast_shadow=False,
            receive_shadow=False,
            variant="filled" if chosen else "wireframe",
            visible=self._visible,
        )
        made.on_click(lambda _: self._choose(number))
        entry = key, made
        if known is None:
            self._drawn.append(entry)
        else:
            self._drawn[number] = entry

    def _depth(self, frustum: Frustum) -> float:
        return frustum.far if math.isfinite(frustum.far) else _ENDLESS * self._page_space.unit

    def _drag(self, event: Any, act: Callable[[TransformControlsHandle], None]) -> None:
        if event.phase == "start":
            self._gesture, self._held = object(), event.target
        act(event.target)
        if event.phase == "end":
            self._gesture = self._held = None
            self.follow()

    def _moved(self, target: TransformControlsHandle) -> None:
        pose = np.eye(4)
        pose[:3, :3] = rotation_from_quaternion(np.asarray(target.wxyz, np.float64))
        pose[:3, 3] = np.asarray(target.position) * self._page_space.unit + self._page_space.middle
        self._placement.move(pose, self._gesture)

    def _resized(self, target: TransformControlsHandle) -> None:
        frustum = self._placement.state.current
        if frustum is None:
            return
        point = np.asarray(target.position) * self._page_space.unit + self._page_space.middle
        x, y, z = frustum.camera.camera_from_world[:3, :3] @ point + frustum.camera.camera_from_world[:3, 3]
        try:
            across, down = (2 * math.degrees(math.atan(abs(one) / z)) for one in (x, y))
            self._placement.open(max(across, 1.0), max(down, 1.0), float(z), self._gesture)
        except (ArgumentError, ZeroDivisionError):  # the handle was pulled behind the frustum's eye
            return


def _corner_of(frustum: Frustum, depth: float) -> Float64:
    """The lower right corner of a frustum at a depth, in the world."""
    across, down = (math.tan(math.radians(angle) / 2) for angle in frustum.fov)
    local = depth * np.array([across, down, 1.0])
    pose = frustum.camera.world_from_camera
    made: Float64 = pose[:3, :3] @ local + pose[:3, 3]
    return made
