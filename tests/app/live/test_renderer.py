"""Each client's latest request is drawn, clients share the time, and no outdated picture is shown."""

from __future__ import annotations

import asyncio
import threading
import time
from types import SimpleNamespace
from typing import Any

import pytest

import pyibr as ibr
from pyibr.app.live.renderer import Renderer
from pyibr.app.live.stream import Stream
from pyibr.opencl.device import current
from tests.app.browser import until


class Recorder:
    """Stands in for drawing: waits, and records each delivery as (request, full)."""

    def __init__(self, seconds: float = 0.0, rest: float = 0.05) -> None:
        self.seconds: dict[str, float] = {}
        self.default = seconds
        self.drawn: list[tuple[str, bool]] = []
        self.delivered: list[tuple[str, bool]] = []
        self.errors: list[Exception] = []
        self.gate = threading.Event()
        self.gate.set()
        self.renderer = Renderer(self.draw, self.deliver, lambda _, error: self.errors.append(error), rest)

    def draw(self, request: str, full: bool) -> str:
        self.drawn.append((request, full))
        self.gate.wait(5)
        time.sleep(self.seconds.get(request[0], self.default))
        if request.endswith("!"):
            raise ibr.Error(request)
        return request.upper()

    def deliver(self, request: str, full: bool, result: str) -> None:
        assert result == request.upper()
        self.delivered.append((request, full))

    def ask_both(self, seconds: float) -> None:
        """Let the clients a and b ask all the time."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            for client in "ab":
                self.renderer.ask(client, client)
            time.sleep(0.001)

    def until(self, happened, seconds: float = 5.0) -> None:
        end = time.monotonic() + seconds
        while not happened():
            assert time.monotonic() < end, (self.drawn, self.delivered, self.errors)
            time.sleep(0.002)


@pytest.fixture
def recorder():
    made = Recorder()
    yield made
    made.gate.set()
    made.renderer.close()


def test_the_latest_request_is_drawn_and_the_others_are_dropped(recorder: Recorder):
    recorder.gate.clear()
    recorder.renderer.ask("a", "a0")
    recorder.until(lambda: recorder.drawn)
    for number in range(1, 101):
        recorder.renderer.ask("a", f"a{number}")
        assert recorder.renderer.waiting <= 1
    assert recorder.renderer.dropped == 99
    recorder.gate.set()
    recorder.until(lambda: ("a100", True) in recorder.delivered)
    assert recorder.delivered == [("a0", False), ("a100", False), ("a100", True)]


def test_what_rests_is_drawn_in_full_after_a_while_and_only_once(recorder: Recorder):
    start = time.monotonic()
    recorder.renderer.ask("a", "a0")
    recorder.until(lambda: ("a0", True) in recorder.delivered)
    assert time.monotonic() - start >= 0.05
    time.sleep(0.2)
    assert recorder.delivered == [("a0", False), ("a0", True)]


def test_the_first_picture_needs_no_rest():
    recorder = Recorder(rest=30)
    recorder.renderer.ask("a", "a0", at_once=False)
    recorder.until(lambda: recorder.delivered)
    assert recorder.delivered == [("a0", True)]
    recorder.renderer.close()


def test_a_full_picture_that_is_not_the_latest_any_more_is_not_delivered(recorder: Recorder):
    recorder.renderer.ask("a", "a0")
    recorder.until(lambda: ("a0", False) in recorder.delivered)
    recorder.gate.clear()
    recorder.until(lambda: ("a0", True) in recorder.drawn)
    recorder.renderer.ask("a", "a1")
    recorder.gate.set()
    recorder.until(lambda: ("a1", True) in recorder.delivered)
    assert recorder.delivered == [("a0", False), ("a1", False), ("a1", True)]


def test_clients_share_the_time_not_the_frames(recorder: Recorder):
    recorder.seconds = {"a": 0.04, "b": 0.004}
    recorder.ask_both(1.2)
    counts = {client: sum(request == client for request, _ in recorder.drawn) for client in "ab"}
    assert counts["a"] >= 5
    assert counts["b"] > 3 * counts["a"]  # about 10 if clients get equal time, 1 if they got equal numbers of frames


def test_who_comes_late_does_not_get_what_the_others_had_before(recorder: Recorder):
    recorder.default = 0.01
    for _ in range(30):
        recorder.renderer.ask("a", "a")
        time.sleep(0.012)
    before = len(recorder.drawn)
    recorder.ask_both(0.5)
    late = [request for request, _ in recorder.drawn[before:]]
    assert late.count("a") > 0.3 * len(late)


def test_who_leaves_is_not_drawn_for_and_gets_nothing(recorder: Recorder):
    recorder.gate.clear()
    recorder.renderer.ask("a", "a0")
    recorder.renderer.ask("b", "b0")
    recorder.until(lambda: recorder.drawn)
    recorder.renderer.ask("a", "a1")
    recorder.renderer.leave("a")
    assert recorder.renderer.clients == ["b"]
    recorder.gate.set()
    recorder.until(lambda: ("b0", True) in recorder.delivered)
    assert {request for request, _ in recorder.delivered} == {"b0"}
    assert ("a1", False) not in recorder.drawn


def test_an_error_is_told_and_the_next_request_is_drawn(recorder: Recorder):
    recorder.renderer.ask("a", "a!")
    recorder.until(lambda: recorder.errors)
    assert str(recorder.errors[0]) == "a!"
    recorder.renderer.ask("a", "a1")
    recorder.until(lambda: ("a1", True) in recorder.delivered)


def test_a_closed_one_ends_its_thread_and_takes_no_requests():
    recorder = Recorder()
    recorder.renderer.ask("a", "a0")
    recorder.renderer.close()
    assert recorder.renderer._thread not in threading.enumerate()
    recorder.renderer.ask("a", "a1")
    time.sleep(0.05)
    assert "a1" not in [request for request, _ in recorder.drawn]


def test_it_draws_on_the_device_that_was_chosen_where_it_was_made():
    used: list[str] = []
    worked = [device for device in ibr.devices() if device.works][-1]
    with ibr.use_device(worked):
        renderer = Renderer(lambda *_: current().device.name, lambda *a: used.append(a[2]), lambda *_: None)
    renderer.ask(0, 0, at_once=False)
    until(lambda: used, 10)
    renderer.close()
    assert used == [worked.name]


def test_a_camera_that_moves_while_it_is_first_read_is_asked_for_last():
    handlers: list[Any] = []
    page = SimpleNamespace(wxyz=(1, 0, 0, 0), position=(0, 0, 0), fov=1.0, image_width=40, image_height=30)
    page.on_update = handlers.append
    asked: list[ibr.Camera] = []
    renderer = SimpleNamespace(ask=lambda client, request, at_once: asked.append(request.camera))
    news: list[threading.Thread] = []

    def move() -> None:
        page.image_width = 30
        asyncio.run(handlers[0](None))

    class Space:
        def camera(self, wxyz: Any, position: Any, fov: float, size: tuple[int, int]) -> ibr.Camera:
            if not news:  # the page's first camera is read while the next one arrives
                news.append(threading.Thread(target=move))
                news[0].start()
                news[0].join(0.2)
            return ibr.Camera.from_fov(size, fov_x=60)

    client = SimpleNamespace(client_id=1, camera=page)
    unused: Any = None
    stream = Stream(client, renderer, Space(), unused, unused, unused)  # pyright: ignore[reportArgumentType]
    stream.follow()
    news[0].join()
    assert stream.camera is not None
    assert [camera.size for camera in asked] == [(40, 30), (30, 30)] and stream.camera.size == (30, 30)
