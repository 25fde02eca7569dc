"""pyibr beside OpenCV and Open3D, from NumPy arrays to NumPy arrays, over the epipole's nine regions.

The surface is open between the relief and what is raised above it (`edges="cut"`), for Open3D's rays, too. OpenCV
carries samples alone.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

import pyibr as ibr
from benchmarks import scenes
from benchmarks.cases import Plan
from benchmarks.launches import kernel_times
from benchmarks.results import Record
from benchmarks.runner import Case, Subject, Work

Array = NDArray[Any]

CUT_RATIO = 1.05  # of neighbours' depths: beyond it they are no one surface
NEAREST, LINEAR = "pyibr nearest", "pyibr linear"
BASE = "cv2.warpFrame"
OURS: dict[str, Any] = {NEAREST: "nearest", LINEAR: "linear"}
OPEN3D_BUILD, OPEN3D_CAST = "Open3D build", "Open3D cast"
KERNEL_RUNS = 3

BARS = {(NEAREST, 1024): 0.5, (NEAREST, 2048): 0.4, (LINEAR, 1024): 0.8, (LINEAR, 2048): 0.6}
"""At most this part of the time of `BASE`, by subject and size: the median over the positions."""


@dataclass(frozen=True)
class Task:
    """One warp: the same arrays and cameras for everybody."""

    color: Array
    depth: Array
    source: ibr.Camera
    target: ibr.Camera

    def ours(self, sample: Any) -> ibr.Frame:
        view = ibr.DepthImage(self.color, self.depth, self.source)
        return ibr.warp(view, self.target, sample=sample, edges="cut", cut_ratio=CUT_RATIO)

    @functools.cached_property
    def target_from_source(self) -> Array:
        return self.target.camera_from_world @ self.source.world_from_camera


def cases(plan: Plan) -> Iterator[Case]:
    """One case a size and position."""
    for n, repeats in plan.peers.items():
        for region, motion in plan.peers_positions:
            prepare = functools.partial(_prepare, n, region, motion, repeats, n <= plan.open3d_largest)
            yield Case({"size": n, "region": region, "motion": motion}, prepare)


def _prepare(n: int, region: str, motion: str, repeats: int, open3d: bool) -> Work:
    color, depth = _relief(n)
    task = Task(color, depth, scenes.source_camera(n), scenes.target_camera(n, region, motion))
    subjects = {name: functools.partial(task.ours, sample) for name, sample in OURS.items()}
    subjects |= _opencv(task)
    if open3d:
        subjects |= _open3d(task)
    parameters = {"size": n, "region": region, "motion": motion}
    return Work(subjects, repeats, lambda: [*_kernels(task, parameters), *_sameness(task, parameters)])


@functools.lru_cache(maxsize=1)
def _relief(n: int) -> tuple[Array, Array]:
    return scenes.relief(n)


def _opencv(task: Task) -> dict[str, Subject]:
    import cv2

    mask = np.full(task.depth.shape, 255, np.uint8)
    K, Rt, undistorted = task.source.K, task.target_from_source, np.zeros(5)
    across, down = _source_positions(task)

    def remap() -> object:
        return [cv2.remap(image, across, down, cv2.INTER_LINEAR) for image in (task.color, task.depth)]

    return {
        BASE: lambda: cv2.warpFrame(task.depth, task.color, mask, Rt, K),
        "cv2.registerDepth": lambda: cv2.registerDepth(K, K, undistorted, Rt, task.depth, task.target.size),
        "cv2.remap": remap,
    }


def _source_positions(task: Task) -> tuple[Array, Array]:
    """float32 (H, W) x and y in the source of what each target pixel sees; -1 where it sees nothing."""
    frame = task.ours("linear")
    x, y = np.meshgrid(*(np.arange(size, dtype=np.float32) for size in task.target.size))
    z = np.where(frame.valid, frame.depth, 1.0).astype(np.float32)
    # The cameras share K and differ by a translation t: K (X - t) = z pixel - K t.
    u, v, w = (task.source.K @ -task.target_from_source[:3, 3]).astype(np.float32)
    nowhere = np.float32(-1)
    across = np.where(frame.valid, (x * z + u) / (z + w), nowhere)
    down = np.where(frame.valid, (y * z + v) / (z + w), nowhere)
    return across, down


def _open3d(task: Task) -> dict[str, Subject]:
    """Rays against the same surface, depth only. The scene is built anew each turn, the rays are not."""
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
        scene.cast_rays(rays[0, :1])  # the tree is made at the first cast
        return scene

    scene = build()
    return {OPEN3D_BUILD: build, OPEN3D_CAST: lambda: scene.cast_rays(rays)["t_hit"].numpy()}


def _kernels(task: Task, parameters: dict[str, Any]) -> Iterator[Record]:
    """What the kernels alone take."""
    for name, sample in OURS.items():
        totals: list[float] = []
        for _ in range(KERNEL_RUNS):
            with kernel_times() as times:
                task.ours(sample)
            totals.append(sum(map(sum, times.values())))
        yield Record(name, "kernels", "ms", parameters, totals)


def _sameness(task: Task, parameters: dict[str, Any]) -> Iterator[Record]:
    """How much of the target each covers, and that both mean the same warp."""
    import cv2

    mask = np.full(task.depth.shape, 255, np.uint8)
    depth, _, seen = cv2.warpFrame(task.depth, task.color, mask, task.target_from_source, task.source.K)
    frame = task.ours("nearest")
    both = frame.valid & (seen > 0)
    difference = float(np.median(np.abs(depth[both] / frame.depth[both] - 1)))
    yield Record(NEAREST, "coverage", "share", parameters, [float(frame.valid.mean())])
    yield Record(BASE, "coverage", "share", parameters, [float((seen > 0).mean())])
    yield Record(BASE, "median depth difference", "share", parameters, [difference])
