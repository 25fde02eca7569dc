"""Measures a page's pictures per second while the camera moves, their width, and the time to the final picture.

There are two clients, on the same machine as the renderer. One is a separate process that sends sixty cameras a second
and only receives pictures; the other is headless Chromium, in which a mouse drag moves the camera.
"""

from __future__ import annotations

import functools
import json
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

import pyibr as ibr
from benchmarks.cases import Plan
from benchmarks.gaussians.clouds import cloud, path
from benchmarks.results import Parameter, Record, Skip
from benchmarks.runner import Case, Work
from benchmarks.scenes import LIVINGROOM, ROOM, bricks, data_folder, rgbd
from pyibr.app.live.page_space import fov_of
from pyibr.app.live.pages import Pages
from pyibr.app.view.scene import Scene, scene_of
from pyibr.capture import MeshScene, models, object_views
from tools.browser import CHROMIUM, PANEL, chromium

RECEIVES, DRAWS = "receives", "Chromium draws"
CLOUD = "room of Gaussians"
RATES = {"depth image": 30.0, "relief torus": 20.0, "depth object": 20.0, CLOUD: 30.0}
"""Required pictures a second for the receive-only client while the camera moves."""
DRAWN_RATE = 12.0
"""Required pictures a second that Chromium draws on the same processor."""
RESTS = {RECEIVES: 400.0, DRAWS: 800.0}
"""Most milliseconds from the last camera to the picture at full resolution, by client."""
SLOW = "depth image, by the search"
_ORBIT = 12.0  # degrees to the left and to the right
_CAMERAS = 240  # cameras in one swing, which takes four seconds
_PATIENCE = 20.0  # longest wait for a picture, in seconds

Seen = list[dict[str, Any]]
"""Rounds in the format of `benchmarks.app.receiver`."""


def cases(plan: Plan) -> Iterator[Case]:
    """Yield a case for each thing and client, and a slow case."""
    for client in (RECEIVES, DRAWS) if plan.pages_chromium else (RECEIVES,):
        for thing in RATES:
            yield Case({"thing": thing, "client": client}, functools.partial(_prepare, thing, client, plan))
    yield Case({"thing": SLOW, "client": RECEIVES}, functools.partial(_prepare, SLOW, RECEIVES, plan))


def _prepare(name: str, client: str, plan: Plan) -> Work | Skip:
    missing = _missing(client)
    if missing:
        return Skip(f"pages, {client}", missing)
    thing = _thing(name, plan)
    if isinstance(thing, Skip):
        return thing
    up = None if name.startswith("depth image") or name == CLOUD else (0, 0, 1)
    camera = path("room", plan.pages_size, 1)[0] if name == CLOUD else None
    scene = scene_of(thing, camera, up)
    watch = _received if client == RECEIVES else _drawn
    parameters: dict[str, Parameter] = {"client": client, "width": plan.pages_size[0], "height": plan.pages_size[1]}

    def read() -> Iterator[Record]:
        waiting: list[int] = []
        with ibr.view(thing, camera, up=scene.up, port=0) as pages:
            ended = threading.Event()
            watcher = threading.Thread(target=_count, args=(pages, waiting, ended, name == SLOW), daemon=True)
            watcher.start()
            seen = watch(pages, scene, plan)
            ended.set()
            watcher.join()
        yield from _records(name, parameters, seen[1:], plan)  # the first round builds kernels
        yield Record(name, "requests that wait", "count", parameters, [max(waiting, default=0)])

    return Work(read=read)


def _missing(client: str) -> str:
    """Say which package or program a client lacks; empty if none."""
    if find_spec("viser") is None:
        return "viser is not installed"
    if client == RECEIVES:
        return ""
    return (
        "there is no Chromium" if CHROMIUM is None else "" if find_spec("playwright") else "playwright is not installed"
    )


def _thing(name: str, plan: Plan) -> Any:
    if name == CLOUD:
        return cloud("room", max(plan.gaussians), 0)
    if name == "relief torus":
        height, color = bricks()
        return ibr.ReliefSurface(models.donut(48), height, color, 0.06, tiles=(10, 4))
    if name == "depth object":
        try:
            return ibr.DepthObject(object_views(MeshScene.from_mesh(models.donut(96)), 256), slices=128)
        except ibr.MissingPackageError as error:
            return Skip(name, str(error))
    there = plan.rgbd_scene != LIVINGROOM or (data_folder() / "rgbd_livingroom1").is_dir()
    return rgbd(plan.rgbd_scene if there else ROOM, 0, (640, 480))


def _count(pages: Pages, waiting: list[int], ended: threading.Event, slow: bool) -> None:
    """Count waiting requests again and again; choose the slow method on the slow case's page once it is open."""
    while not ended.wait(0.002):
        waiting.append(pages.waiting)
        opened: list[Any] = list(pages.open.values()) if slow else []
        for method in [page.controls._method for page in opened]:
            if method.value != "search":
                method.value = "search"


def _records(name: str, parameters: dict[str, Parameter], rounds: Seen, plan: Plan) -> Iterator[Record]:
    gaps: list[float] = []
    shares: list[float] = []
    rests: list[float] = []
    late = 0
    for one in rounds:
        moving = [picture for picture in one["pictures"] if picture[0] <= one["last"]]
        gaps += (1e3 * np.diff([picture[0] for picture in moving])).tolist()
        shares += [picture[2] / plan.pages_size[0] for picture in moving]
        after = [picture for picture in one["pictures"] if picture[0] > one["last"]]
        full = [number for number, picture in enumerate(after) if picture[1] == "png"]
        if full:
            rests.append(1e3 * (after[full[0]][0] - one["last"]))
            late = max(late, full[0])
    if gaps:
        yield Record(name, "between pictures", "ms", parameters, gaps)
        yield Record(name, "width", "share", parameters, shares)
    if rests:
        yield Record(name, "until full", "ms", parameters, rests)
        yield Record(name, "pictures after the last camera", "count", parameters, [late])


def _received(pages: Pages, scene: Scene, plan: Plan) -> Seen:
    """Rounds of the receive-only client."""
    angles = _ORBIT * np.sin(np.linspace(0, 2 * np.pi, _CAMERAS, endpoint=False))
    poses = [scene.page_space.pose(scene.start.orbited(angle, scene.pivot)) for angle in angles]
    asked = {
        "url": pages.url,
        "cameras": [[wxyz.tolist(), position.tolist()] for wxyz, position in poses],
        "fov": fov_of(scene.start),
        "size": plan.pages_size,
        "rounds": plan.pages_rounds + 1,
        "seconds": plan.pages_seconds,
        "patience": _PATIENCE,
    }
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.app.receiver"],
        cwd=Path(__file__).parents[2],
        input=json.dumps(asked),
        capture_output=True,
        text=True,
    )
    if done.returncode:
        raise RuntimeError(f"the receiver failed:\n{done.stderr}")
    return json.loads(done.stdout)


# Records each picture when Chromium begins to draw it. If several come between two of its frames, only the last counts.
_WATCH = """
window.shown = [];
let latest = null;
const make = URL.createObjectURL.bind(URL);
URL.createObjectURL = (blob) => {
    if (blob.type.startsWith('image/')) latest = blob;
    return make(blob);
};
const now = () => performance.now() / 1000;
const frame = () => {
    if (latest) window.shown.push([now(), latest.type.replace('image/', ''), latest]);
    latest = null;
    requestAnimationFrame(frame);
};
requestAnimationFrame(frame);
window.addEventListener('pointermove', () => { window.last = now(); }, true);
"""
_READ = """
async () => Promise.all(window.shown.map(async ([at, kind, blob]) => {
    const image = await createImageBitmap(blob);
    return [at, kind, image.width, image.height];
}))
"""


def _drawn(pages: Pages, scene: Scene, plan: Plan) -> Seen:
    """Rounds of headless Chromium with a mouse drag."""
    width, height = plan.pages_size
    made: Seen = []
    with chromium() as browser:
        page = browser.new_context(viewport={"width": width + PANEL, "height": height}).new_page()
        page.add_init_script(_WATCH)
        page.goto(f"{pages.url}/?fixedDpr=1")
        _until(lambda: page.evaluate("window.shown.some((one) => one[1] == 'png')"))
        for _ in range(plan.pages_rounds + 1):
            page.evaluate("window.shown = []")
            page.mouse.move(width // 2, height // 2)
            page.mouse.down()
            start = time.perf_counter()
            while (passed := time.perf_counter() - start) < plan.pages_seconds:
                page.mouse.move(width * (0.5 + 0.1 * np.sin(2 * np.pi * passed / 4)), height // 2)
                time.sleep(1 / 60)
            page.mouse.up()
            _until(lambda: page.evaluate("window.shown.some((one) => one[0] > window.last && one[1] == 'png')"))
            page.wait_for_timeout(300)
            made.append({"last": page.evaluate("window.last"), "pictures": page.evaluate(_READ)})
    return made


def _until(happened: Callable[[], bool]) -> None:
    end = time.perf_counter() + _PATIENCE
    while not happened() and time.perf_counter() < end:
        time.sleep(0.005)
