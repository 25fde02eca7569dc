"""Only this machine can open pages, and a page of another site cannot press their buttons."""

from __future__ import annotations

import asyncio
import io
import re
import socket
import threading
from pathlib import Path

import pytest

import pyibr as ibr
from pyibr.app.live.server import HOST, is_own_page, start_server, stop_server, url_of
from tests.app.browser import LOOPBACK, listeners

viser = pytest.importorskip("viser")
websockets = pytest.importorskip("websockets")

PROTOCOL = f"viser-v{viser.__version__}"


@pytest.mark.parametrize(
    ("host", "origin", "own"),
    [
        ("127.0.0.1:8080", "http://127.0.0.1:8080", True),
        ("localhost:9000", "http://localhost:9000", True),  # the near end of a tunnel
        ("127.0.0.1:8080", None, True),  # a program that is no browser
        ("127.0.0.1:8080", "http://evil.example", False),
        ("127.0.0.1:8080", "http://127.0.0.1:9999", False),  # another program's page on this machine
        ("127.0.0.1:8080", "null", False),  # a page from a file, or in a sandbox
        ("evil.example:8080", "http://evil.example:8080", False),  # a name that resolves to this machine, for an attack
        ("evil.example:8080", None, False),
        ("", None, False),
    ],
)
def test_pages_of_other_sites_are_told_by_their_headers(host, origin, own):
    headers = {"Host": host} | ({} if origin is None else {"Origin": origin})
    assert is_own_page(headers) == own


def test_it_listens_on_the_loopback_alone_and_prints_nothing(capfd: pytest.CaptureFixture[str]):
    before = listeners()
    server = start_server(0, "test")
    assert listeners() - before <= LOOPBACK and listeners() >= LOOPBACK
    assert url_of(server) == f"http://{HOST}:{server.get_port()}"
    stop_server(server)
    assert capfd.readouterr().out == ""


def test_it_prints_nothing_in_a_notebook():
    """In notebooks, rich displays what it prints; it does not write to standard output."""
    rich = pytest.importorskip("rich")
    shown, console = io.StringIO(), rich.get_console()
    before = console.file
    console.file = shown
    try:
        stop_server(start_server(0, "test"))
        assert shown.getvalue() == "" and not console.quiet
    finally:
        console.file = before


def test_a_taken_port_is_passed_over():
    with socket.socket() as taken:
        taken.bind((HOST, 0))
        taken.listen()
        port = taken.getsockname()[1]
        server = start_server(port, "test")
        assert port < server.get_port() < port + 1000
        stop_server(server)


@pytest.mark.parametrize("port", [-1, 65536, "80", None])
def test_what_is_no_port_is_refused(port):
    with pytest.raises(ibr.ArgumentError, match="port: expected"):
        start_server(port, "test")


def test_a_foreign_page_is_turned_away_before_it_is_heard(caplog: pytest.LogCaptureFixture):
    server = start_server(0, "test")
    heard = threading.Event()
    server.on_client_connect(lambda _: heard.set())
    camera = {"type": "ViewerCameraMessage", "wxyz": (1, 0, 0, 0), "position": (0, 0, 0), "fov": 1.0, "near": 0.1}
    camera |= {"far": 9.0, "image_height": 3, "image_width": 4, "look_at": (0, 0, 1), "up_direction": (0, 1, 0)}

    async def connects(origin: str | None) -> bool:
        import msgspec

        url = url_of(server).replace("http", "ws")
        try:
            async with websockets.connect(url, origin=origin, subprotocols=[PROTOCOL]) as own:
                await own.send(msgspec.msgpack.encode(camera))
                await asyncio.wait_for(own.recv(), 5)
                await asyncio.sleep(0.2)
                return True
        except websockets.ConnectionClosed:
            return False

    assert not asyncio.run(connects("http://evil.example"))
    assert not heard.is_set()
    assert not caplog.records
    assert asyncio.run(connects(url_of(server))) and heard.wait(5)
    stop_server(server)


def test_private_members_of_viser_are_reached_into_by_the_server_alone():
    private = re.compile(r"viser import _|viser\._|\._(?:impl|websock|live_conn|client_|gui_api|queue_)")
    app = Path(ibr.__file__).parent / "app"
    files = {file for file in app.rglob("*.py") if private.search(file.read_text(encoding="utf-8"))}
    assert files == {app / "live" / "server.py"}


def test_nothing_can_be_shared_over_the_internet():
    server = start_server(0, "test")
    shares = [kind.__name__ for kind in server._websock_server._incoming_handlers if "Share" in kind.__name__]
    assert shares == []
    stop_server(server)
