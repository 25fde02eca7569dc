"""Checks an installed wheel, in the environments that installs.py makes.

"make" writes tiny inputs for `pyibr warp`, and "check" judges its picture. "bare", "beside" and "all" test the rest, in
the environment of the same name.
"""

from __future__ import annotations

import json
import sys
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

import pyibr as ibr

WIDTH, HEIGHT = 40, 30
SHIFT = 4  # pixels: focal length 40, times a camera motion of 0.2, divided by the plane's depth of 2
K = [[40, 0, 19.5], [0, 40, 14.5], [0, 0, 1]]


def make() -> None:
    color = np.random.default_rng(0).integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    Image.fromarray(color).save("color.png")
    np.save("depth.npy", np.full((HEIGHT, WIDTH), 2.0, np.float32))
    camera = {"width": WIDTH, "height": HEIGHT, "K": K}
    Path("camera.json").write_text(json.dumps(camera))
    pose = np.eye(4)
    pose[0, 3] = 0.2
    Path("moved.json").write_text(json.dumps(camera | {"world_from_camera": pose.tolist()}))


def check() -> None:
    color, out = np.asarray(Image.open("color.png")), np.asarray(Image.open("out.png"))
    if out.shape != (HEIGHT, WIDTH, 3):
        sys.exit(f"out.png has shape {out.shape}, expected {(HEIGHT, WIDTH, 3)}")
    error = np.abs(out[1:-1, 1 : -SHIFT - 1].astype(int) - color[1:-1, SHIFT + 1 : -1])
    if error.max() > 2:
        sys.exit(f"out.png is not the picture moved by {SHIFT} pixels: it is off by up to {error.max()}")
    text = str(metadata.metadata("pyibr-opencl").get_payload())
    if "](docs/" in text or "](LICENSE" in text:
        sys.exit("the description for package indexes has links that lead nowhere there")


def bare() -> None:
    """Check that meshes are captured and frusta proposed, and that errors name missing packages."""
    capture()
    propose()
    for call, extra in ((inpaint, "opencv"), (to_open3d, "open3d"), (exr, "exr")):
        try:
            call()
        except ibr.MissingPackageError as error:
            if f"pip install 'pyibr-opencl[{extra}]'" in str(error):
                continue
            sys.exit(f"the error does not name the extra {extra}: {error}")
        sys.exit(f"{call.__name__} works without the extra {extra}")


def beside() -> None:
    """Check that pyibr uses the OpenCV that was installed before, which still has its windows."""
    import cv2

    inpaint()
    lines = [line.split(":", 1) for line in cv2.getBuildInformation().splitlines() if line.strip().startswith("GUI:")]
    if not lines or lines[0][1].strip() in ("", "NONE"):
        sys.exit(f"this OpenCV has lost its windows: {lines}")
    owners = [d for d in metadata.distributions() if d.metadata["Name"].startswith("opencv-")]
    if len(owners) != 1:
        sys.exit(f"there are {len(owners)} OpenCV packages, expected one")


def every() -> None:
    """Check every extra, and Intel's runtime for CPUs from PyPI."""
    inpaint()
    capture()
    to_open3d()
    exr()
    if not any(device.works for device in ibr.devices() if "intel" in device.platform.lower()):
        sys.exit(f"Intel's runtime does not work: {ibr.devices()}")


def inpaint() -> None:
    camera = ibr.Camera(K, (WIDTH, HEIGHT))
    ibr.warp(ibr.DepthImage(None, np.full((HEIGHT, WIDTH), 2, np.float32), camera), camera, fill="inpaint")


def capture() -> None:
    from pyibr.capture import MeshScene

    scene = MeshScene([[-9, -9, 1], [9, -9, 1], [0, 9, 1]], [[0, 1, 2]])
    if not scene.capture(ibr.Camera(K, (WIDTH, HEIGHT))).valid.any():
        sys.exit("a captured view is empty")


def propose() -> None:
    from pyibr.capture import models
    from pyibr.capture.proposal import propose_frusta

    if len(propose_frusta(models.donut(), 2, 32)) != 2:
        sys.exit("proposing two frusta for a donut gave another number")


def to_open3d() -> None:
    ibr.Mesh([[-9, -9, 1], [9, -9, 1], [0, 9, 1]], [[0, 1, 2]]).to_open3d()


def exr() -> None:
    ibr.write_depth("depth.exr", np.full((HEIGHT, WIDTH), 2, np.float32))
    if (ibr.read_depth("depth.exr") != 2).any():
        sys.exit("depth.exr does not contain the written depth")


if __name__ == "__main__":
    actions: dict[str, Any] = {"make": make, "check": check, "bare": bare, "beside": beside, "all": every}
    actions[sys.argv[1]]()
