"""A server of pages that only this machine can open: viser, bound to loopback, for its own pages only.

viser has no public way to refuse a page or to switch off sharing. This module, and no other, therefore uses its private
members, and pyproject.toml pins the versions that have them: `ViserServer._websock_server` with its
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
_OWN = ("127.0.0.1", "localhost", "::1")  # host names that browsers here, or behind a tunnel, use
_PORTS = 1000  # number of ports that viser tries


def start_server(port: int, title: str) -> ViserServer:
    """Serve pages at 127.0.0.1, on the given port or the next free one; 0 takes any free port.

    Other machines cannot connect. A foreign page that is open in a browser of this machine is refused, as it could
    otherwise press the buttons here. viser's sharing through servers on the internet is switched off.

    Raises
    ------
    ArgumentError
        If the port is not a valid number.
    MissingPackageError
        If viser is not installed.
    Error
        If no port is free.
    """
    integer_from("port", port, 0, 65535)
    package = viser()
    with _quiet():
        server: ViserServer = package.ViserServer(host=HOST, port=port, label=title, verbose=False)
    if server.get_host() != HOST:  # viser listens on all networks by default
        stop_server(server)
        raise Error(f"viser listens on {server.get_host()} instead of {HOST}, so it was ended")
    if port and not port <= server.get_port() < port + _PORTS:
        stop_server(server)
        raise Error(f"no port from {port} to {port + _PORTS - 1} is free")
    _keep_private(server)
    return server


def stop_server(server: ViserServer) -> None:
    """Stop the server; its pages show that the connection is lost."""
    with _quiet():
        server.stop()


def url_of(server: ViserServer) -> str:
    """Return the address of the server's page."""
    return f"http://{HOST}:{server.get_port()}"


def is_own_page(headers: Mapping[str, str]) -> bool:
    """Tell whether a connection with these headers comes from a page of this server, or from no browser.

    Browsers send the connecting page in `Origin` and the requested host in `Host`. For a page of another site, both
    hold that site's name, even if the site makes its name resolve to this machine.
    """
    host, origin = headers.get("Host") or "", headers.get("Origin")
    if urlsplit(f"//{host}").hostname not in _OWN:
        return False
    return origin is None or urlsplit(origin).netloc == host


def _keep_private(server: ViserServer) -> None:
    """Refuse foreign pages before their messages are read, and switch off public addresses."""
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
            raise _ForeignPageError  # ends the connection before its messages are read; closing would still read them

    connections._client_connect_cb.insert(0, turn_away)
    logging.getLogger("websockets.server").addFilter(_is_no_foreign_page)
    connections.disconnect_all_clients()  # connections made before this point; own pages connect again


class _ForeignPageError(Exception):
    """Ends the connection of a page of another site."""


def _is_no_foreign_page(record: logging.LogRecord) -> bool:
    """Tell whether to log a record: not the traceback of a refused page."""
    return not (record.exc_info and isinstance(record.exc_info[1], _ForeignPageError))


@contextlib.contextmanager
def _quiet() -> Any:
    """Context without viser's output, which rich writes to notebooks, not to standard output."""
    import rich

    console = rich.get_console()
    before, console.quiet = console.quiet, True
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            yield
    finally:
        console.quiet = before
