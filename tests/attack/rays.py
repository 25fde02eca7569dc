"""Compares random warps with rays cast in float64: each pixel must show the first hit of its ray.

`python -m tests.attack rays --first 0 --count 1000` runs them.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import pyibr as ibr
from tests import scenes, truth
from tests.attack.law import BrokenLawError

Array = NDArray[Any]

HAIR = 2e-3  # target pixels: this close to an end of the surface, rounding decides whether a ray hits it
DEPTH_OFF = 1e-3  # relative: float32 rounds a dozen operations, and steep surfaces may be shifted by HAIR
OFF = {"search": 0.002, "epipolar": 0.006}  # share of pixels: lines miss some at thin parts and noise


@dataclass(frozen=True)
class RandomWarp:
    """A view, a target, and the options that the warp and the rays share."""

    view: ibr.DepthImage
    camera: ibr.Camera
    options: dict[str, Any]


def random_case(seed: int) -> RandomWarp:
    """A random case: waves, boxes before them, holes, single samples and noise; any target, rotated and zoomed."""
    rng = np.random.default_rng(seed)
    size = int(rng.integers(1, 60)), int(rng.integers(1, 48))
    own, there = (str(rng.choice(["perspective", "perspective", "orthographic"])) for _ in range(2))
    a, b = scenes.image_coordinates(size)
    depth = 4 + rng.uniform(0, 0.5) * np.sin(rng.uniform(1, 5) * a + 1) * np.cos(rng.uniform(1, 5) * b)
    for _ in range(int(rng.integers(0, 4))):
        x, y, w, h = rng.uniform(-1, 1, 2).tolist() + rng.uniform(0.02, 0.6, 2).tolist()
        depth[(np.abs(a - x) < w) & (np.abs(b - y) < h)] = rng.uniform(1.5, 5)
    if rng.random() < 0.3:
        depth[rng.random(depth.shape) < rng.uniform(0, 0.2)] = np.nan
    if rng.random() < 0.3:
        depth[rng.random(depth.shape) < 0.03] *= 0.8
    if rng.random() < 0.2:
        depth += rng.normal(0, 0.01, depth.shape)
    f = size[0] * rng.uniform(0.5, 2) if own == "perspective" else size[0] * rng.uniform(0.15, 0.4)
    K = [[f, 0, (size[0] - 1) / 2 + rng.uniform(-2, 2)], [0, f * rng.uniform(0.9, 1.1), (size[1] - 1) / 2], [0, 0, 1]]
    source = ibr.Camera(K, size, scenes.pose(*rng.uniform(-40, 40, 3), center=rng.uniform(-1, 1, 3)), projection=own)
    view = ibr.DepthImage(scenes.texture(a, b), depth.astype(np.float32), source)
    if not view.valid.any():
        return random_case(seed + 1_000_000_007)
    target_size = int(rng.integers(1, 60)), int(rng.integers(1, 48))
    zoom = rng.choice([0.3, 1, 1, 1, 4, 20]) * target_size[0] / size[0]
    near = f if own == there else (f * 4 if own == "orthographic" else f / 4)
    center = rng.choice([0, 0, 1], 3) * rng.uniform(-0.8, 0.8, 3) if rng.random() < 0.5 else rng.uniform(-0.8, 0.8, 3)
    turned = rng.uniform(-25, 25, 3) if rng.random() < 0.6 else np.zeros(3)
    moved = source.world_from_camera @ scenes.pose(*turned, center=tuple(center))
    K = [[near * zoom, 0, target_size[0] / 2], [0, near * zoom, target_size[1] / 2], [0, 0, 1]]
    options: dict[str, Any] = {"method": str(rng.choice(["epipolar", "search"]))}
    options["edges"] = str(rng.choice(["cut", "cut", "connect"]))
    options["side"] = str(rng.choice(["front", "front", "back", "both"]))
    if options["edges"] == "cut" and rng.random() < 0.3:
        options["cut_ratio"] = float(rng.uniform(1.01, 1.2))
    return RandomWarp(view, ibr.Camera(K, target_size, moved, projection=there), options)


def judge_rays(seed: int) -> str:
    """Compare a random warp with rays. Returns "sound", or raises BrokenLawError."""
    case = random_case(seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # targets may see nothing
        frame = ibr.warp(case.view, case.camera, **case.options)
    surface = truth.Surface(case.view, case.options["edges"], case.options.get("cut_ratio"))
    seen = surface.cast(case.camera, case.options["side"])
    off = _off(frame, seen)
    for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1)) if off.any() else ():
        beside = scenes.moved_aside(case.camera, HAIR * dx, HAIR * dy)
        off &= _off(frame, surface.cast(beside, case.options["side"]))
    allowed = 2 + OFF[case.options["method"]] * off.size  # 2 more, for pictures of few pixels
    if off.sum() > allowed:
        raise BrokenLawError(f"{off.sum()} of {off.size} pixels differ from their rays' first hits ({case.options})")
    return "sound"


def _off(frame: ibr.Frame, seen: truth.Truth) -> Array:
    """(H, W) True where pixels differ from the hits of their rays."""
    with np.errstate(invalid="ignore"):
        same = np.abs(frame.depth - seen.depth) <= DEPTH_OFF * np.abs(seen.depth)
    return (frame.valid != seen.valid) | (frame.valid & seen.valid & ~same)
