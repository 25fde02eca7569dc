"""Frusta are placed in a real Chromium by buttons, gizmos and the brush; texts, pictures and files are right."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import pytest

import pyibr as ibr
from pyibr.app.place.inset import inset_box
from pyibr.capture import models
from pyibr.capture.coverage import Mask, Surface, surface_of, unseen_share
from pyibr.capture.frusta import Frustum, load_frusta
from pyibr.images.metrics import psnr
from pyibr.picture.drawable import as_drawable
from pyibr.picture.light import light_for
from pyibr.picture.unseen import MarkedUnseen
from tests.app.browser import LOOPBACK, Tab, listeners, opened, rested, settles_on, stays, until

pytestmark = pytest.mark.thorough

SIZE = 64
PICTURE = -2  # index of the colours among a page's pictures; the last picture is the depth


@dataclass
class Work:
    """A server with a page that is open in a browser."""

    pages: Any
    tab: Tab
    shared: Any
    page: Any

    @property
    def state(self) -> Any:
        return self.shared.placement.state

    def click(self, name: str) -> None:
        self.tab.page.get_by_role("button", name=name, exact=True).click()

    def on_page(self, point: np.ndarray) -> tuple[float, float]:
        """Position of a point in the world on the browser's page."""
        (pixel,), _ = self.page.stream.camera.project([point])
        return float(pixel[0] + 0.5), float(pixel[1] + 0.5)


@pytest.fixture(scope="module")
def mesh() -> ibr.Mesh:
    return models.donut(48)


@cache
def surface() -> Surface:
    return surface_of(models.donut(48))


@pytest.fixture(scope="module")
def work(browser, mesh, tmp_path_factory):
    folder = tmp_path_factory.mktemp("placed") / "set"
    before = listeners()
    with ibr.place(mesh, size=SIZE, folder=folder, up=(0, 0, 1), port=0) as pages:
        with opened(browser, pages.url, (400, 300)) as tab:
            until(lambda: len(pages.open) == 1)
            (page,) = pages.open.values()
            assert listeners() - before <= LOOPBACK
            yield Work(pages, tab, page._shared, page)
            assert tab.complaints == []
        until(lambda: not pages.open)
        assert pages.renderer.clients == []
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("pyibr-")]


def corner_of(work: Work, border: int = 3) -> np.ndarray:
    """(H, W) mask of the page's pixels that the picture in the corner covers; without frusta there is none."""
    size = work.page.stream.camera.size
    left, top, side = inset_box(size)
    made = np.zeros(size[::-1], bool)
    made[max(top - border, 0) : top + side + border, max(left - border, 0) : left + side + border] = True
    return made & bool(work.state.frusta)


@cache
def captured(frustum: Frustum, mesh: ibr.Mesh) -> tuple[ibr.DepthImage, Mask]:
    """A frustum's image of the mesh, and the mask of the surface points that it sees."""
    view = frustum.capture(mesh, light_for(mesh, (0, 0, 1)))
    return view, surface().seen(view)


def marked(work: Work, mesh: ibr.Mesh) -> np.ndarray:
    """The picture that the page should show: the mesh with its unseen parts marked."""
    views = [captured(one, mesh)[0] for one in work.state.frusta]
    light = light_for(mesh, (0, 0, 1))
    return ibr.render(MarkedUnseen(as_drawable(mesh), views), work.page.stream.camera, light).color


def assert_shown(work: Work, mesh: ibr.Mesh) -> None:
    """Assert that the page shows the right picture outside the corner, and the right unseen share in its text."""
    settles_on(work.tab, lambda: marked(work, mesh), PICTURE, corner_of(work))
    share = unseen_share(surface(), [captured(one, mesh)[1] for one in work.state.frusta])
    until(lambda: f"**{len(work.state.frusta)} frusta**, {share:.1%} of the surface unseen" in work.shared.panel.text)


def test_a_frustum_is_added_moved_resized_painted_undone_saved_and_opened(work, mesh):
    tab, placement = work.tab, work.shared.placement
    assert_shown(work, mesh)  # all parts are unseen
    work.click("Add a frustum here")
    until(lambda: len(work.state.frusta) == 1)
    assert_shown(work, mesh)
    added = work.state.current
    assert added.capture(mesh).valid.sum() > 500  # the frustum sees the donut

    # The gizmo is at the frustum's eye; dragging its axis handles moves the frustum.
    start = work.on_page(added.camera.center)
    axis = added.camera.world_from_camera[:3, 0]
    unit = work.shared.page_space.unit
    grip = work.on_page(added.camera.center + 0.3 * unit * axis)
    goal = work.on_page(added.camera.center + 0.8 * unit * axis)
    assert stays(lambda: tab.canvas().tobytes())  # the browser has drawn the gizmo
    tab.drag(tuple(map(round, grip)), tuple(map(round, goal)), 8, 0.03)
    until(lambda: work.state.current.camera != added.camera)
    assert stays(lambda: work.state)
    rested(tab)
    moved = work.state.current
    way = moved.camera.center - added.camera.center
    assert np.linalg.norm(way) > 0.2 * unit
    assert abs(way @ axis) > 0.99 * np.linalg.norm(way)  # only along this axis
    before, after = (one.camera.world_from_camera[:3, :3] for one in (added, moved))
    np.testing.assert_allclose(after, before, atol=1e-5)
    assert np.linalg.norm(np.subtract(start, work.on_page(moved.camera.center))) > 10
    assert_shown(work, mesh)
    placement.undo()
    assert work.state.current == added  # one step of undo takes back the whole drag
    placement.redo()
    assert work.state.current == moved

    # Numbers in the panel resize the frustum.
    work.shared._across.value = 55.0
    until(lambda: abs(work.state.current.fov[0] - 55) < 1e-6)

    # A drag over the corner paints background along its way, and undo removes it.
    rested(tab)
    sized = work.state.current
    left, top, side = inset_box(work.page.stream.camera.size)
    tab.drag((left + side // 4, top + side // 2), (left + 3 * side // 4, top + side // 2), 10, 0.06)
    until(lambda: work.state.current.strokes)
    assert stays(lambda: work.state)
    (stroke,) = work.state.current.strokes
    xs, ys = np.array(stroke.points).T
    assert xs.min() < 0.4 and xs.max() > 0.6
    np.testing.assert_allclose(ys, 0.5, atol=0.05)
    painted = work.state.current.capture(mesh)
    assert not painted.valid[SIZE // 2, SIZE // 2]
    middle = top + side // 2, left + side // 2
    assert_shown(work, mesh)
    assert (tab.picture(PICTURE)[middle] == (200, 0, 200)).all()
    with_paint = work.state
    placement.undo()
    assert work.state.current == sized
    placement.redo()

    # The set is saved and opened again; the warp then draws the seen surface, except the painted parts.
    tab.page.get_by_text("Files").click()
    work.click("Save the set")
    folder = work.shared._folder.value
    until(lambda: "**Saved** 1 frusta" in work.shared.panel.text)
    assert load_frusta(folder)[0] == list(with_paint.frusta)
    (view,) = ibr.load(folder)
    np.testing.assert_array_equal(view.depth, painted.depth)
    frame = ibr.warp(view, view.camera)
    assert (frame.valid[painted.valid]).mean() > 0.9 and not frame.valid[SIZE // 2, SIZE // 2]
    work.click("Delete")
    until(lambda: not work.state.frusta)
    work.click("Open the set")
    until(lambda: work.state.frusta == with_paint.frusta)
    assert_shown(work, mesh)


def test_frusta_are_proposed_and_the_set_is_compared_with_the_mesh(work, mesh):
    work.shared._count.value = 4
    work.click("Propose")
    until(lambda: len(work.state.frusta) >= 4, 60)
    assert_shown(work, mesh)
    assert unseen_share(surface(), [captured(one, mesh)[1] for one in work.state.frusta]) < 0.1
    work.shared._shown.value = "set"
    light = light_for(mesh, (0, 0, 1))
    views = [captured(one, mesh)[0] for one in work.state.frusta]
    settles_on(work.tab, lambda: ibr.render(views, work.page.stream.camera).color, PICTURE, corner_of(work))
    truth, plain = (ibr.render(thing, work.page.stream.camera, light) for thing in (views, mesh))
    both = truth.valid & plain.valid
    assert both.sum() > 0.9 * plain.valid.sum()  # parts that the images cover look like the mesh
    assert psnr(truth.color, plain.color, valid=both) > 25
    work.shared._shown.value = "difference"
    until(lambda: "dB in common pixels" in work.shared.panel.text)
    work.shared._shown.value = "mesh"


def test_two_pages_work_on_one_set(work, mesh, browser):
    count = len(work.state.frusta)
    with opened(browser, work.pages.url, (300, 300)) as other:
        until(lambda: len(work.pages.open) == 2)
        other.page.get_by_role("button", name="Undo", exact=True).click()
        until(lambda: len(work.state.frusta) != count)
        assert_shown(work, mesh)
        rested(other)
        assert other.complaints == []
    until(lambda: len(work.pages.open) == 1)


def test_the_corner_is_not_coloured_while_the_brush_is_over_it(browser, mesh):
    """viser colours the backs of clickable objects under the mouse; the corner's picture is such an object."""
    frustum = Frustum.look_at((0, 0, 3), (0, 0, 0), (0, 1, 0), 64)
    with (
        ibr.place(mesh, [frustum], size=64, up=(0, 0, 1), port=0) as pages,
        opened(browser, pages.url, (400, 300)) as tab,
    ):
        rested(tab)
        left, top, side = inset_box((400, 300))
        inside = np.s_[top + 4 : top + side - 4, left + 4 : left + side - 4]
        for step in range(4):
            tab.page.mouse.move(left + side // 2 + step, top + side // 2)
            time.sleep(0.5)  # time in which the browser would find the object and colour it
        # A slow browser may show an old picture for a while, but a colour would stay.
        until(lambda: time.sleep(0.5) or psnr(tab.picture(PICTURE)[inside], tab.canvas()[inside]) >= 35)
        assert tab.picture(PICTURE)[inside].std() > 20
