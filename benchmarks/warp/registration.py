"""Times registration against OpenCV: depth for the pixels of a colour camera, and colours for a depth camera's samples.

Times run from NumPy arrays to NumPy arrays, in turns in one process.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Iterator
from dataclasses import dataclass
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


@dataclass(frozen=True)
class Rig:
    """A colour camera next to a depth camera.

    Attributes
    ----------
    zoom : float
        Ratio of the colour camera's focal length to the depth camera's.
    aside : float
        Distance between the cameras in metres.
    turn : float
        Angle between the cameras in degrees.
    """

    zoom: float
    aside: float
    turn: float


RIGS = {"wide": Rig(0.95, 0.025, 0.5), "narrow": Rig(0.95 / 0.8, 0.05, 1.0)}
"""Rigs whose colour camera has a wider or a narrower view than the depth camera; most commercial rigs are narrow."""

BARS = {
    ("wide", "640 x 480"): 1.0,
    ("wide", "1280 x 720"): 0.6,
    ("narrow", "640 x 480"): 1.2,
    ("narrow", "1280 x 720"): 0.7,
}
"""Largest ratio of the time of `REGISTERED` to that of cv2.registerDepth, by rig and size."""

SCALE = 1000.0  # steps of uint16 depth per metre


def cases(plan: Plan) -> Iterator[Case]:
    """One case per size, rig and noise."""
    scene, missing = scenes.standing_in(plan.rgbd_scene)
    if missing is not None:
        yield Case({"case": "registration"}, lambda: missing)
    # Sizes grow: after larger arrays were freed, OpenCV would reuse their pages for smaller ones, and be faster.
    for (size, repeats), rig, noise in itertools.product(plan.registration.items(), RIGS, plan.rgbd_noise):
        parameters: dict[str, Parameter] = {"scene": scene, "rig": rig, "size": scenes.shown(size), "noise": noise}
        yield Case(parameters, functools.partial(_prepare, parameters, scene, RIGS[rig], size, noise, repeats))


def color_camera(depth_camera: ibr.Camera, rig: Rig) -> ibr.Camera:
    """The rig's colour camera, beside the depth camera and turned a little."""
    turn = np.radians(rig.turn)
    pose = depth_camera.world_from_camera @ np.array(
        [[np.cos(turn), 0, np.sin(turn), rig.aside], [0, 1, 0, 0], [-np.sin(turn), 0, np.cos(turn), 0], [0, 0, 0, 1]]
    )
    K = depth_camera.K.copy()
    K[[0, 1], [0, 1]] *= rig.zoom
    return ibr.Camera(K, depth_camera.size, pose)


def _prepare(
    parameters: dict[str, Parameter], scene: str, rig: Rig, size: Size, noise: float, repeats: int
) -> Work | Skip:
    cv2 = opencv("the benchmark of registration", "registerDepth")
    view = scenes.rgbd(scene, 0, size, noise)
    if isinstance(view, Skip):
        return view
    here, there, depth = view.camera, color_camera(view.camera, rig), view.depth
    counts = ibr.uint16_from_depth(depth, SCALE)
    color: Any = view.color  # its contents do not matter
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
