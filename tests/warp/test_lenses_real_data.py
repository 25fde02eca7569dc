"""Real calibrations: an Azure Kinect's depth in its colour camera, against ray casting and against the photograph."""

from __future__ import annotations

import json
from functools import cache

import cv2
import numpy as np
import pytest

import pyibr as ibr
from tests import truth
from tests.data import shared

pytest.importorskip("open3d")


def camera_of(
    entry: dict, sensor: tuple[int, int], crop: tuple[int, int], size: tuple[int, int], lens=True
) -> ibr.Camera:
    """From the factory's numbers, which are parts of the sensor's size."""
    cx, cy, fx, fy, k1, k2, k3, k4, k5, k6, _, _, p2, p1 = entry["Intrinsics"]["ModelParameters"]
    K = [
        [fx * sensor[0], 0, cx * sensor[0] - crop[0] - 0.5],
        [0, fy * sensor[1], cy * sensor[1] - crop[1] - 0.5],
        [0, 0, 1],
    ]
    radius = entry["MetricRadius"] or np.inf
    bends = ibr.Lens("rational", [k1, k2, p1, p2, k3, k4, k5, k6], radius)
    from_depth = np.eye(4)
    from_depth[:3, :3] = np.reshape(entry["Rt"]["Rotation"], (3, 3))
    from_depth[:3, 3] = entry["Rt"]["Translation"]
    return ibr.Camera(K, size, np.linalg.inv(from_depth), lens=bends if lens else None)


@cache
def kinect(depth_lens: bool = True, color_lens: bool = True) -> tuple[ibr.DepthImage, ibr.Camera, np.ndarray]:
    """The infrared image with its depth, the colour camera, and what it saw."""
    folder = shared("formats") / "azure_kinect_raw"
    calibration = json.loads((folder / "calibration.json").read_text())["CalibrationInformation"]["Cameras"]
    depth = ibr.depth_from_uint16(cv2.imread(str(folder / "depth.png"), cv2.IMREAD_UNCHANGED), 1000)
    infrared = cv2.imread(str(folder / "ir.png"), cv2.IMREAD_UNCHANGED)
    gray = np.clip(np.sqrt(infrared.astype(np.float64)) * 6, 0, 255).astype(np.uint8)
    here = camera_of(calibration[0], (1024, 1024), (192, 180), depth.shape[::-1], depth_lens)
    there = camera_of(calibration[1], (1280, 960), (0, 120), (1280, 720), color_lens)
    photograph = cv2.imread(str(folder / "color.jpg"), cv2.IMREAD_GRAYSCALE)
    return ibr.DepthImage(np.repeat(gray[..., None], 3, 2), depth, here), there, photograph


def test_depth_in_the_colour_camera_is_what_its_rays_meet():
    view, camera, _ = kinect()
    small = camera.resized((640, 360))
    seen, frame = truth.raycast(view, small, "cut"), ibr.warp(view, small)
    interior = seen.interior(4)
    assert interior.mean() > 0.1
    right = frame.valid & np.isclose(frame.depth, seen.depth, rtol=3e-3)  # real noise: 2 mm or more of a metre
    assert right[interior].mean() > 0.99
    right = frame.valid & np.isclose(frame.depth, seen.depth, rtol=1e-3)
    assert right[interior].mean() > 0.9
    assert (~frame.valid & seen.interior(2))[2:-2, 2:-2].mean() < 1e-3


def alike(depth_lens: bool, color_lens: bool) -> float:
    """Correlation of the gradients of the infrared image, seen from the colour camera, with the photograph's."""
    view, camera, photograph = kinect(depth_lens, color_lens)
    frame = ibr.warp(view, camera)
    blurred = [cv2.GaussianBlur(image, (0, 0), 2).astype(np.float64) for image in (frame.color[..., 0], photograph)]
    slopes = [np.hypot(*np.gradient(image)) for image in blurred]
    inside = cv2.erode(frame.valid.astype(np.uint8), np.ones((15, 15))).astype(bool)
    return float(np.corrcoef(slopes[0][inside], slopes[1][inside])[0, 1])


def test_lenses_bring_both_cameras_pictures_together():
    both = alike(True, True)
    assert both > 0.25
    assert both > alike(True, False) + 0.05
    assert both > alike(False, True) + 0.05
