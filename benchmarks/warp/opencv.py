"""Prepares OpenCV's functions for a warp, and compares pyibr's warps with them."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

import pyibr as ibr
from benchmarks.launches import kernel_times
from benchmarks.results import Parameter, Record
from benchmarks.runner import Subject
from pyibr.core.optional import opencv

Array = NDArray[Any]
Options = Mapping[str, Any]  # options of ibr.warp

BASE, REGISTER, REMAP = "cv2.warpFrame", "cv2.registerDepth", "cv2.remap"
KERNEL_RUNS = 3


@dataclass(frozen=True)
class Task:
    """A warp between two cameras with the same K; all subjects get its arrays and cameras.

    Attributes
    ----------
    color : (H, W, 3) uint8
    depth : (H, W) float32
        NaN for missing depth.
    source, target : Camera
    finest : dict
        Options of the pyibr frame that provides the maps of cv2.remap.
    """

    color: Array
    depth: Array
    source: ibr.Camera
    target: ibr.Camera
    finest: Options = field(default_factory=dict[str, Any])

    def ours(self, **options: Any) -> ibr.Frame:
        """Warp a new `DepthImage`."""
        return ibr.warp(ibr.DepthImage(self.color, self.depth, self.source), self.target, **options)

    @functools.cached_property
    def target_from_source(self) -> Array:
        """(4, 4) transform, as OpenCV takes it."""
        return self.target.camera_from_world @ self.source.world_from_camera

    @functools.cached_property
    def mask(self) -> Array:
        """(H, W) uint8 mask of the samples that cv2.warpFrame is to warp."""
        return np.where(np.isfinite(self.depth), np.uint8(255), np.uint8(0))


def subjects(task: Task) -> dict[str, Subject]:
    """OpenCV's functions to time. cv2.remap gets finished maps, so its time is only a lower bound."""
    cv2 = opencv("the benchmark of the warp", "warpFrame", "registerDepth")
    K, Rt, undistorted = task.source.K, task.target_from_source, np.zeros(5)
    across, down = source_positions(task)

    def remap() -> object:
        return [cv2.remap(image, across, down, cv2.INTER_LINEAR) for image in (task.color, task.depth)]

    return {
        BASE: lambda: cv2.warpFrame(task.depth, task.color, task.mask, Rt, K),
        REGISTER: lambda: cv2.registerDepth(K, K, undistorted, Rt, task.depth, task.target.size),
        REMAP: remap,
    }


def source_positions(task: Task) -> tuple[Array, Array]:
    """Float32 (H, W) x and y of the source position that each target pixel shows; -1 in holes."""
    frame = task.ours(**task.finest)
    x, y = np.meshgrid(*(np.arange(size, dtype=np.float32) for size in task.target.size))
    z = np.where(frame.valid, frame.depth, 1.0).astype(np.float32)
    source_from_target = np.linalg.inv(task.target_from_source)
    turn = (task.source.K @ source_from_target[:3, :3] @ np.linalg.inv(task.target.K)).astype(np.float32)
    shift = (task.source.K @ source_from_target[:3, 3]).astype(np.float32)
    u, v, w = ((a * x + b * y + c) * z + d for (a, b, c), d in zip(turn, shift, strict=True))
    seen = frame.valid & (w > 0)
    w = np.where(seen, w, np.float32(1))
    nowhere = np.float32(-1)
    # In the outer half of border pixels, colours are constant.
    width, height = task.source.size
    across, down = np.clip(u / w, 0, width - 1), np.clip(v / w, 0, height - 1)
    return np.where(seen, across, nowhere), np.where(seen, down, nowhere)


def kernels(task: Task, ours: Mapping[str, Options], parameters: dict[str, Parameter]) -> Iterator[Record]:
    """Measure the time of pyibr's kernels alone."""
    for name, options in ours.items():
        totals: list[float] = []
        for _ in range(KERNEL_RUNS):
            with kernel_times() as times:
                task.ours(**options)
            totals.append(sum(map(sum, times.values())))
        yield Record(name, "kernels", "ms", parameters, totals)


def sameness(task: Task, name: str, options: Options, parameters: dict[str, Parameter]) -> Iterator[Record]:
    """Measure how much of the target pyibr and cv2.warpFrame cover, and the difference of their depths."""
    cv2 = opencv("the benchmark of the warp", "warpFrame")
    depth, _, seen = cv2.warpFrame(task.depth, task.color, task.mask, task.target_from_source, task.source.K)
    frame = task.ours(**options)
    both = frame.valid & (seen > 0)
    difference = float(np.median(np.abs(depth[both] / frame.depth[both] - 1)))
    yield Record(name, "coverage", "share", parameters, [float(frame.valid.mean())])
    yield Record(BASE, "coverage", "share", parameters, [float((seen > 0).mean())])
    yield Record(BASE, "median depth difference", "share", parameters, [difference])
