"""The pyibr calls for which `benchmarks.gpu.gpu` counts launches and instructions, for any picture size.

Views are kept, so that a second call works like a second frame.
"""

from __future__ import annotations

import functools
from collections.abc import Callable

import pyibr as ibr
from benchmarks.cases import Size
from benchmarks.results import Skip
from benchmarks.scenes import bricks, relief, scanned
from benchmarks.warp.registration import RIGS, color_camera
from pyibr.capture import models, object_views
from pyibr.warp.filling import Fill

Work = Callable[[], object]


def _view(size: Size) -> ibr.DepthImage:
    """A view of the relief; its middle rows, if the size is not square."""
    width, height = size
    top = (width - height) // 2
    color, depth = (array[top : top + height].copy() for array in relief(width))
    K = [[0.6 * width, 0, (width - 1) / 2], [0, 0.6 * width, (height - 1) / 2], [0, 0, 1]]
    return ibr.DepthImage(color, depth, ibr.Camera(K, size))


def _warp(size: Size, fill: Fill | None = None, step: tuple[float, float, float] = (0.2, 0.1, 0.2)) -> Work:
    view = _view(size)
    return lambda: ibr.warp(view, view.camera.moved(*step), fill=fill)


def _blended(size: Size) -> Work:
    """Blend four views, each twice as wide as the picture."""
    width, height = size
    first = _view((2 * width, height))
    cameras = [first.camera.moved(x, y, 0) for x in (-0.2, 0.2) for y in (-0.1, 0.1)]
    frames = ibr.warp(first, cameras)
    views = [ibr.DepthImage(frame.color, frame.depth, frame.camera) for frame in frames]
    K = first.camera.K.copy()
    K[0, 2] = (width - 1) / 2
    target = ibr.Camera(K, size).moved(0.05, 0.02, 0.05)
    return lambda: ibr.warp(views, target)


def _registered(size: Size) -> Work:
    view = _view(size)
    there = color_camera(view.camera, RIGS["narrow"])
    return lambda: ibr.register(view.depth, view.camera, there)


def _around(size: Size) -> ibr.Camera:
    return ibr.Camera.look_at((1.7, -2.8, 2.2), (0, 0, 0), (0, 0, 1), size, fov_y=45)


def _relief(size: Size) -> Work:
    height, color = bricks()
    thing = ibr.ReliefSurface(models.donut(48), height, color, 0.05, tiles=(10, 4))
    return lambda: ibr.render(thing, _around(size))


def _solid(size: Size, kind: type[ibr.DepthObject] | type[ibr.VisualHull]) -> Work:
    thing = kind(object_views(models.donut(48), size[0] // 2), slices=128)
    return lambda: ibr.render(thing, _around(size))


def _depth_mesh(size: Size) -> Work:
    view = _view(size)
    thing = ibr.DepthMesh(view)
    return lambda: ibr.render(thing, view.camera.moved(0.2, 0.1, 0.2))


def _dragon(size: Size) -> Work | Skip:
    """A dragon of 871,414 triangles, or 47,794 for small sizes: at 240 x 240, as many per pixel as at 1024 x 1024."""
    mesh = scanned("dragon_vrip.ply.gz" if size[0] > 500 else "dragon_vrip_res3.ply.gz")
    if isinstance(mesh, Skip):
        return mesh
    low, high = mesh.bounds
    middle = (low + high) / 2
    camera = ibr.Camera.look_at(middle + (high - low) * (0.5, 0.35, 2.0), middle, (0, 1, 0), size, fov_y=42)
    return lambda: ibr.render(mesh, camera)


CALLS: dict[str, Callable[[Size], Work | Skip]] = {
    "warp": _warp,
    "warp, filled from behind": functools.partial(_warp, fill="background"),
    "warp sideways": functools.partial(_warp, step=(0.2, 0.0, 0.0)),
    "four views": _blended,
    "registration": _registered,
    "relief": _relief,
    "depth object": functools.partial(_solid, kind=ibr.DepthObject),
    "visual hull": functools.partial(_solid, kind=ibr.VisualHull),
    "depth mesh": _depth_mesh,
    "dragon": _dragon,
}
