"""A server of pages that only this machine can open: viser, bound to the loopback, for pages of its own alone.

viser has no public way to refuse a page, nor to leave out its sharing. So its private members are reached into, here
and nowhere else, and pyproject.toml keeps to the versions that have them: `ViserServer._websock_server`, of that
`_live_connections`, `_client_state_from_id` and `_client_connect_cb`, and two messages of `viser._messages`.
"""

from __future__ import annotations

import contextlib
import io
import logging
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from pyibr.core.checks import integer_from
from pyibr.core.errors import Error
from pyibr.core.optional import viser

if TYPE_CHECKING:
    from viser import ViserServer

HOST = "127.0.0.1"
_OWN = ("127.0.0.1", "localhost", "::1")  # what browsers on this machine, or at the end of a tunnel to it, call it
_PORTS = 1000  # that viser tries from the given one on


def start_server(port: int, title: str) -> ViserServer:
    """Serve pages at 127.0.0.1, on the first free port from the given one on; 0 takes any.

    Another machine cannot connect, and a foreign page that a browser of this machine has open is turned away: it could
    otherwise press the buttons here. Nothing is shared through servers on the internet, as viser offers to.

    Raises
    ------
    ArgumentError
        If the port is none.
    MissingPackageError
        If viser is not installed.
    Error
        If no port is free.
    """
    integer_from("port", port, 0, 65535)
    package = viser()
    with _quiet():
        server: ViserServer = package.ViserServer(host=HOST, port=port, label=title, verbose=False)
    if server.get_host() != HOST:  # viser's own default is every network that the machine is in
        stop_server(server)
        raise Error(f"viser listens on {server.get_host()} instead of {HOST}, so it was ended")
    if port and not port <= server.get_port() < port + _PORTS:
        stop_server(server)
        raise Error(f"no port from {port} to {port + _PORTS - 1} is free")
    _keep_private(server)
    return server


def stop_server(server: ViserServer) -> None:
    """End the server; its pages say that the connection is lost."""
    with _quiet():
        server.stop()


def url_of(server: ViserServer) -> str:
    """Return the address of the server's page."""
    return f"http://{HOST}:{server.get_port()}"


def is_own_page(headers: Mapping[str, str]) -> bool:
    """Tell whether a connection with these headers comes from a page of this server, or from no browser.

    Browsers say in `Origin` which page connects and in `Host` whom it believes to connect to. A page of another site
    has that site's name there, also where it made its name stand for this machine.
    """
    host, origin = headers.get("Host") or "", headers.get("Origin")
    if urlsplit(f"//{host}").hostname not in _OWN:
        return False
    return origin is None or urlsplit(origin).netloc == host


def _keep_private(server: ViserServer) -> None:
    """Turn foreign pages away before anything that they say is heard, and offer no public address."""
    from viser import _messages

    connections: Any = server._websock_server  # pyright: ignore[reportPrivateUsage] - viser has no public way to either
    for message in (_messages.ShareUrlRequest, _messages.ShareUrlDisconnect):
        connections.unregister_handler(message)

    async def turn_away(connection: Any) -> None:
        socket = connections._live_connections[connection.client_id]
        if not is_own_page(socket.request.headers):
            del (
                connections._live_connections[connection.client_id],
                connections._client_state_from_id[connection.client_id],
            )
            raise _ForeignPageError  # before anything that it sent is read; closing would leave that to be heard

    connections._client_connect_cb.insert(0, turn_away)
    logging.getLogger("websockets.server").addFilter(_is_no_foreign_page)
    connections.disconnect_all_clients()  # who was faster than this; pages of one's own connect again


class _ForeignPageError(Exception):
    """Ends the connection of a page that is none of this server's."""


def _is_no_foreign_page(record: logging.LogRecord) -> bool:
    """Tell whether to log it: not that a page was turned away, with all the calls that led there."""
    return not (record.exc_info and isinstance(record.exc_info[1], _ForeignPageError))


@contextlib.contextmanager
def _quiet() -> Any:
    """viser prints what it does."""
    with contextlib.redirect_stdout(io.StringIO()):
        yield
