"""Times warps of a depth camera's frames against OpenCV; then the uses of such warps in `rgbd_uses`.

Times run from NumPy arrays to NumPy arrays, with a new `DepthImage` for each call. The frames show a rendered living
room, with exact poses; noise like a structured-light camera's is added (`scenes.rgbd`).
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

import pyibr as ibr
from benchmarks import scenes
from benchmarks.cases import Plan
from benchmarks.results import Parameter, Record, Skip
from benchmarks.runner import Case, Subject, Work
from benchmarks.warp import opencv, rgbd_uses, steady
from benchmarks.warp.opencv import Task

Array = NDArray[Any]
Size = tuple[int, int]

LINEAR, NEAREST, CONNECTED = "pyibr linear", "pyibr nearest", "pyibr linear, connected"
OURS: dict[str, opencv.Options] = {
    LINEAR: {"edges": "cut"},
    NEAREST: {"edges": "cut", "interpolation": "nearest"},
    CONNECTED: {"edges": "connect"},
}

POSES, SIDEWAYS = "from pose to pose", "7 cm sideways"
MOTIONS: dict[str, dict[str, tuple[int, int | None]]] = {
    POSES: {"0 to 50": (0, 50), "50 to 0": (50, 0), "0 to 4": (0, 4)},
    SIDEWAYS: {"from 0": (0, None), "from 50": (50, None)},
}
"""By kind and name: the frame that is warped, and the frame whose camera is the target."""

ASIDE = 0.07  # metres

BARS = {
    (POSES, "640 x 480", 0.0): 0.8,
    (POSES, "640 x 480", 0.1): 1.0,
    (POSES, "640 x 480", 0.3): 1.2,
    (POSES, "1920 x 1440", 0.0): 0.5,
    (POSES, "1920 x 1440", 0.1): 0.75,
    (POSES, "1920 x 1440", 0.3): 1.1,
    **{(SIDEWAYS, size, noise): 0.6 for size in ("640 x 480", "1920 x 1440") for noise in (0.0, 0.1, 0.3)},
}
"""Greatest ratio of the time of `LINEAR` to cv2.warpFrame's, as a mean over motions, by their kind, size and noise."""


@dataclass(frozen=True)
class Published:
    """A figure that another program's authors published for their machine."""

    program: str
    task: str
    time: str
    machine: str
    source: str


_ALIGN = "i5-5300U, SSE4", "realsenseai/librealsense#2040"
PUBLISHED = (
    Published("librealsense, align depth to colour", "640 x 480", "4.35 ms", *_ALIGN),
    Published("librealsense, align depth to colour", "1280 x 720", "8.33 ms", *_ALIGN),
    Published("librealsense, align colour to depth", "640 x 480", "3.45 ms", *_ALIGN),
    Published("librealsense, align colour to depth", "1280 x 720", "3.29 ms", *_ALIGN),
    Published("libfreenect2, registration", "512 x 424", "about 1 ms", "not named", "OpenKinect/libfreenect2#253"),
    *(
        Published(f"RVS, {how}", "4 views of 4096 x 2048 to 2048 x 2048", time, machine, "README of EnzoN7/RVS-CUDA")
        for how, time, machine in (
            ("CPU", "12870 ms", "not named"),
            ("OpenGL", "1524 ms", "RTX A4500"),
            ("CUDA", "130 ms", "RTX A4500"),
        )
    ),
)


def cases(plan: Plan) -> Iterator[Case]:
    """Yield a case per size, noise and motion; then the uses, and a camera at rest."""
    scene, missing = scenes.standing_in(plan.rgbd_scene)
    if missing is not None:
        yield Case({"case": "warp"}, lambda: missing)
    for size, repeats in plan.rgbd.items():
        for noise in plan.rgbd_noise:
            for kind, motions in MOTIONS.items():
                for name in motions:
                    parameters: dict[str, Parameter] = {
                        "case": "warp",
                        "scene": scene,
                        "size": scenes.shown(size),
                        "noise": noise,
                        "kind": kind,
                        "motion": name,
                    }
                    ours = [subject for subject in OURS if subject != CONNECTED or size in plan.rgbd_connected]
                    yield Case(parameters, functools.partial(_prepare, parameters, size, ours, repeats))
    yield from rgbd_uses.cases(plan, scene)
    yield from steady.cases(plan, scene)


def _prepare(parameters: dict[str, Parameter], size: Size, ours: list[str], repeats: int) -> Work | Skip:
    scene, kind, name, noise = (parameters[key] for key in ("scene", "kind", "motion", "noise"))
    made = _task(str(scene), MOTIONS[str(kind)][str(name)], size, float(noise))
    if isinstance(made, Skip):
        return made
    task, chosen = made, {subject: OURS[subject] for subject in ours}
    subjects: dict[str, Subject] = {name: functools.partial(task.ours, **options) for name, options in chosen.items()}

    def read() -> Iterator[Record]:
        yield from opencv.kernels(task, chosen, parameters)
        yield from opencv.sameness(task, NEAREST, OURS[NEAREST], parameters)

    return Work({**subjects, **opencv.subjects(task)}, repeats, read)


def _task(scene: str, motion: tuple[int, int | None], size: Size, noise: float) -> Task | Skip:
    source, target = motion
    view = scenes.rgbd(scene, source, size, noise)
    if isinstance(view, Skip):
        return view
    aside = view.camera.moved(ASIDE, 0, 0)
    camera = aside if target is None else scenes.depth_camera(scene, target, size)
    return Task(view.color, view.depth, view.camera, camera, OURS[LINEAR])


def kernel_work(scene: str, size: Size, noise: float) -> ibr.Frame | Skip:
    """Make the warp whose kernels are timed with one and two threads."""
    task = _task(scene, MOTIONS[POSES]["0 to 50"], size, noise)
    return task if isinstance(task, Skip) else task.ours(**OURS[LINEAR])
