"""Times uses of a warp, such as stereo pairs, light fields and blending, and its growth with threads and noise."""

from __future__ import annotations

import functools
import itertools
import json
import os
from collections.abc import Iterator
from typing import Any

import numpy as np

import pyibr as ibr
from benchmarks import scenes
from benchmarks.cases import Plan
from benchmarks.launches import kernel_times
from benchmarks.results import Parameter, Record, Skip
from benchmarks.runner import Case, Work
from benchmarks.startup import child
from benchmarks.warp import opencv

Size = tuple[int, int]

BARS = {
    "threads": 1.85,
    "noise": 4.0,
    "stereo": 60.0,
    "light field": 0.6,
    "small": 0.35,
    "together": 1.3,
    "origins": 1.15,
    "classes": 1.5,
}
"""Bars.

Least values: the ratio of one thread's time to the time of two threads; stereo pairs per second. Largest values:
milliseconds of a new small image; and ratios of times. The ratios are: `resolve` on white noise to a smooth surface,
one call to single calls, several views in one picture to a picture of each (once their gains are known), and a warp
with origins, or with origins and classes, to a plain warp.
"""

THREADS = (1, 2)
SMOOTH, NOISE = "smooth surface", "white noise"
AMPLITUDES = {"connect": 1.0, "cut": 0.1}
"""Range of the noise relative to the smooth surface's, by `edges`; with more noise, `cut` would cut everywhere."""

EYES = 0.032  # metres from the middle to either eye
STEREO = {"connected": "connect", "cut": "cut"}
LIGHT_FIELD_WIDTH = 0.24  # metres from the first camera to the last
ONE_CALL, SINGLE = "one call", "single warps"
TOGETHER_STEP = 0.002  # metres between neighbouring views
TOGETHER = "in one picture"
TOGETHER_HELD = 6  # up to this many views, all layers are kept, so no view is drawn twice
FRESH, KEPT = "fresh", "kept"
PLAIN = "plain"
TOLD: dict[str, opencv.Options] = {PLAIN: {}, "origins": {"origins": True}, "classes": {"classes": True}}
RELIEF = "relief, forward"
TOLD_MOTIONS: dict[str, int | None] = {"0 to 50": 50, "0 to 4": 4, "7 cm sideways": None}
SHELF_MOTIONS: dict[str, int | None] = {"shelf, 31 to 61": 61, "shelf, 7 cm sideways": None}
_SMALL_STEP = 0.07  # metres
_POCL = "Portable Computing Language"


def cases(plan: Plan, scene: str) -> Iterator[Case]:
    """Yield the cases of each use."""

    def case(what: str, size: Size, **more: Parameter) -> dict[str, Parameter]:
        return {"case": what, "scene": scene, "size": scenes.shown(size), **more}

    for (size, noise), repeats in plan.rgbd_threads.items():
        parameters = case("threads", size, noise=noise)
        yield Case(parameters, functools.partial(_threads, parameters, scene, size, repeats))
    for size, repeats in plan.rgbd_white.items():
        for edges in AMPLITUDES:
            parameters: dict[str, Parameter] = {"case": "white noise", "size": scenes.shown(size), "edges": edges}
            yield Case(parameters, functools.partial(_white_noise, parameters, size, repeats))
    for (size, noise), repeats in plan.rgbd_stereo.items():
        yield Case(case("stereo", size, noise=noise), functools.partial(_stereo, scene, size, noise, repeats))
    for (side, views), repeats in plan.rgbd_light_field.items():
        for kind in (FRESH, KEPT):
            prepare = functools.partial(_light_field, scene, side, views, repeats, kind)
            yield Case(case("light field", (side, side), views=views, view=kind), prepare)
    for (size, views), repeats in plan.rgbd_together.items():
        for kind in (FRESH, KEPT):
            prepare = functools.partial(_together, scene, size, views, repeats, kind)
            yield Case(case("together", size, views=views, view=kind), prepare)
    for size, repeats in plan.rgbd_told.items():
        for motion, kind in itertools.product((*TOLD_MOTIONS, *SHELF_MOTIONS, RELIEF), (FRESH, KEPT)):
            prepare = functools.partial(_told, scene, size, repeats, motion, kind)
            yield Case(case("told", size, motion=motion, view=kind), prepare)
    for side, repeats in plan.rgbd_small.items():
        yield Case(case("small", (side, side)), functools.partial(_small, scene, side, repeats))


def _threads(parameters: dict[str, Parameter], scene: str, size: Size, repeats: int) -> Work | Skip:
    """Time kernels in processes of one and of two threads, in turns; each thread is pinned to a processor."""
    from pyibr.opencl.device import explain

    if (platform := explain()[0].platform) != _POCL:
        return Skip("threads", f"only PoCL takes a number of threads, and the device is {platform}'s")
    if (os.cpu_count() or 1) < max(THREADS):
        return Skip("threads", "there is one processor")
    if isinstance(view := scenes.rgbd(scene, 0, size), Skip):
        return view

    def read() -> Iterator[Record]:
        times: dict[tuple[int, str], list[float]] = {}
        arguments = [json.dumps(value) for value in (scene, *size, parameters["noise"])]
        for _ in range(repeats):
            for count in THREADS:
                names = ("POCL_MAX_PTHREAD_COUNT", "POCL_CPU_MAX_CU_COUNT")
                chosen = {"POCL_AFFINITY": "1", **{name: str(count) for name in names}}
                found = child("kernels", *arguments, settings=chosen)
                if found["threads"] != count:
                    raise RuntimeError(f"threads: expected {count}, PoCL has started {found['threads']}")
                for kernel, values in found["kernels_ms"].items():
                    times.setdefault((count, kernel), []).extend(values)
        for (count, kernel), values in times.items():
            yield Record(kernel, "kernel", "ms", {**parameters, "threads": count}, values)

    return Work(read=read)


def _white_noise(parameters: dict[str, Parameter], size: Size, repeats: int) -> Work:
    """Time `resolve` where almost every line's hit differs from the pixel's hit, and where almost none does."""
    edges: Any = parameters["edges"]
    width, height = size
    color, depth = np.ascontiguousarray(scenes.relief(width)[0][:height]), _without_steps(width)[:height]
    noise = np.random.default_rng(width).random(depth.shape, np.float32) - np.float32(0.5)
    noise *= np.float32(AMPLITUDES[edges]) * np.ptp(depth)
    rough = noise + (depth.mean() if edges == "connect" else depth)
    source = ibr.Camera(scenes.source_camera(width).K, size)
    target = source.moved(*-scenes.translation(width, "F", "forward"))
    surfaces = {SMOOTH: np.ascontiguousarray(depth), NOISE: np.ascontiguousarray(rough, np.float32)}

    def read() -> Iterator[Record]:
        times: dict[str, list[float]] = {name: [] for name in surfaces}
        covered: dict[str, float] = {}
        for turn in range(repeats + 1):
            for name, surface in surfaces.items():
                with kernel_times() as launches:
                    frame = ibr.warp(ibr.DepthImage(color, surface, source), target, edges=edges)
                covered[name] = float(frame.valid.mean())
                if turn:
                    times[name] += launches["resolve"]
        for name, values in times.items():
            yield Record(name, "resolve", "ms", parameters, values)
            yield Record(name, "coverage", "share", parameters, [covered[name]])

    return Work(read=read)


def _without_steps(n: int) -> Any:
    """Depth (n, n) float32 of the relief without its box and its disc."""
    x = np.linspace(-1, 1, n, dtype=np.float32)
    a, b = x[None, :], x[:, None]
    return 4 + np.float32(0.6) * np.sin(2.3 * a + 0.5) * np.cos(2.9 * b)


def _stereo(scene: str, size: Size, noise: float, repeats: int) -> Work | Skip:
    view = scenes.rgbd(scene, 0, size, noise)
    if isinstance(view, Skip):
        return view
    color, depth, camera = view.color, view.depth, view.camera
    eyes = [camera.moved(x, 0, 0) for x in (-EYES, EYES)]

    def pair(edges: Any) -> object:
        return ibr.warp(ibr.DepthImage(color, depth, camera), eyes, edges=edges, fill="background")

    return Work({name: functools.partial(pair, edges) for name, edges in STEREO.items()}, repeats)


def _light_field(scene: str, side: int, views: int, repeats: int, kind: str) -> Work | Skip:
    found = scenes.rgbd(scene, 0, (side, side))
    if isinstance(found, Skip):
        return found
    kept, color, depth, camera = found, found.color, found.depth, found.camera
    cameras = [camera.moved(float(x), 0, 0) for x in np.linspace(-0.5, 0.5, views) * LIGHT_FIELD_WIDTH]

    def view() -> ibr.DepthImage:
        return ibr.DepthImage(color, depth, camera) if kind == FRESH else kept

    def one_call() -> object:
        return ibr.warp(view(), cameras)

    def single() -> object:
        return [ibr.warp(view(), camera) for camera in cameras]

    return Work({ONE_CALL: one_call, SINGLE: single}, repeats)


def _together(scene: str, size: Size, count: int, repeats: int, kind: str) -> Work | Skip:
    """Time blending views to one picture, which matches their exposures, against a picture of each view."""
    found = scenes.rgbd(scene, 0, size)
    if isinstance(found, Skip):
        return found
    color, depth, camera = found.color, found.depth, found.camera
    cameras = [camera.moved(TOGETHER_STEP * number, 0, 0) for number in range(count)]
    target = camera.moved(0.5 * TOGETHER_STEP * count, 0.02, 0)

    def views() -> list[ibr.DepthImage]:
        return [ibr.DepthImage(color, depth, one) for one in cameras]

    kept = views()

    def together() -> object:
        return ibr.warp(views() if kind == FRESH else kept, target)

    def single() -> object:
        return [ibr.warp(view, target) for view in (views() if kind == FRESH else kept)]

    return Work({TOGETHER: together, SINGLE: single}, repeats)


def _told(scene: str, size: Size, repeats: int, motion: str, kind: str) -> Work | Skip:
    """Time warps with the origins of pixels, and with origins and classes, against a plain warp."""
    if motion == RELIEF:
        width, height = size
        color, depth = (np.ascontiguousarray(part[:height]) for part in scenes.relief(width))
        view = ibr.DepthImage(color, depth, ibr.Camera(scenes.source_camera(width).K, size))
        target = view.camera.moved(*-scenes.translation(width, "F", "forward"))
    else:
        shelf, to = motion in SHELF_MOTIONS, {**TOLD_MOTIONS, **SHELF_MOTIONS}[motion]
        view = scenes.shelf(31, size) if shelf else scenes.rgbd(scene, 0, size)
        if isinstance(view, Skip):
            return view
        there = view if to is None else scenes.shelf(to, size) if shelf else scenes.rgbd(scene, to, size)
        if isinstance(there, Skip):
            return there
        target = view.camera.moved(_SMALL_STEP, 0, 0) if to is None else there.camera
    color, depth, camera = view.color, view.depth, view.camera
    kept = ibr.DepthImage(color, depth, camera)

    def draw(options: opencv.Options) -> object:
        return ibr.warp(ibr.DepthImage(color, depth, camera) if kind == FRESH else kept, target, **options)

    return Work({name: functools.partial(draw, options) for name, options in TOLD.items()}, repeats)


def _small(scene: str, side: int, repeats: int) -> Work | Skip:
    view = scenes.rgbd(scene, 0, (side, side))
    if isinstance(view, Skip):
        return view
    kept, color, depth, camera = view, view.color, view.depth, view.camera
    target = camera.moved(_SMALL_STEP, 0, 0)

    def fresh() -> object:
        return ibr.warp(ibr.DepthImage(color, depth, camera), target, edges="cut")

    return Work({FRESH: fresh, KEPT: lambda: ibr.warp(kept, target, edges="cut")}, repeats)
