"""A page's last request for a picture always has the page's current camera."""

from __future__ import annotations

import asyncio
import threading
from types import SimpleNamespace
from typing import Any

import pyibr as ibr
from pyibr.app.live.stream import Stream


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
    assert [camera.size for camera in asked] == [(40, 30), (30, 30)]
    assert stream.camera.size == (30, 30)
