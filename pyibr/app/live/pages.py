"""Pages of one kind, one for each browser that opens them."""

from __future__ import annotations

import contextvars
import html
import threading
from collections.abc import Callable
from types import TracebackType
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from pyibr.app.live.page_space import PageSpace, fov_of
from pyibr.app.live.panel import set_theme
from pyibr.app.live.renderer import Renderer
from pyibr.app.live.server import start_server, stop_server, url_of
from pyibr.app.live.stream import Picture, Request
from pyibr.core.camera import Camera
from pyibr.core.checks import Float64
from pyibr.opencl.program import telling_builds

if TYPE_CHECKING:
    from viser import ClientHandle

_Made = TypeVar("_Made")

_NEAR, _FAR = 0.005, 1000.0  # units of the page
_HEIGHT = 640  # pixels in a notebook


class Page(Protocol):
    """Contents of a browser's page."""

    def leave(self) -> None:
        """Stop drawing, because the page is closed."""
        ...


class Pages:
    """A server whose pages show live pictures until it is closed.

    Made by `pyibr.view` and `pyibr.place`.

    Attributes
    ----------
    url : str
        Address of the page; only this machine can open it.
    open : dict
        The pages that are open in browsers, by the server's client numbers.
    server : ViserServer
        The viser server.
    """

    def __init__(
        self,
        make: Callable[[ClientHandle, Pages], Page],
        page_space: PageSpace,
        start: Camera,
        pivot: Float64,
        up: Float64,
        port: int,
        title: str,
        set_up: Callable[[Pages], None] = lambda _: None,
    ) -> None:
        self.open: dict[int, Page] = {}
        self._make = make
        self._lock = threading.Lock()
        self._closed = threading.Event()
        self._context = contextvars.copy_context()  # `use_device` applies to the thread that calls it
        self.server = start_server(port, title)
        self.renderer = Renderer[Request, Picture](
            lambda request, full: request.stream.draw(request.camera, full),
            lambda request, full, picture: request.stream.deliver(full, picture),
            lambda request, error: request.stream.failed(error),
        )
        self.url = url_of(self.server)
        first = self.server.initial_camera
        set_theme(self.server.gui)
        self.server.scene.set_up_direction(tuple(up))
        first.near, first.far, first.fov = _NEAR, _FAR, fov_of(start)
        first.position, first.look_at = tuple(page_space.point(start.center)), tuple(page_space.point(pivot))
        set_up(self)
        self.server.on_client_connect(self._opened)
        self.server.on_client_disconnect(self._left)

    def __repr__(self) -> str:
        return f"<Pages {self.url}{', closed' if self._closed.is_set() else ''}>"

    def _repr_html_(self) -> str:
        if self._closed.is_set():
            return html.escape(repr(self))
        return f'<iframe src="{self.url}" width="100%" height="{_HEIGHT}" style="border: 0"></iframe>'

    def __enter__(self) -> Pages:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def closed(self) -> bool:
        """True once the server is closed."""
        return self._closed.is_set()

    @property
    def waiting(self) -> int:
        """Number of pictures waiting to be drawn: at most one for each page."""
        return self.renderer.waiting

    def wait(self) -> None:
        """Wait until the server is closed, or Ctrl-C ends it."""
        try:
            while not self._closed.wait(0.5):
                pass
        finally:
            self.close()

    def close(self) -> None:
        """End the server and all work for its pages."""
        if not self._closed.is_set():
            self._closed.set()
            for page in list(self.open.values()):
                page.leave()
            stop_server(self.server)
            self.renderer.close()

    def call(self, function: Callable[[], _Made], say: Callable[[str], object]) -> _Made:
        """Call a function on the device of the pages' pictures, from any thread; `say` is called with kernel builds."""

        def told() -> _Made:
            with telling_builds(say):
                return function()

        return self._context.copy().run(told)

    def _opened(self, client: ClientHandle) -> None:
        page = self._make(client, self)
        with self._lock:
            known: Any = self.server.get_clients()
            if client.client_id in known and not self._closed.is_set():
                self.open[client.client_id] = page
                return
        page.leave()  # the page was closed while it was made

    def _left(self, client: ClientHandle) -> None:
        with self._lock:
            page = self.open.pop(client.client_id, None)
        if page is not None:
            page.leave()
