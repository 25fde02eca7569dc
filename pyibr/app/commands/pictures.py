"""Small pictures, one for each common way of drawing: drawing them all builds their kernels."""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np

import pyibr as ibr

_SIZE = (40, 30)


@functools.cache
def _view(step: float = 0.0) -> ibr.DepthImage:
    """A box in front of a wall, seen from `step` scene units to the right."""
    width, height = _SIZE
    camera = ibr.Camera([[width, 0, width / 2], [0, width, height / 2], [0, 0, 1]], _SIZE).moved(step, 0, 0)
    depth = np.full((height, width), 4.0, np.float32)
    depth[8:20, 10:24] = 3.0
    return ibr.DepthImage(np.zeros((height, width, 3), np.uint8), depth, camera)


def _aside() -> ibr.Camera:
    return _view().camera.moved(0.2, 0, 0)


def _beyond() -> ibr.Camera:
    return _view().camera.moved(0.2, 0.1, 0.2)


@functools.cache
def _square() -> ibr.Mesh:
    corners = np.array([[-1, -1, 4], [1, -1, 4], [1, 1, 4], [-1, 1, 4]], np.float32)
    uv = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float32)
    return ibr.Mesh(corners, np.array([[0, 2, 1], [0, 3, 2]]), uv=uv, texture=np.zeros((4, 4, 3), np.uint8))


def _plain() -> ibr.Mesh:
    return ibr.Mesh(_square().vertices, _square().faces)


def _heights() -> np.ndarray:
    return np.full((8, 8), 0.5, np.float32)


def _colors() -> np.ndarray:
    return np.zeros((8, 8, 3), np.uint8)


PICTURES: tuple[Callable[[], object], ...] = (
    lambda: ibr.warp(_view(), _beyond()),
    lambda: ibr.warp(_view(), _aside(), fill="background"),
    lambda: ibr.warp(_view(), _beyond(), edges="connect"),
    lambda: ibr.warp(_view(), _aside(), edges="connect"),
    lambda: ibr.warp(_view(), _beyond(), classes=True),
    lambda: ibr.warp([_view(), _view(0.3)], _beyond()),
    lambda: ibr.warp(_view(), _beyond(), fill="smooth", samples=4),
    lambda: ibr.render(_view(), _beyond()),
    lambda: ibr.clean_depth(_view().depth, np.zeros((*_SIZE[::-1], 3), np.uint8)),
    lambda: ibr.render([_square(), _plain()], _beyond()),
    lambda: ibr.render(_square(), _beyond(), ibr.Light(direction=(0, 0, 1))),
    lambda: ibr.render([_view(), _square()], _beyond(), ibr.Light(direction=(0, 0, 1))),
    lambda: ibr.render(ibr.SlicedSurface(_square(), _heights(), _colors(), scale=0.1), _beyond()),
    lambda: ibr.render(ibr.ReliefSurface(_square(), _heights(), _colors(), scale=0.1), _beyond()),
    lambda: ibr.render(ibr.DepthObject([_view(), _view(0.3)]), _beyond()),
    lambda: ibr.render(ibr.DepthMesh(_view()), _beyond()),
    lambda: ibr.render(ibr.DepthMeshObject([_view(), _view(0.3)]), _beyond()),
)
