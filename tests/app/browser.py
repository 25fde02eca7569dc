"""Pages in a real Chromium without a window, and what they show."""

from __future__ import annotations

import base64
import io
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from tools import browser
from tools.browser import CHROMIUM, PANEL

HARMLESS = "Unable to preventDefault inside passive event listener invocation."  # viser's own, at each drag of a thing

PATIENCE = 90.0  # seconds: on machines that do other things, too

# Keeps what is loaded as the picture behind the page: the one that was asked for last is the one that is shown.
WATCH = """
window.shown = [];
const make = URL.createObjectURL.bind(URL);
URL.createObjectURL = (blob) => {
    if (blob.type.startsWith('image/')) window.shown.push({blob: blob, kind: blob.type, at: performance.now()});
    return make(blob);
};
"""

# The width and the height of each PNG stand at its bytes 16 to 24.
SIZES = """
async () => Promise.all(window.shown.filter((one) => one.kind === 'image/png').map(async (one) => {
    const head = new DataView(await one.blob.slice(16, 24).arrayBuffer());
    return [head.getUint32(0), head.getUint32(4)];
}))
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
    """A browser; tests that ask for one are skipped where there is none."""
    if CHROMIUM is None:
        pytest.skip("needs Chromium: apt install chromium")
    pytest.importorskip("playwright.sync_api", reason="needs playwright, of the extra dev")
    pytest.importorskip("viser", reason="needs viser, of the extra view")
    with browser.chromium() as made:
        yield made


@dataclass
class Tab:
    """A page that a browser has open.

    Attributes
    ----------
    page : playwright.sync_api.Page
    complaints : list of str
        What the console holds that is an error.
    """

    page: Any
    complaints: list[str] = field(default_factory=list)

    def hear(self, message: Any) -> None:
        """Keep what the console says, if it is an error."""
        if message.type == "error" and message.text != HARMLESS:
            self.complaints.append(message.text)

    def canvas(self) -> NDArray[np.uint8]:
        """(H, W, 3) what WebGL has drawn, without the panel."""
        data = self.page.evaluate("document.querySelector('canvas[data-engine]').toDataURL('image/png')")
        return decoded(data.split(",")[1])

    def kinds(self) -> list[str]:
        """Of all pictures that were shown, in their order: image/jpeg or image/png."""
        return self.page.evaluate("window.shown.map((one) => one.kind)")

    def picture(self, number: int = -1) -> NDArray[np.uint8]:
        """One of the pictures that were shown, the last one by default."""
        return decoded(self.page.evaluate(READ, number))

    def sizes_without_loss(self) -> set[tuple[int, ...]]:
        """(width, height) of each picture that was shown as PNG."""
        return {tuple(size) for size in self.page.evaluate(SIZES)}

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
    """A page in a context of its own, with a canvas of some size, once its server shows a picture in it."""
    context = chrome.new_context(viewport={"width": size[0] + PANEL, "height": size[1]}, accept_downloads=True)
    try:
        page = context.new_page()
        page.set_default_timeout(1e3 * PATIENCE)
        page.add_init_script(WATCH)
        tab = Tab(page)
        page.on("console", tab.hear)
        page.on("pageerror", lambda error: tab.complaints.append(str(error)))
        page.goto(f"{url}/?fixedDpr=1")
        # That WebGL is slow is said over the canvas.
        page.add_style_tag(content=".mantine-Notifications-root { display: none }")
        # The first picture may be of a canvas that has not made room for the panel yet.
        until(lambda: size in tab.sizes_without_loss())
        # The sources' thumbnails, which are JPEG, may come later than it.
        stays(tab.kinds)
        page.evaluate("window.shown = window.shown.filter((one) => one.kind === 'image/png')")
        yield tab
    finally:
        context.close()


def until(happened: Callable[[], Any], seconds: float = PATIENCE) -> None:
    """Wait for something; fail if it does not happen."""
    end = time.monotonic() + seconds
    while not happened():
        assert time.monotonic() < end, "it did not happen"
        time.sleep(0.02)


def stays(value: Callable[[], Any], seconds: float = PATIENCE) -> bool:
    """Wait until something has not changed for a while."""
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
    """Wait until the page shows a picture without loss, and has shown no other for a while."""

    def is_still() -> bool:
        kinds = tab.kinds()
        time.sleep(0.3)  # longer than a camera takes to count as resting
        return kinds[-1] == "image/png" and tab.kinds() == kinds

    until(is_still, seconds)


def settles_on(
    tab: Tab, truth: Callable[[], NDArray[np.uint8]], number: int = -1, left_out: NDArray[np.bool_] | None = None
) -> None:
    """Wait until the page rests on a picture; fail with how it differs if it does not.

    What a page is told to show comes through its server's threads, so that a page that rests may not have begun.
    `truth` makes the picture of the page's camera at the time; `number` as in `Tab.picture`; `left_out` is (H, W).
    """

    def pictures() -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        shown, wanted = tab.picture(number), truth()
        if left_out is None or shown.shape != wanted.shape:
            return shown, wanted
        return shown[~left_out], wanted[~left_out]

    def is_right() -> bool:
        rested(tab)  # first, for the truth takes longer than a look at the page
        return np.array_equal(*pictures())

    with suppress(AssertionError):
        until(is_right)
        return
    np.testing.assert_array_equal(*pictures())


def decoded(text: str) -> NDArray[np.uint8]:
    """The picture that a base64 text holds."""
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(text))).convert("RGB"))
