"""Times features by number of channels, and batches of tensors beside the splat that video models share."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

import pyibr as ibr
from benchmarks import scenes
from benchmarks.cases import Plan, Size
from benchmarks.results import Parameter, Skip
from benchmarks.runner import Case, Work

OURS, COPY, SPLAT = "ibr.warp", "copy", "splat in PyTorch"
ONE_CALL, GRADIENT = "ibr.torch.warp", "with gradient"
WIDE_BAR, MOST_BAR = 2.0, 1.3
"""Most times 16 channels over 3, and the most channels over a copy of the same bytes."""
FEATURES: dict[str, tuple[int, Any]] = {
    "3 of float32": (3, np.float32),
    "16 of float32": (16, np.float32),
    "1024 of float16": (1024, np.float16),
}
FRAMES = 121


def cases(plan: Plan) -> Iterator[Case]:
    """Yield a case for each number of channels, and a path in one call."""
    for size, repeats in plan.tensors.items():
        for name in FEATURES:
            parameters: dict[str, Parameter] = {"case": "features", "size": scenes.shown(size), "features": name}
            yield Case(parameters, functools.partial(_features, name, size, repeats))
    for size, repeats in plan.tensors_path.items():
        yield Case({"case": "path", "size": scenes.shown(size)}, functools.partial(_path, size, repeats))


def _scene(size: Size) -> tuple[NDArray[np.float32], ibr.Camera]:
    """Depth of a wavy wall with a disk in front of it, and its camera."""
    (width, height), (x, y) = size, np.meshgrid(np.arange(size[0]), np.arange(size[1]))
    depth = 3 + 1.2 * np.sin(12 * x / width) * np.cos(12 * y / height)
    depth -= 1.3 * (np.hypot(x - width / 2, y - height / 2) < 0.2 * height)
    return depth.astype(np.float32), ibr.Camera(
        [[0.9 * width, 0, width / 2], [0, 0.9 * width, height / 2], [0, 0, 1]], size
    )


def _features(name: str, size: Size, repeats: int) -> Work:
    (depth, camera), (channels, dtype) = _scene(size), FEATURES[name]
    values = np.random.default_rng(0).random((*depth.shape, channels), np.float32).astype(dtype)
    view, target = ibr.DepthImage(None, depth, camera, features=values), camera.moved(0.1, 0.05, 0.1)
    return Work({OURS: lambda: ibr.warp(view, target), COPY: values.copy}, repeats)


def _path(size: Size, repeats: int) -> Work | Skip:
    """Time a path in one call, a frame with its gradient, and a frame of the splat."""
    try:
        torch: Any = import_module("torch")
    except ImportError:
        return Skip(SPLAT, "PyTorch is not installed")
    depth, camera = _scene(size)
    values = torch.rand(1, 3, *depth.shape) * 2 - 1
    path = [camera.moved(0.15 * step / FRAMES, 0.02, 0.1 * step / FRAMES) for step in range(1, FRAMES + 1)]

    def with_gradient() -> None:
        leaf = values.clone().requires_grad_(True)
        ibr.torch.warp(leaf, depth[None], camera, path[-1]).values.sum().backward()

    splat = functools.partial(splatted, torch, values, torch.from_dlpack(depth.copy()), camera, path[-1])
    whole = functools.partial(ibr.torch.warp, values, depth[None], camera, path)
    return Work({ONE_CALL: whole, GRADIENT: with_gradient, SPLAT: splat}, repeats)


def splatted(torch: Any, values: Any, depth: Any, camera: ibr.Camera, target: ibr.Camera) -> tuple[Any, Any]:
    """Splat (1, C, H, W) values bilinearly, weighted by exp(-50 log(1 + z) / greatest log): values and weights."""
    height, width = depth.shape
    y, x = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    motion = target.camera_from_world @ camera.world_from_camera
    rays = torch.tensor(target.K @ motion[:3, :3] @ np.linalg.inv(camera.K), dtype=torch.float32)
    origin = torch.tensor(target.K @ motion[:3, 3], dtype=torch.float32)
    u, v, z = (rays @ torch.stack([x, y, torch.ones_like(x)]).float().reshape(3, -1)) * depth.reshape(-1) + origin[
        :, None
    ]
    places, logs = torch.stack([u / z, v / z]), torch.log1p(z)
    first, strength = torch.floor(places), torch.exp(-50 * logs / logs.max())
    room = torch.zeros(height + 2, width + 2, values.shape[1] + 1)
    full = torch.cat([values[0].reshape(values.shape[1], -1), torch.ones(1, height * width)]).T
    for dx, dy in ((0, 0), (1, 0), (0, 1), (1, 1)):
        at = first + torch.tensor([[dx], [dy]])
        weight = strength * (1 - (places - at).abs()).prod(dim=0)
        column, row = (at[0].clamp(-1, width) + 1).long(), (at[1].clamp(-1, height) + 1).long()
        room.index_put_((row, column), full * weight[:, None], accumulate=True)
    shown = room[1:-1, 1:-1].permute(2, 0, 1)
    return shown[:-1] / shown[-1].clamp(min=1e-30), shown[-1]
