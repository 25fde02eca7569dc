"""`ibr.view` in a real Chromium: the picture is right, follows the camera, and is never outdated."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import threading
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

import pyibr as ibr
from pyibr.app.view.painting import paint
from pyibr.capture import models
from pyibr.capture.raycast import MeshScene
from pyibr.images.metrics import psnr
from tests.app.browser import LOOPBACK, Tab, listeners, opened, rested, settles_on, stays, until
from tools.browser import PANEL

pytestmark = pytest.mark.thorough

LEAST = 35.0  # dB of PSNR; the browser shows exact pixels, rounded where it scales


@pytest.fixture(scope="module")
def views() -> list[ibr.DepthImage]:
    """Views of a ring in front of a colourful wall, from two positions."""
    ring = models.donut(48)
    wall = np.float32([[-9, -9, 3.5], [9, -9, 3.5], [-9, 9, 3.5], [9, 9, 3.5]])
    points = np.concatenate([ring.vertices + np.float32([0.2, 0, 1.8]), wall])
    faces = np.concatenate([ring.faces, np.array([[0, 1, 2], [3, 2, 1]]) + len(ring.vertices)])
    colors = (127.5 + 110 * np.sin(np.float32([9, 7, 5]) * points)).astype(np.uint8)
    scene = MeshScene.from_mesh(ibr.Mesh(points, faces, colors=colors))
    camera = ibr.Camera([[220, 0, 119.5], [0, 220, 89.5], [0, 0, 1]], (240, 180))
    return [scene.capture(camera.moved(x, 0, 0)) for x in (0.0, 0.4)]


@dataclass
class Look:
    """A server with a page that is open in a browser."""

    pages: Any
    tab: Tab
    page: Any


@pytest.fixture(scope="module")
def opened_look(browser, views):
    with ibr.view(views, port=0) as pages:
        with opened(browser, pages.url) as tab:
            yield Look(pages, tab, page_of(pages))
            assert tab.complaints == []
        until(lambda: not pages.open)
        assert pages.renderer.clients == []
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("pyibr-")]


@pytest.fixture
def look(opened_look):
    """Reset the page to its first state, but hide the source cameras, which the browser would draw."""
    page, controls = opened_look.page, opened_look.page.controls
    for handle, value in ((controls.frusta, False), (controls._method, "warp")):
        handle.value = value
    for name, value in (("fill", "nothing"), ("blend", "quality")):
        controls._parameters[name][1].value = value
    page.go_to(page.scene.start)
    rested(opened_look.tab)
    return opened_look


def page_of(pages):
    """The only page that is open."""
    until(lambda: len(pages.open) == 1)
    (page,) = pages.open.values()
    return page


def expected(page) -> np.ndarray:
    """The picture that the library draws for the page's camera and controls."""
    return paint(page.scene.methods, page.stream.camera, page.controls.style()).color


def assert_right(tab: Tab, page, views) -> None:
    """Assert that the page's picture equals the one by `warp` for its camera, and that its canvas nearly does."""
    settles_on(tab, lambda: ibr.warp(views, page.stream.camera).color)
    canvas, truth = tab.canvas(), ibr.warp(views, page.stream.camera).color
    assert canvas.shape == truth.shape == (page.stream.camera.height, page.stream.camera.width, 3)
    assert psnr(canvas, truth) >= LEAST
    assert truth.std() > 20  # the picture is not empty


def test_it_opens_follows_a_drag_and_rests_on_the_right_picture(look, views):
    tab, page = look.tab, look.page
    assert page.stream.camera.size == (400, 300)
    assert_right(tab, page, views)
    before, count, start = tab.canvas(), len(tab.kinds()), page.stream.camera
    tab.drag((120, 200), (220, 150), 20, 0.02)
    until(lambda: np.linalg.norm(page.stream.camera.center - start.center) > 0.1)
    assert_right(tab, page, views)
    moved = tab.kinds()[count:]
    assert "image/jpeg" in moved  # pictures were shown during the move
    assert moved[-1] == "image/png" and psnr(before, tab.canvas()) < 25
    kinds = tab.kinds()
    time.sleep(1.0)
    assert tab.kinds() == kinds  # no outdated picture comes after the final one


def test_two_pages_at_once_have_cameras_and_controls_of_their_own(browser, look, views):
    pages, one, first = look.pages, look.tab, look.page
    with opened(browser, pages.url, (300, 200)) as other:
        until(lambda: len(pages.open) == 2)
        (second,) = set(pages.open.values()) - {first}
        second.controls.frusta.value = False
        second.controls._show.value = "depth"
        second.controls._other.value = "forward"
        rested(one)
        still = one.kinds()
        other.drag((100, 120), (170, 90), 10, 0.02)
        rested(other)
        assert one.kinds() == still
        assert_right(one, first, views)
        assert second.stream.camera.size == (300, 200)
        until(lambda: psnr(other.canvas(), expected(second)) >= LEAST)
        assert other.complaints == []
    until(lambda: len(pages.open) == 1)
    one.drag((120, 200), (180, 180), 6, 0.02)
    rested(one)
    assert_right(one, first, views)


def test_a_slow_thing_keeps_one_request_and_shows_its_latest(browser):
    class Slow:
        """A thing that takes 0.25 s to draw at any size; its colour depends on the camera for which it was drawn."""

        bounds = np.zeros(3), np.ones(3)
        drawn = 0

        def draw(self, target, lighting):
            target.clear()
            time.sleep(0.25)
            target.color.fill(int(abs(target.camera.center).sum() * 1e4) % 251)
            target.depth.fill(2.0)
            type(self).drawn += 1

    with ibr.view(Slow(), port=0) as pages, opened(browser, pages.url, (320, 240)) as tab:
        page = page_of(pages)
        rested(tab)
        most = 0
        tab.page.mouse.move(100, 100)
        tab.page.mouse.down()
        for step in range(30):
            tab.page.mouse.move(100 + 3 * step, 100 + step)
            most = max(most, pages.renderer.waiting)
            time.sleep(0.02)
        tab.page.mouse.up()
        assert most <= 1
        assert stays(lambda: page.stream.camera)
        drawn, shown = Slow.drawn, len(tab.kinds())
        rested(tab)
        assert Slow.drawn - drawn <= 3  # the picture in progress, then the latest camera's, reduced and in full
        assert len(tab.kinds()) - shown <= 3
        assert (tab.picture() == int(abs(page.stream.camera.center).sum() * 1e4) % 251).all()
        assert tab.complaints == []


def test_controls_change_the_picture_and_say_what_is_wrong(look, views):
    tab, page = look.tab, look.page
    tab.page.get_by_text("Things").click()
    tab.page.wait_for_timeout(800)  # the list unfolds slowly
    for label, choice in (("Fill", "background"), ("Blend", "nearest")):
        tab.page.get_by_label(label).click()
        tab.page.get_by_role("option", name=choice).click()
    chosen = {("fill", "background"), ("blend", "nearest")}
    until(lambda: chosen <= set(page.controls.style().parameters))
    page.go_to(views[0].camera.moved(-0.3, -0.2, 0))
    settles_on(tab, lambda: ibr.warp(views, page.stream.camera, fill="background", blend="nearest").color)
    assert (~ibr.warp(views, page.stream.camera).valid).mean() > 0.02  # there are holes to fill
    page.controls._method.value = "depth object"
    until(lambda: "slices" in page.controls._parameters)
    rested(tab)
    page.controls._parameters["slices"][1].value = 0
    until(lambda: "slices: expected a whole number" in page.panel.text)
    page.controls._parameters["slices"][1].value = 16
    settles_on(tab, lambda: ibr.render(ibr.DepthObject(views, slices=16), page.stream.camera).color)
    assert "**depth object** 400x300" in page.panel.text


def test_in_a_narrow_window_the_controls_are_closed_below_the_picture_until_they_are_wanted(look):
    tab, page = look.tab, look.page
    tab.page.set_viewport_size({"width": 390, "height": 600})
    until(lambda: page.stream.camera.size == (390, 600))  # no panel is beside the picture
    opens, method = tab.page.get_by_text("Controls", exact=True), tab.page.get_by_label("Method", exact=True)
    opens.wait_for()
    assert 600 - tab.page.get_by_text("pyibr view").bounding_box()["y"] < 130  # folded, as high as three lines
    assert not method.is_visible()
    tab.page.get_by_text("warp 390x600").first.wait_for()  # the first line of the panel's text
    opens.click()
    method.wait_for()
    tab.page.set_viewport_size({"width": 400 + PANEL, "height": 300})
    until(lambda: page.stream.camera.size == (400, 300))
    method.wait_for()


def test_cameras_screenshots_and_paths(look, views, tmp_path):
    tab, page = look.tab, look.page

    def is_at(camera: ibr.Camera) -> bool:
        return np.allclose(page.stream.camera.center, camera.center, atol=1e-5)

    tab.page.get_by_text("Camera", exact=True).click()
    screenshot = tab.page.get_by_role("button", name="Screenshot")
    stays(screenshot.bounding_box)  # a folder opens slowly, and a click may miss a moving button
    with tab.page.expect_download() as download:
        screenshot.click()
    download.value.save_as(tmp_path / "shot.png")
    np.testing.assert_array_equal(ibr.read_color(tmp_path / "shot.png"), ibr.warp(views, page.stream.camera).color)
    with tab.page.expect_download() as download:
        tab.page.get_by_role("button", name="Save camera").click()
    download.value.save_as(tmp_path / "camera.json")
    assert ibr.Camera.load(tmp_path / "camera.json") == page.stream.camera

    # A camera from a file, and an invalid file.
    wanted = page.stream.camera.orbited(20, (0.2, 0, 2.5))
    wanted.save(tmp_path / "wanted.json")
    (tmp_path / "other.json").write_text("{}")
    loads = tab.page.locator("input[type=file]")
    loads.first.set_input_files(tmp_path / "wanted.json")
    until(lambda: is_at(wanted))
    rested(tab)
    np.testing.assert_allclose(page.stream.camera.world_from_camera, wanted.world_from_camera, atol=1e-5)
    loads.first.set_input_files(tmp_path / "other.json")
    until(lambda: "other.json: has no width" in page.panel.text)

    # A path through two cameras ends at the second, and its file holds both.
    tab.page.get_by_text("Path of cameras").click()
    tab.page.get_by_role("button", name="Add this camera").click()
    until(lambda: len(page.path) == 1)
    page.go_to(views[0].camera)
    until(lambda: is_at(views[0].camera))
    tab.page.get_by_role("button", name="Add this camera").click()
    until(lambda: len(page.path) == 2)
    page._seconds.value = 0.6
    page.go_to(wanted)
    until(lambda: is_at(wanted))
    rested(tab)
    count = len(tab.kinds())
    tab.page.get_by_role("button", name="Play").click()
    until(lambda: is_at(views[0].camera))
    rested(tab)
    assert "image/jpeg" in tab.kinds()[count:]
    with tab.page.expect_download() as download:
        tab.page.get_by_role("button", name="Save path").click()
    download.value.save_as(tmp_path / "path.json")
    expected_path = {"seconds": 0.6, "cameras": [camera.to_json() for camera in page.path]}
    assert json.loads((tmp_path / "path.json").read_text()) == expected_path


def test_the_sources_are_seen_and_lead_to_their_cameras(look, views):
    tab, page = look.tab, look.page
    page.controls.frusta.value = True
    until(lambda: page._frusta[0].visible is False)  # hidden, because the page's camera stands in it
    page.go_to(views[0].camera.moved(-0.3, -0.2, -2.5))
    until(lambda: [frustum.visible for frustum in page._frusta] == [True, True])
    rested(tab)
    plain = expected(page)
    changed = np.abs(tab.canvas().astype(int) - plain).max(axis=2) > 40
    assert 100 < changed.sum() < 0.3 * changed.size  # the frusta change only their lines and pictures
    page._frusta[1]._impl.click_cb[0].callback(None)
    until(lambda: np.allclose(page.stream.camera.center, views[1].camera.center, atol=1e-5))


def test_the_command_listens_to_this_machine_alone_and_leaves_nothing_behind(browser, views, tmp_path):
    view = views[0]
    view.camera.save(tmp_path / "camera.json")
    ibr.write_color(tmp_path / "color.png", view.color)
    ibr.write_depth(tmp_path / "depth.npy", view.depth)
    words = ["view", "color.png", "depth.npy", "--camera", "camera.json", "--port", "0"]
    code = "from pyibr.app.cli import app; app()"
    command = subprocess.Popen([sys.executable, "-c", code, *words], cwd=tmp_path, stdout=subprocess.PIPE, text=True)
    try:
        line = command.stdout.readline()
        assert line.startswith("http://127.0.0.1:") and "can be opened on this machine only" in line
        assert listeners(command.pid) == LOOPBACK
        with opened(browser, line.split()[0], (320, 240)) as tab:
            rested(tab)
            assert listeners(command.pid) == LOOPBACK and tab.picture().shape == (240, 320, 3)
            tab.drag((100, 100), (150, 120), 5)
            tab.page.context.close()  # while a picture is drawn
    finally:
        command.send_signal(signal.SIGINT)
        status = command.wait(20)
    assert status == 130 and command.stdout.read() == ""
