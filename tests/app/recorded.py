"""A short recording in files, for tests of commands."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import pyibr as ibr
from tests.app.commands import run

SIZE = (62, 38)
COUNT = 4
SCALE = 1000


class Recorded:
    """Files in the working directory: a box before a wall, and a camera that moves right by 2 cm per frame."""

    def __init__(self) -> None:
        self.base = ibr.Camera([[50, 0, 30], [0, 50, 18], [0, 0, 1]], SIZE)
        self.cameras = [self.base.moved(0.02 * number, 0, 0) for number in range(COUNT)]
        rng = np.random.default_rng(0)
        self.colors = [rng.integers(0, 256, (*SIZE[::-1], 3), dtype=np.uint8) for _ in range(COUNT)]
        self.depths: list[np.ndarray] = []
        for number in range(COUNT):
            depth = np.full(SIZE[::-1], 2, np.float32) + rng.integers(-9, 10, SIZE[::-1]).astype(np.float32) / SCALE
            depth[10:25, 20 - number : 40 - number] = 1
            depth[rng.random(depth.shape) < 0.05] = np.nan
            self.depths.append(depth)
            ibr.write_color(f"rgb/{number}.png", self.colors[number])
            ibr.write_depth(f"depth/{number}.png", depth, depth_scale=SCALE)
            self.cameras[number].save(f"cameras/{number}.json")
        self.base.save("camera.json")
        rows = [" ".join(map(str, camera.world_from_camera[:3].ravel())) for camera in self.cameras]
        Path("poses.txt").write_text("\n".join(rows))

    def depth(self, number: int) -> np.ndarray:
        return ibr.read_depth(f"depth/{number}.png", depth_scale=SCALE)

    def views(self, but: int | None = None) -> list[ibr.DepthImage]:
        """The views of all frames, or of all except one."""
        read = [number for number in range(COUNT) if number != but]
        return [ibr.DepthImage(self.colors[k], self.depth(k), self.cameras[k]) for k in read]

    def run(self, *words: object, camera: object = "camera.json", output: object = "new.png"):
        return run("warp", *words, camera=camera, scale=SCALE, output=output)

    def new(self, number: int) -> np.ndarray:
        return ibr.read_color(f"new_{number:04d}.png")

    def shows(self, frame: ibr.Frame, number: int | None = None) -> None:
        """Assert that the new picture, or the one with this number, is the frame's."""
        shown = ibr.read_color("new.png") if number is None else self.new(number)
        np.testing.assert_array_equal(shown, frame.color)
