"""Tiny inputs for `pyibr warp` ("make"), and whether its picture is right ("check")."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import imageio.v3 as iio
import numpy as np

WIDTH, HEIGHT = 40, 30
SHIFT = 4  # pixels: the plane is at depth 2, the focal length 40 and the camera moves by 0.2


def make() -> None:
    color = np.random.default_rng(0).integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    iio.imwrite("color.png", color)
    np.save("depth.npy", np.full((HEIGHT, WIDTH), 2.0, np.float32))
    camera = {"width": WIDTH, "height": HEIGHT, "K": [[40, 0, 19.5], [0, 40, 14.5], [0, 0, 1]]}
    Path("camera.json").write_text(json.dumps(camera))
    pose = np.eye(4)
    pose[0, 3] = 0.2
    Path("moved.json").write_text(json.dumps(camera | {"world_from_camera": pose.tolist()}))


def check() -> None:
    color, out = iio.imread("color.png"), iio.imread("out.png")
    if out.shape != (HEIGHT, WIDTH, 3):
        sys.exit(f"out.png has shape {out.shape}, expected {(HEIGHT, WIDTH, 3)}")
    error = np.abs(out[1:-1, 1 : -SHIFT - 1].astype(int) - color[1:-1, SHIFT + 1 : -1])
    if error.max() > 2:
        sys.exit(f"out.png is not the picture moved by {SHIFT} pixels: it is off by up to {error.max()}")


if __name__ == "__main__":
    {"make": make, "check": check}[sys.argv[1]]()
