"""Real calibrations: an Azure Kinect's depth seen by its colour camera, compared with cast rays and a photograph."""

from __future__ import annotations

import json
from functools import cache

import cv2
import numpy as np
import pytest

import pyibr as ibr
from tests import truth
from tests.data import shared

pytestmark = pytest.mark.thorough

pytest.importorskip("open3d")


@cache
def kinect(depth_lens: bool = True, color_lens: bool = True) -> tuple[ibr.DepthImage, ibr.Camera, np.ndarray]:
    """The depth camera's view, coloured by its infrared image, the colour camera, and that camera's photograph."""
    folder = shared("formats") / "azure_kinect_raw"
    calibration = json.loads((folder / "calibration.json").read_text())
    depth = ibr.depth_from_uint16(cv2.imread(str(folder / "depth.png"), cv2.IMREAD_UNCHANGED), 1000)
    infrared = cv2.imread(str(folder / "ir.png"), cv2.IMREAD_UNCHANGED)
    logarithm = (np.log1p(infrared.astype(np.float32)) / np.log(2**16)).astype(np.float32)  # light falls off by 1 / z^2
    modes = ("NFOV_UNBINNED", depth_lens), ("720P", color_lens)
    here, there = (ibr.Camera.from_azure_kinect(calibration, mode) for mode, _ in modes)
    here, there = (
        ibr.Camera(each.K, each.size, each.world_from_camera, lens=each.lens if lens else None)
        for each, (_, lens) in zip((here, there), modes, strict=True)
    )
    photograph = cv2.imread(str(folder / "color.jpg"), cv2.IMREAD_GRAYSCALE)
    return ibr.DepthImage(np.repeat(logarithm[..., None], 3, 2), depth, here), there, photograph


def test_depth_in_the_colour_camera_is_what_its_rays_meet():
    view, camera, _ = kinect()
    small = camera.resized((640, 360))
    seen, frame = truth.raycast(view, small, "cut"), ibr.warp(view, small)
    interior = seen.interior(4)
    assert interior.mean() > 0.1
    right = frame.valid & np.isclose(frame.depth, seen.depth, rtol=3e-3)  # noise of at least 2 mm per metre
    assert right[interior].mean() > 0.99
    right = frame.valid & np.isclose(frame.depth, seen.depth, rtol=1e-3)
    assert right[interior].mean() > 0.9
    assert (~frame.valid & seen.interior(2))[2:-2, 2:-2].mean() < 1e-3


def test_the_mapping_is_opencvs():
    """Pixel positions agree with OpenCV's within 0.01, for both cameras' factory parameters from the file."""
    view, camera, _ = kinect()
    calibration = json.loads((shared("formats") / "azure_kinect_raw" / "calibration.json").read_text())
    entries = calibration["CalibrationInformation"]["Cameras"]
    pixels = np.argwhere(view.valid)[::97, ::-1].astype(np.float64)
    points = view.camera.unproject(pixels, view.depth[view.valid][::97])
    modes = ((1024, 1024), (192, 180)), ((1280, 960), (0, 120))  # whole image's size, mode's origin in it
    seen = pixels, camera.project(points)[0]
    for entry, (whole, crop), expected in zip(entries, modes, seen, strict=True):
        cx, cy, fx, fy, k1, k2, k3, k4, k5, k6, _, _, p2, p1 = entry["Intrinsics"]["ModelParameters"]
        K = np.array([[fx * whole[0], 0, cx * whole[0] - crop[0] - 0.5], [0, fy * whole[1], 0], [0, 0, 1]])
        K[1, 2] = cy * whole[1] - crop[1] - 0.5
        rotation = cv2.Rodrigues(np.array(entry["Rt"]["Rotation"], np.float64).reshape(3, 3))[0]
        lens = np.array([k1, k2, p1, p2, k3, k4, k5, k6])
        theirs = cv2.projectPoints(points, rotation, np.array(entry["Rt"]["Translation"], np.float64), K, lens)[0][:, 0]
        np.testing.assert_allclose(expected, theirs, atol=0.01)


def slopes(image: np.ndarray) -> np.ndarray:
    return np.hypot(*np.gradient(cv2.GaussianBlur(image.astype(np.float64), (0, 0), 1)))


def alike(depth_lens: bool = True, color_lens: bool = True) -> float:
    """Correlation between the gradients of two images: logarithmic infrared, and the colours registered to its pixels.

    Both images are blurred by a pixel. Pixels within 3 pixels of one without colour do not count.
    """
    view, camera, photograph = kinect(depth_lens, color_lens)
    found = ibr.register_color(view.depth, view.camera, camera, np.repeat(photograph[..., None], 3, 2))
    inside = cv2.erode(found.seen.astype(np.uint8), np.ones((7, 7))).astype(bool)
    return float(np.corrcoef(slopes(view.color[..., 0])[inside], slopes(found.color[..., 0])[inside])[0, 1])


def test_lenses_bring_both_cameras_pictures_together():
    both = alike()
    assert both > 0.36  # OpenCV reaches 0.36, with colours looked up where it projects the samples
    assert both > alike(color_lens=False) + 0.05
    assert both > alike(depth_lens=False) + 0.05
