"""Opens pages in headless Chromium, reads the pictures that they show, and finds addresses of listening processes."""

from __future__ import annotations

import base64
import io
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from tools import browser
from tools.browser import CHROMIUM, PANEL

HARMLESS = "Unable to preventDefault inside passive event listener invocation."  # viser's, at each drag

LOOPBACK = {"0100007F"}
"""127.0.0.1, in the format of `listeners`."""

PATIENCE = 90.0  # seconds to wait at most; long, for busy machines

# Keeps all pictures that become the page's background; the page shows the last one.
WATCH = """
window.shown = [];
const make = URL.createObjectURL.bind(URL);
URL.createObjectURL = (blob) => {
    if (blob.type.startsWith('image/')) window.shown.push({blob: blob, kind: blob.type, at: performance.now()});
    return make(blob);
};
"""

READ = """
async (number) => {
    const bytes = new Uint8Array(await window.shown.at(number).blob.arrayBuffer());
    let text = '';
    for (const byte of bytes) text += String.fromCharCode(byte);
    return btoa(text);
}
"""


@contextmanager
def chromium() -> Iterator[Any]:
    """Yield a browser; skip the test if Chromium is missing."""
    if CHROMIUM is None:
        pytest.skip("needs Chromium: apt install chromium")
    pytest.importorskip("playwright.sync_api", reason="needs playwright, of the extra dev")
    pytest.importorskip("viser", reason="needs viser, of the extra view")
    with browser.chromium() as made:
        yield made


@dataclass
class Tab:
    """A page that is open in a browser.

    Attributes
    ----------
    page : playwright.sync_api.Page
    complaints : list of str
        Error messages in the page's console.
    """

    page: Any
    complaints: list[str] = field(default_factory=list)

    def hear(self, message: Any) -> None:
        """Keep a console message if it is an error."""
        if message.type == "error" and message.text != HARMLESS:
            self.complaints.append(message.text)

    def canvas(self) -> NDArray[np.uint8]:
        """(H, W, 3) pixels of the WebGL canvas, without the panel of controls."""
        data = self.page.evaluate("document.querySelector('canvas[data-engine]').toDataURL('image/png')")
        return decoded(data.split(",")[1])

    def kinds(self) -> list[str]:
        """Types of all shown pictures, in order: image/jpeg (lossy) or image/png (lossless)."""
        return self.page.evaluate("window.shown.map((one) => one.kind)")

    def picture(self, number: int = -1) -> NDArray[np.uint8]:
        """One of the shown pictures, by default the last."""
        return decoded(self.page.evaluate(READ, number))

    def shows(self, size: tuple[int, int]) -> bool:
        """Tell whether a lossless picture of this (width, height) was shown."""
        lossless = [number for number, kind in enumerate(self.kinds()) if kind == "image/png"]
        return any(self.picture(number).shape[1::-1] == size for number in lossless)

    def drag(self, start: tuple[int, int], end: tuple[int, int], steps: int = 12, pause: float = 0.0) -> None:
        """Move the mouse with its button down."""
        mouse = self.page.mouse
        mouse.move(*start)
        mouse.down()
        for part in np.linspace(0, 1, steps + 1)[1:]:
            mouse.move(*(a + part * (b - a) for a, b in zip(start, end, strict=True)))
            time.sleep(pause)
        mouse.up()


@contextmanager
def opened(chrome: Any, url: str, size: tuple[int, int] = (400, 300)) -> Iterator[Tab]:
    """Yield a page in a new browser context, with a canvas of this size, once it has shown a picture."""
    context = chrome.new_context(viewport={"width": size[0] + PANEL, "height": size[1]}, accept_downloads=True)
    try:
        page = context.new_page()
        page.set_default_timeout(1e3 * PATIENCE)
        page.add_init_script(WATCH)
        tab = Tab(page)
        page.on("console", tab.hear)
        page.on("pageerror", lambda error: tab.complaints.append(str(error)))
        page.goto(f"{url}/?fixedDpr=1")
        # A warning about slow WebGL covers the canvas.
        page.add_style_tag(content=".mantine-Notifications-root { display: none }")
        # The first picture may be drawn while the canvas still covers the panel's place.
        until(lambda: tab.shows(size))
        # Thumbnails of the sources, which are JPEG, may still arrive.
        stays(tab.kinds)
        page.evaluate("window.shown = window.shown.filter((one) => one.kind === 'image/png')")
        yield tab
    finally:
        context.close()


def until(happened: Callable[[], Any], seconds: float = PATIENCE) -> None:
    """Wait until `happened` returns true; fail after `seconds`."""
    end = time.monotonic() + seconds
    while not happened():
        assert time.monotonic() < end, "it did not happen"
        time.sleep(0.02)


def stays(value: Callable[[], Any], seconds: float = PATIENCE) -> bool:
    """Wait until a value has not changed for a while."""
    end = time.monotonic() + seconds
    last, since = value(), time.monotonic()
    while time.monotonic() < end:
        time.sleep(0.02)
        if (new := value()) != last:
            last, since = new, time.monotonic()
        if time.monotonic() - since > 0.5:
            return True
    return False


def rested(tab: Tab, seconds: float = PATIENCE) -> None:
    """Wait until the page has shown the same lossless picture for a while."""

    def is_still() -> bool:
        kinds = tab.kinds()
        time.sleep(0.3)  # a camera counts as resting earlier
        return kinds[-1] == "image/png" and tab.kinds() == kinds

    until(is_still, seconds)


def settles_on(
    tab: Tab, truth: Callable[[], NDArray[np.uint8]], number: int = -1, left_out: NDArray[np.bool_] | None = None
) -> None:
    """Wait until the page rests on a picture; fail with the difference if it does not.

    A page that rests may still be about to change, because changes reach it through its server's threads. `truth` draws
    the expected picture for the page's current camera; `number` is as in `Tab.picture`; `left_out` masks (H, W) pixels
    that are not compared.
    """

    def pictures() -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        shown, wanted = tab.picture(number), truth()
        if left_out is None or shown.shape != wanted.shape:
            return shown, wanted
        return shown[~left_out], wanted[~left_out]

    def is_right() -> bool:
        rested(tab)  # first, because the page may change while the truth is drawn
        return np.array_equal(*pictures())

    with suppress(AssertionError):
        until(is_right)
        return
    np.testing.assert_array_equal(*pictures())


def decoded(text: str) -> NDArray[np.uint8]:
    """Decode a picture from base64."""
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(text))).convert("RGB"))


def listeners(pid: int | str = "self") -> set[str]:
    """Addresses on which a process listens, as /proc writes them: hexadecimal, with the last byte of IPv4 first."""
    own: set[str] = set()
    for link in Path(f"/proc/{pid}/fd").iterdir():
        try:
            own.add(str(link.readlink()))
        except FileNotFoundError:  # the descriptor by which the folder was listed is closed by now
            continue
    found: set[str] = set()
    for table in ("tcp", "tcp6"):
        for line in Path(f"/proc/{pid}/net/{table}").read_text().splitlines()[1:]:
            columns = line.split()
            if columns[3] == "0A" and f"socket:[{columns[9]}]" in own:
                found.add(columns[1].split(":")[0])
    return found
