"""Times a small warp and a small relief, to choose among several CPU runtimes."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from pyibr.core.camera import Camera
from pyibr.images.depth_image import DepthImage
from pyibr.meshes.mesh import Mesh
from pyibr.opencl.device import use_device
from pyibr.opencl.runtimes import found_devices
from pyibr.picture.render import render
from pyibr.relief.surface import ReliefSurface
from pyibr.warp.warp import warp

_TURNS = 30


def main(key: str) -> None:
    """Print the seconds that the pictures take on the device with this key, without warm-up."""
    (index,) = (found.index for found in found_devices() if found.key == key)
    with use_device(index):
        print("\n" + repr(sum(_seconds(draw) for draw in (_warp(), _relief()))))


def _seconds(draw: Callable[[], object]) -> float:
    """The least of several timings, as other programs may run meanwhile."""
    draw()
    times: list[float] = []
    for _ in range(_TURNS):
        start = time.perf_counter()
        draw()
        times.append(time.perf_counter() - start)
    return min(times)


def _warp() -> Callable[[], object]:
    """A disk before a wall, with noise."""
    width, height = 640, 480
    random = np.random.default_rng(1)
    y, x = np.mgrid[:height, :width]
    depth = np.where(np.hypot(x - width / 2, y - height / 2) < height / 4, 2.0, 4.0)
    depth += 0.005 * depth * random.standard_normal(depth.shape)
    color = random.integers(256, size=(height, width, 3), dtype=np.uint8)
    camera = Camera([[width, 0, width / 2], [0, width, height / 2], [0, 0, 1]], (width, height))
    view = DepthImage(color, depth.astype(np.float32), camera)
    return lambda: warp(view, camera.moved(0.1, 0.05, 0.1))


def _relief() -> Callable[[], object]:
    """A plate from an oblique view."""
    random = np.random.default_rng(1)
    heights = random.random((64, 64), dtype=np.float32)
    color = random.integers(256, size=(64, 64, 3), dtype=np.uint8)
    corners = [[0, 0], [1, 0], [1, 1], [0, 1]]
    plate = Mesh([[x, y, 0] for x, y in corners], [[0, 1, 2], [0, 2, 3]], uv=corners)
    thing = ReliefSurface(plate, heights, color, 0.1)
    camera = Camera.look_at((0.7, -0.8, 0.7), (0.5, 0.5, 0), (0, 0, 1), (400, 400), fov_y=60)
    return lambda: render(thing, camera)
