"""Screenshots of pyibr's pages, into docs/images: python docs/gallery/pages.py. Needs Chromium and playwright."""

from __future__ import annotations

import io
import sys
import time
from collections.abc import Callable
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from depthcameras import room
from objects import knot_surface
from PIL import Image

import pyibr as ibr
from pyibr.capture.proposal import propose_frusta
from pyibr.opencl.device import explain

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from tools.browser import chromium

IMAGES = Path(__file__).resolve().parents[1] / "images"
WIDE, NARROW = (1080, 680), (390, 680)  # windows in pixels: on a desktop, and on a phone with collapsed controls
QUALITY = 82  # of JPEG
GAP = 12  # pixels between two windows
BLANK = """
(device) => {
    const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
    while (texts.nextNode()) {
        const one = texts.currentNode;
        if (one.data.includes(device)) one.data = 'the name of the device';
        if (one.data.includes(' ms')) one.data = one.data.replace(/\\d+\\.\\d+|\\d+(?= ms)/g, '..');
    }
}
"""
"""Script for the browser that hides the device's name and the times, since they depend on the machine."""
PATIENCE = 180.0  # seconds until a page has drawn its picture
SETTLED = 1.5  # seconds without a change after which a page counts as finished


@contextmanager
def window(browser: Any, url: str, size: tuple[int, int]):
    """Open a page in a window; hide the message that WebGL is slow on this machine."""
    context = browser.new_context(viewport={"width": size[0], "height": size[1]})
    page = context.new_page()
    page.set_default_timeout(1e3 * PATIENCE)
    page.goto(f"{url}/?fixedDpr=1")
    page.add_style_tag(content=".mantine-Notifications-root { display: none }")
    page.get_by_text(" ms").first.wait_for(state="attached")
    yield page
    context.close()


def shot(page: Any) -> Image.Image:
    """Take a screenshot of the window when it has stopped changing."""
    end, before = time.monotonic() + PATIENCE, b""
    while (now := page.screenshot()) != before:
        if time.monotonic() > end:
            raise RuntimeError("the page does not come to rest")
        before = now
        time.sleep(SETTLED)
    page.evaluate(BLANK, explain()[0].name)
    return Image.open(io.BytesIO(page.screenshot())).convert("RGB")


def choose(page: Any, label: str, option: str) -> None:
    """Choose an option of a control on the page."""
    page.get_by_label(label, exact=True).click()
    page.get_by_role("option", name=option, exact=True).click()


def unfold(page: Any, folder: str) -> None:
    """Open or close a folder of controls."""
    page.get_by_text(folder, exact=True).click()


def view_pages(browser: Any) -> dict[str, Image.Image]:
    """Make the pictures of `pyibr view`: a knot in front of a corner, by pixel classes and by two methods."""
    scene, eyes = room(), ((-3.0, -9.5, 3.2), (1.5, -10.0, 2.2))
    cameras = [ibr.Camera.look_at(eye, (0.3, 0, -0.4), (0, 0, 1), (480, 400), fov_y=48) for eye in eyes]
    views = [scene.capture(camera) for camera in cameras]
    start = ibr.Camera.look_at((-11.5, -14.0, 6.5), (0.6, -0.4, -0.2), (0, 0, 1), (480, 400), fov_y=40)

    def classes(page: Any) -> None:
        choose(page, "Show", "pixel classes")

    def compared(page: Any) -> None:
        choose(page, "Compare with", "depth mesh")
        choose(page, "As", "side by side")

    def dark(page: Any) -> None:
        unfold(page, "Page")
        page.get_by_label("Dark", exact=True).check()
        unfold(page, "Page")

    with ibr.view(views, start, port=0) as pages:
        return {
            "view-page.jpg": beside(taken(browser, pages.url, WIDE, classes), taken(browser, pages.url, NARROW, dark)),
            "view-compare.jpg": taken(browser, pages.url, WIDE, compared),
        }


def place_pages(browser: Any) -> dict[str, Image.Image]:
    """Make the picture of `pyibr place`: five proposed frusta, which do not see all of a knot."""
    corners, faces, colors = knot_surface()
    mesh = ibr.Mesh(corners, faces, colors=colors)
    frusta = propose_frusta(mesh, 5, 256)

    def dark(page: Any) -> None:
        choose(page, "Chosen", "4")
        page.get_by_label("Dark", exact=True).check()

    with ibr.place(mesh, frusta, up=(0, 0, 1), port=0) as pages:
        narrow, wide = taken(browser, pages.url, NARROW, lambda _: None), taken(browser, pages.url, WIDE, dark)
        return {"place-page.jpg": beside(wide, narrow)}


def taken(browser: Any, url: str, size: tuple[int, int], prepare: Callable[[Any], None]) -> Image.Image:
    """Open a window of a given size, do some actions on the page, and take a screenshot."""
    with window(browser, url, size) as page:
        if size == NARROW:
            unfold(page, "Controls")
        prepare(page)
        if size == NARROW:
            unfold(page, "Controls")
        return shot(page)


def beside(*images: Image.Image) -> Image.Image:
    """Join screenshots side by side into one picture."""
    gap = np.full((images[0].height, GAP, 3), 255, np.uint8)
    parts = [part for image in images for part in (gap, np.asarray(image))][1:]
    return Image.fromarray(np.concatenate(parts, axis=1))


if __name__ == "__main__":
    IMAGES.mkdir(exist_ok=True)
    with chromium() as browser:
        for name, image in {**view_pages(browser), **place_pages(browser)}.items():
            path = IMAGES / name
            image.save(path, quality=QUALITY)
            print(f"{path}: {image.width} x {image.height}, {path.stat().st_size / 1000:.0f} kB")
