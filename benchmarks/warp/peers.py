"""Times warps of pyibr, OpenCV and Open3D from NumPy arrays to NumPy arrays, with the epipole in each of nine regions.

The surface is cut between the relief and the parts raised above it (`edges="cut"`), for Open3D's rays, too. OpenCV
moves single samples.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks import scenes
from benchmarks.cases import Plan
from benchmarks.results import Parameter, Record
from benchmarks.runner import Case, Subject, Work
from benchmarks.warp import opencv
from benchmarks.warp.opencv import Task

Array = NDArray[Any]

CUT_RATIO = 1.05  # neighbours with a greater ratio of depths are cut apart
NEAREST, LINEAR = "pyibr nearest", "pyibr linear"
OURS: dict[str, opencv.Options] = {NEAREST: {"interpolation": "nearest"}, LINEAR: {"interpolation": "linear"}}
OPEN3D_BUILD, OPEN3D_CAST = "Open3D build", "Open3D cast"

BARS = {
    (NEAREST, 1024): 0.55,
    (LINEAR, 1024): 0.65,
    **{(subject, n): 0.35 for subject in OURS for n in (2048, 4096)},
}
"""Greatest ratio of a subject's time to cv2.warpFrame's (the median over the positions), by subject and size."""

REMAP_BAR, REMAP_FROM = 1.7, 1024
"""Greatest ratio of pyibr's time to cv2.remap's (the median over the positions), and the least size it applies to."""


def cases(plan: Plan) -> Iterator[Case]:
    """One case per size and position."""
    for n, repeats in plan.peers.items():
        for region, motion in plan.peers_positions:
            prepare = functools.partial(_prepare, n, region, motion, repeats, n <= plan.open3d_largest)
            yield Case({"size": n, "region": region, "motion": motion}, prepare)


def _prepare(n: int, region: str, motion: str, repeats: int, open3d: bool) -> Work:
    color, depth = _relief(n)
    task = Task(color, depth, scenes.source_camera(n), scenes.target_camera(n, region, motion))
    subjects: dict[str, Subject] = {name: functools.partial(task.ours, **options) for name, options in OURS.items()}
    subjects |= opencv.subjects(task)
    if open3d:
        subjects |= _open3d(task)
    parameters: dict[str, Parameter] = {"size": n, "region": region, "motion": motion}

    def read() -> Iterator[Record]:
        yield from opencv.kernels(task, OURS, parameters)
        yield from opencv.sameness(task, NEAREST, OURS[NEAREST], parameters)

    return Work(subjects, repeats, read)


@functools.lru_cache(maxsize=1)
def _relief(n: int) -> tuple[Array, Array]:
    return scenes.relief(n)


def _open3d(task: Task) -> dict[str, Subject]:
    """Make Open3D's subjects: one builds the surface, the other casts rays at a surface that is already built."""
    o3d: Any = import_module("open3d")

    height, width = task.depth.shape
    index = np.arange(height * width, dtype=np.uint32).reshape(height, width)
    corners = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    upper_left, upper_right, lower_left, lower_right = (corner.ravel() for corner in corners)
    faces = np.concatenate(
        [
            np.stack([upper_left, upper_right, lower_left], 1),
            np.stack([lower_right, lower_left, upper_right], 1),
        ]
    )
    corner_depths = task.depth.ravel()[faces]
    faces = faces[corner_depths.max(axis=1) <= CUT_RATIO * corner_depths.min(axis=1)]
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    toward = (np.stack([x, y, np.ones_like(x)], -1) @ np.linalg.inv(task.source.K).T).astype(np.float32)
    center = -task.target_from_source[:3, 3].astype(np.float32)
    rays = np.concatenate([np.broadcast_to(center, toward.shape), toward], -1)

    def build() -> Any:
        scene = o3d.t.geometry.RaycastingScene()
        scene.add_triangles((toward * task.depth[..., None]).reshape(-1, 3), faces)
        scene.cast_rays(rays[0, :1])  # the first cast builds the tree
        return scene

    scene = build()
    return {OPEN3D_BUILD: build, OPEN3D_CAST: lambda: scene.cast_rays(rays)["t_hit"].numpy()}
