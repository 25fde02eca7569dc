"""Calls that are measured on every CPU runtime, from NumPy arrays to NumPy arrays."""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np

import pyibr as ibr
from benchmarks.cases import Size
from benchmarks.results import Skip
from benchmarks.scenes import ROOM, bricks, rgbd
from pyibr.capture import models, object_views

Call = Callable[[], object]

_NOISE = 0.3  # pixels of disparity


def _warp(size: Size, noise: float = 0.0, *, sideways: bool = False) -> Call | Skip:
    view = rgbd(ROOM, 0, size, noise)
    if isinstance(view, Skip):
        return view
    camera = view.camera.moved(0.1, 0, 0) if sideways else view.camera.moved(0.1, 0.05, 0.1)
    return lambda: ibr.warp(view, camera)


def _filled(size: Size) -> Call | Skip:
    view = rgbd(ROOM, 0, size, _NOISE)
    if isinstance(view, Skip):
        return view
    camera = view.camera.moved(0.1, 0.05, 0.1)
    return lambda: ibr.warp(view, camera, fill="background")


def _cleaned(size: Size) -> Call | Skip:
    view = rgbd(ROOM, 0, size, _NOISE)
    return view if isinstance(view, Skip) else lambda: ibr.clean_depth(view.depth, view.color)


def _around(n: int) -> ibr.Camera:
    return ibr.Camera.look_at((1.7, -2.8, 2.2), (0, 0, 0), (0, 0, 1), (n, n), fov_y=45)


def _relief(_: Size, *, lit: bool = False) -> Call:
    height, color = bricks()
    thing = ibr.ReliefSurface(models.donut(48), height, color, 0.05, tiles=(10, 4))
    light = ibr.Light(direction=(-1, 1, -1)) if lit else None
    return lambda: ibr.render(thing, _around(512), light)


def _slices(_: Size) -> Call:
    fur = (np.random.default_rng(1).random((64, 64)) ** 3).astype(np.float32)
    color = np.repeat((60 + 190 * fur[..., None]).astype(np.uint8), 3, axis=2)
    thing = ibr.SlicedSurface(models.donut(), fur, color, 0.15, tiles=(8, 4), slices=20)
    return lambda: ibr.render(thing, _around(512))


def _of_views(make: Callable[[list[ibr.DepthImage]], ibr.Drawable]) -> Callable[[Size], Call]:
    def prepare(_: Size) -> Call:
        thing = make(object_views(models.donut(48), 256))
        return lambda: ibr.render(thing, _around(300))

    return prepare


def _mesh(_: Size) -> Call:
    thing = models.donut(150)
    return lambda: ibr.render(thing, _around(512))


SIZED: dict[str, Callable[[Size], Call | Skip]] = {
    "warp": _warp,
    "warp, 0.3 px of noise": functools.partial(_warp, noise=_NOISE),
    "warp sideways": functools.partial(_warp, sideways=True),
    "warp, filled": _filled,
    "cleaning": _cleaned,
}
"""Rows that are measured at several image sizes."""
ROWS: dict[str, Callable[[Size], Call | Skip]] = {
    **SIZED,
    "relief": _relief,
    "relief with light and shadow": functools.partial(_relief, lit=True),
    "slices": _slices,
    "depth object": _of_views(lambda views: ibr.DepthObject(views, slices=128)),
    "visual hull": _of_views(lambda views: ibr.VisualHull(views, slices=128)),
    "depth-mesh object": _of_views(ibr.DepthMeshObject),
    "mesh of 45,000 triangles": _mesh,
}
