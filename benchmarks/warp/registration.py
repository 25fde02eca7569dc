"""Registration beside OpenCV's: depth of a depth camera in the image of a colour camera, and colours for its samples.

From NumPy arrays to NumPy arrays, in turns in one process.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

import pyibr as ibr
from benchmarks import scenes
from benchmarks.cases import Plan
from benchmarks.results import Parameter, Record, Skip
from benchmarks.runner import Case, Subject, Work
from benchmarks.warp.opencv import REGISTER
from pyibr.core.optional import opencv

Size = tuple[int, int]

REGISTERED, MILLIMETRES, COLORS = "ibr.register", "ibr.register, uint16", "ibr.register_color"
DILATED = "cv2.registerDepth, dilated"

BARS = {"640 x 480": 1.0, "1280 x 720": 0.6}
"""At most this ratio of `REGISTERED` to cv2.registerDepth, by size."""

ASIDE = 0.025  # metres
TURN = 0.5  # degrees
ZOOM = 0.95  # of the depth camera's focal length
SCALE = 1000.0  # counts of a uint16 a metre


def cases(plan: Plan) -> Iterator[Case]:
    """One case a size and noise."""
    scene, missing = scenes.standing_in(plan.rgbd_scene)
    if missing is not None:
        yield Case({"case": "registration"}, lambda: missing)
    for size, repeats in plan.registration.items():
        for noise in plan.rgbd_noise:
            parameters: dict[str, Parameter] = {"scene": scene, "size": scenes.shown(size), "noise": noise}
            yield Case(parameters, functools.partial(_prepare, parameters, scene, size, noise, repeats))


def color_camera(depth_camera: ibr.Camera) -> ibr.Camera:
    """Beside the depth camera, turned a little, and of a somewhat wider view."""
    turn = np.radians(TURN)
    pose = depth_camera.world_from_camera @ np.array(
        [[np.cos(turn), 0, np.sin(turn), ASIDE], [0, 1, 0, 0], [-np.sin(turn), 0, np.cos(turn), 0], [0, 0, 0, 1]]
    )
    K = depth_camera.K.copy()
    K[[0, 1], [0, 1]] *= ZOOM
    return ibr.Camera(K, depth_camera.size, pose)


def _prepare(parameters: dict[str, Parameter], scene: str, size: Size, noise: float, repeats: int) -> Work | Skip:
    cv2 = opencv("the benchmark of registration", "registerDepth")
    view = scenes.rgbd(scene, 0, size, noise)
    if isinstance(view, Skip):
        return view
    here, there, depth = view.camera, color_camera(view.camera), view.depth
    counts = ibr.uint16_from_depth(depth, SCALE)
    color: Any = view.color  # any picture is as good
    Rt, undistorted = there.camera_from_world @ here.world_from_camera, np.zeros(5)

    def peer(dilation: bool = False) -> NDArray[Any]:
        return cv2.registerDepth(here.K, there.K, undistorted, Rt, depth, there.size, depthDilation=dilation)

    subjects: dict[str, Subject] = {
        REGISTERED: lambda: ibr.register(depth, here, there),
        MILLIMETRES: lambda: ibr.register(counts, here, there, depth_scale=SCALE),
        COLORS: lambda: ibr.register_color(depth, here, there, color),
        REGISTER: peer,
        DILATED: lambda: peer(dilation=True),
    }

    def read() -> Iterator[Record]:
        ours = ibr.register(depth, here, there)
        for name, found in ((REGISTERED, ours), (REGISTER, peer()), (DILATED, peer(dilation=True))):
            seen = np.isfinite(found) & (found > 0)
            both = seen & np.isfinite(ours) & (ours > 0)
            yield Record(name, "coverage", "share", parameters, [float(seen.mean())])
            off = np.median(np.abs(found[both] / ours[both] - 1))
            yield Record(name, "median depth difference", "share", parameters, [float(off)])

    return Work(subjects, repeats, read)
