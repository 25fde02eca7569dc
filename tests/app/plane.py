"""A picture with depth of a plane, in files, for tests of commands."""

from __future__ import annotations

import numpy as np

import pyibr as ibr
from tests.app.commands import run

SIZE = (61, 37)


class Scene:
    """Files with a picture, depth and camera of a plane at depth 2, in the working directory."""

    def __init__(self) -> None:
        self.camera = ibr.Camera([[50, 0, 30], [0, 50, 18], [0, 0, 1]], SIZE)
        rng = np.random.default_rng(0)
        self.color = rng.integers(0, 256, (SIZE[1], SIZE[0], 3), dtype=np.uint8)
        self.depth = np.full((SIZE[1], SIZE[0]), 2, np.float32)
        self.camera.save("camera.json")
        ibr.write_color("color.png", self.color)
        ibr.write_depth("depth.png", self.depth, depth_scale=1000)
        ibr.write_depth("depth.npy", self.depth)

    def run(self, *arguments: object, depth="depth.png", scale="1000", camera="camera.json", command="warp"):
        return run(command, "color.png", depth, *arguments, camera=camera, scale=scale)
