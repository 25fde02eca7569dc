"""Middlebury's stereo pairs since 2014, and ETH3D's, which share the layout."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from pyibr.io.layouts.parts import camera_of, values_in
from pyibr.io.recordings import Recording, Stored, size_of

_DISPARITY = ("disp{}.pfm", "disp{}GT.pfm", "disp{}.npy", "disp{}-n.pgm")


def find_middlebury(folder: Path) -> Recording | None:
    """Find im0.png, disp0.pfm (maybe also the other view) and calib.txt: disparity in pixels, baseline in mm."""
    calibration = folder / "calib.txt"
    views = [number for number in (0, 1) if (folder / f"im{number}.png").is_file() and _disparity(folder, number)]
    if not views or not calibration.is_file():
        return None
    lines = values_in(calibration, "=")
    told = {name: [float(n) for n in re.findall(r"[-+.\deE]+", value)] for name, value in lines.items() if value}
    offset, baseline = told.get("doffs", [0.0])[0], told["baseline"][0] / 1000
    matrices = [np.reshape(told[f"cam{number}"], (3, 3)) for number in views]
    images = [folder / f"im{number}.png" for number in views]
    cameras = [camera_of(calibration, K, size_of(image)) for K, image in zip(matrices, images, strict=True)]
    steps = [np.diag([1.0, 1.0, 1.0, 1.0]) for _ in views]
    for number, step in zip(views, steps, strict=True):
        step[0, 3] = number * baseline
    return Recording(
        images,
        [path for number in views if (path := _disparity(folder, number))],
        known=lambda: cameras,
        placed=steps,
        stored=[Stored(float(camera.K[0, 0]) * baseline, "inverse", offset) for camera in cameras],
        is_still=True,
    )


def _disparity(folder: Path, number: int) -> Path | None:
    return next((path for form in _DISPARITY if (path := folder / form.format(number)).is_file()), None)
