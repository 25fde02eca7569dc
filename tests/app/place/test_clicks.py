"""The page's controls, without a browser: clicks that come faster than the page follows, and the folder of a set."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import pyibr as ibr
from pyibr.app.live.page_space import PageSpace
from pyibr.app.live.server import start_server, stop_server
from pyibr.app.live.stream import Picture
from pyibr.app.place.model import Placement
from pyibr.app.place.page import PlacePage
from pyibr.capture.frusta import Frustum, load_frusta
from pyibr.opencl.program import kernel as use_kernel

pytest.importorskip("viser")

ONE = Frustum.look_at((0, 0, 3), (0, 0, 0), (0, 1, 0), 16)


@pytest.fixture
def page():
    """A page whose captured images are constant, so that no device draws."""
    server = start_server(0, "test")
    camera = ONE.camera
    view = ibr.DepthImage(None, np.ones((camera.height, camera.width), np.float32), camera)
    captures: Any = SimpleNamespace(nearest=lambda _: None, views=lambda frusta: [view for _ in frusta])
    captures.surface = SimpleNamespace(mesh=None)
    pages: Any = SimpleNamespace(server=server, call=lambda function, say: function())
    yield PlacePage(pages, Placement(16), captures, PageSpace(np.zeros(3), 1.0), Path("~/placed"))
    stop_server(server)


@pytest.mark.filterwarnings("error")
def test_clicks_at_once_leave_the_frusta_that_there_are(page):
    """Clicks arrive in several threads; a thread must not use a handle of viser that another has replaced."""
    placement, rng = page.placement, np.random.default_rng(0)

    def add() -> None:
        placement.add(ONE.at(ONE.camera.moved(time.perf_counter() % 1, 0, 0).world_from_camera))

    clicks = [add, add, placement.undo, placement.redo, placement.delete, lambda: page._choose(0), page.gizmos.follow]
    with ThreadPoolExecutor(8) as server:
        clicked = [server.submit(clicks[number]) for number in rng.integers(len(clicks), size=300)]
    assert [one.exception() for one in clicked if one.exception()] == []
    state = placement.state
    drawn = [handle for _, handle in page.gizmos._drawn]
    wanted = [page.page_space.point(one.camera.center) for one in state.frusta]
    np.testing.assert_allclose([handle.position for handle in drawn], np.reshape(wanted, (-1, 3)), atol=1e-12)
    assert page._chosen.value == ("none" if state.chosen is None else str(state.chosen + 1))


def test_controls_that_show_what_is_do_not_change_it_and_hands_that_turn_them_meanwhile_do(page):
    page.placement.add(ONE)
    with ThreadPoolExecutor(1) as other, page.placement.lock:
        page._quiet = True  # while this thread shows the current state
        page._across.value = 30.0
        turned = other.submit(setattr, page._across, "value", 20.0)
        page._quiet = False
        assert page.placement.state.current == ONE
    assert turned.exception() is None and page.placement.state.current.fov[0] == pytest.approx(20)


def test_the_page_says_which_kernels_are_being_built_until_it_shows_a_picture(page, tmp_path, monkeypatch):
    file = tmp_path / "own.cl"
    file.write_text(f"kernel void own(global float *x) {{ x[0] = {time.perf_counter()}f; }}")  # not in any cache
    picture = Picture(np.zeros((3, 4, 3), np.uint8), None, ONE.camera)

    def painted(*_: object) -> Picture:
        use_kernel(file, "own")
        return picture

    monkeypatch.setattr("pyibr.app.place.page.paint", painted)
    for said in ("kernels are being built for this device, once: ", "nothing new"):
        page.panel.say("nothing new")
        page.picture(ONE.camera, ONE.camera.size)
        assert page.panel.text.startswith(said)


def test_a_folder_at_home_is_meant_there_and_told_whole(page, tmp_path, monkeypatch: pytest.MonkeyPatch):
    assert page._folder.value == str(Path.home() / "placed")
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("USERPROFILE", str(tmp_path))
    page.placement.add(ONE)
    page._folder.value = "~/set"
    page.save()
    assert page._folder.value == str(tmp_path / "set")
    page.panel.say("a picture")
    assert page.panel.text == f"**Saved** 1 frusta to {tmp_path / 'set'}\n\na picture"
    assert load_frusta(tmp_path / "set")[0] == list(page.placement.state.frusta)
    page._folder.value = "~nobody-of-that-name/set"
    page.panel.attempt(page.save)
    assert "**Not done:** folder: expected a folder" in page.panel.text
