"""Lens models of OpenCV, RealSense and COLMAP, both ways, the limits of their views, and cameras with lenses."""

from __future__ import annotations

import json
import math
import pickle
from pathlib import Path

import cv2
import numpy as np
import pytest

import pyibr as ibr
from tests.calibrations import kinect
from tests.core.test_camera import GOOD_K, points_before

SLIGHT = 0.01  # pixels: allowed difference from OpenCV
TOF = [0.54793978, -0.02097137, 2.0557534e-05, -7.2104158e-05, -0.00265223, 0.88967907, 0.08613021, -0.01391038]
COLOR = [0.3301211, -2.4893966, -0.00016178, -0.00012945, 1.45367086, 0.20891207, -2.3029151, 1.37512755]
# Calibrations of real cameras: lens model, coefficients, (fx, fy, cx, cy), image size
CALIBRATIONS = {
    "machine vision": ("brown_conrady", [-0.2834, 0.07396, 0.0001936, 1.76e-05], (458.7, 457.3, 367, 248), (752, 480)),
    "narrow": ("brown_conrady", [-1.04482, 1.59252, -0.0196308, 0.0287906, 0], (1168.7, 1169, 295, 252), (640, 480)),
    "time of flight": ("rational", TOF, (504.6, 504.7, 332.8, 336.8), (640, 576)),
    "color": ("rational", COLOR, (611.8, 611.9, 639.3, 366.3), (1280, 720)),
    "prism and tilt": (
        "tilted",
        [2.31, 14.9, 1e-3, -2e-3, 11.5, 2.26, 14.4, 12.6, 4e-3, -1e-3, -3e-3, 2e-3, 0.06, -0.04],
        (801.2, 800.9, 640.2, 380.1),
        (1280, 800),
    ),
    "fisheye": ("kannala_brandt", [-0.003269, 0.054053, -0.051594, 0.010749], (282, 280.7, 416, 396.7), (848, 800)),
}


TILTED = ibr.Camera(GOOD_K, (61, 37), lens=ibr.Lens("tilted", CALIBRATIONS["prism and tilt"][1]))


def lens_and_frame(name: str) -> tuple[ibr.Lens, np.ndarray, float]:
    """The lens, the distorted positions of some pixels including the corners, and the focal length in pixels."""
    model, coefficients, (fx, fy, cx, cy), (width, height) = CALIBRATIONS[name]
    x, y = np.meshgrid(np.append(np.arange(0, width, 5), width - 1), np.append(np.arange(0, height, 5), height - 1))
    return ibr.Lens(model, coefficients), np.column_stack([(x.ravel() - cx) / fx, (y.ravel() - cy) / fy]), fx


def opencvs(lens: ibr.Lens, ideal: np.ndarray) -> np.ndarray:
    """Distorted positions for undistorted (ideal) ones, by OpenCV."""
    if lens.model == "kannala_brandt":
        return cv2.fisheye.distortPoints(ideal[None], np.eye(3), lens.to_opencv())[0]
    ahead = np.column_stack([ideal, np.ones(len(ideal))])
    return cv2.projectPoints(ahead, np.zeros(3), np.zeros(3), np.eye(3), lens.to_opencv())[0][:, 0]


@pytest.mark.parametrize("name", CALIBRATIONS)
def test_lenses_are_opencvs_both_ways(name):
    lens, seen, focal = lens_and_frame(name)
    ideal = lens.undistort(seen)
    inside = np.isfinite(ideal[:, 0])
    assert inside.mean() > (0.78 if name == "fisheye" else 0.9999)  # corners are over 90 degrees off the axis
    assert np.abs(opencvs(lens, ideal[inside]) - seen[inside]).max() * focal < SLIGHT
    assert np.abs(lens.distort(ideal[inside]) - seen[inside]).max() * focal < 1e-6
    if lens.model == "kannala_brandt":
        theirs = cv2.fisheye.undistortPoints(seen[inside][None], np.eye(3), lens.to_opencv())[0]
        near = np.hypot(*ideal[inside].T) < 12  # up to 85 degrees off the axis: beyond, a pixel is a large step
        assert np.abs(theirs - ideal[inside])[near].max() * focal < SLIGHT
    else:
        coefficients = lens.to_opencv()
        theirs = cv2.undistortPoints(seen[:, None], np.eye(3), coefficients, R=None, P=None, criteria=(3, 500, 1e-12))
        assert np.abs(theirs[:, 0] - ideal)[inside].max() * focal < SLIGHT


@pytest.mark.parametrize("name", CALIBRATIONS)
def test_what_a_lens_does_not_see_is_nan(name):
    lens = lens_and_frame(name)[0]
    beyond = np.array([[lens.reach * 1.001, 0], [0, -lens.reach * 5], [np.nan, 1], [np.inf, 0]])
    assert np.isnan(lens.distort(beyond)).all()
    assert np.isnan(lens.undistort([[np.inf, 0], [np.nan, 0]])).all()


def test_beyond_the_fold_nothing_is_seen():
    """With k1 = -0.2, distorted positions grow up to an ideal distance of 1.29; farther out they would shrink again."""
    lens = ibr.Lens("brown_conrady", [-0.2, 0, 0, 0])
    assert lens.reach == pytest.approx(np.sqrt(1 / 0.6))
    farthest = lens.reach * (1 - lens.reach**2 * 0.2)
    assert np.isfinite(lens.undistort([[farthest - 1e-6, 0]])).all()
    assert np.isnan(lens.undistort([[farthest + 1e-6, 0]])).all()


def test_a_pole_ends_what_a_rational_lens_sees():
    """In a real calibration, numerator and denominator are nearly equal, and both are 0 at a place in the image."""
    k = [-4.860828876, 17.281976699, 0.000203761, 0.001025102, -25.17225075, -4.943647385, 17.514425278, -25.2907600]
    lens = ibr.Lens("rational", k)
    assert 0.6 < lens.reach < 0.68
    seen = np.column_stack([np.linspace(-0.6, 0.6, 100), np.full(100, 0.1)])
    ideal = lens.undistort(seen)
    np.testing.assert_allclose(opencvs(lens, ideal), seen, atol=1e-9)
    assert np.abs(ideal - seen).max() < 0.02


def test_a_radius_ends_what_a_lens_sees():
    lens = ibr.Lens("brown_conrady", [0.1, 0, 0, 0], radius=0.5)
    assert np.isnan(lens.distort([[0.3, 0.41], [0.3, 0.39]])[:, 0]).tolist() == [True, False]
    assert np.isnan(lens.undistort([[0.6, 0], [0.5, 0]])[:, 0]).tolist() == [True, False]
    for radius in (0, -1.0, math.nan, None, "1", np.ones((2, 2))):
        with pytest.raises(ibr.ArgumentError, match="radius: expected a distance > 0, got"):
            ibr.Lens("brown_conrady", [0.1, 0, 0, 0], radius=radius)


@pytest.mark.parametrize("model", ["brown_conrady", "modified_brown_conrady", "rational", "tilted", "kannala_brandt"])
def test_strong_tangential_parts_come_back(model):
    coefficients = [-0.2, 0.1, 0.01, -0.02, 0.03, 0.1, 0.02, 0.01, 0.02, -0.01, 0.01, 0.02, 0.2, -0.1]
    lens = ibr.Lens(model, coefficients[: {"rational": 8, "kannala_brandt": 4, "tilted": 14}.get(model, 5)])
    ideal = np.random.default_rng(0).uniform(-0.9, 0.9, (500, 2))
    np.testing.assert_allclose(lens.undistort(lens.distort(ideal)), ideal, atol=1e-10)


@pytest.mark.parametrize("model", ["inverse_brown_conrady", "modified_brown_conrady", "brown_conrady", "none"])
def test_realsense_projects_the_same_pixels(model):
    rs = pytest.importorskip("pyrealsense2")
    theirs = rs.intrinsics()
    theirs.width, theirs.height, theirs.fx, theirs.fy, theirs.ppx, theirs.ppy = 640, 480, 500, 510, 320, 240
    theirs.model, theirs.coeffs = getattr(rs.distortion, model), [-0.2, 0.1, 0.01, -0.02, 0.03]
    camera = ibr.Camera.from_realsense(theirs)
    points = points_before(camera)
    expected = [rs.rs2_project_point_to_pixel(theirs, point.tolist()) for point in points]
    np.testing.assert_allclose(camera.project(points)[0], expected, atol=1e-3)
    if model != "modified_brown_conrady":  # RealSense's library cannot invert that model
        near = np.hypot(*points[:, :2].T) < 0.5 * points[:, 2]  # farther out, its iteration does not converge
        pixels = camera.project(points[near])[0]
        back = [rs.rs2_deproject_pixel_to_point(theirs, pixel.tolist(), 2.0) for pixel in pixels]
        np.testing.assert_allclose(camera.unproject(pixels, np.full(len(pixels), 2.0)), back, atol=1e-4)


def test_realsense_worked_by_hand():
    """Numbers computed by hand as in RealSense's library, 2.59, whose inverse model equals its modified one."""
    intrinsics = {"width": 640, "height": 480, "fx": 500, "fy": 500, "ppx": 320, "ppy": 240}
    seen = {
        "brown_conrady": [506.84375, 383.2578125],
        "inverse_brown_conrady": [507.01312256, 383.38485718],
        "modified_brown_conrady": [507.01312256, 383.38485718],
        "kannala_brandt4": [498.35299683, 373.76473999],
        "none": [520, 390],
    }
    for model, pixel in seen.items():
        for name in (model, f"distortion.{model}", model.replace("_", " ").title(), f"RS2_DISTORTION_{model.upper()}"):
            given = intrinsics | {"model": name, "coeffs": [-0.2, 0.1, 0.01, -0.02, 0.03]}
            camera = ibr.Camera.from_realsense(given)
            np.testing.assert_allclose(camera.project([[0.4, 0.3, 1]])[0][0], pixel, atol=1e-4)
            np.testing.assert_allclose(camera.unproject([pixel], [1])[0], [0.4, 0.3, 1], atol=1e-6)
        assert ibr.Camera.from_realsense(camera.to_realsense()) == camera
    numbered = ibr.Camera.from_realsense(intrinsics | {"model": 4, "coeffs": [0.1, 0, 0, 0, 0]})
    assert numbered.lens.model == "brown_conrady"


COLMAP = {
    "SIMPLE_PINHOLE": [50, 30, 18],
    "PINHOLE": [50, 55, 30, 18],
    "SIMPLE_RADIAL": [50, 30, 18, 0.1],
    "RADIAL": [50, 30, 18, 0.1, -0.02],
    "OPENCV": [50, 55, 30, 18, 0.1, -0.02, 0.003, -0.004],
    "FULL_OPENCV": [50, 55, 30, 18, 0.1, -0.02, 0.003, -0.004, 0.01, 0.02, -0.03, 0.004],
    "SIMPLE_RADIAL_FISHEYE": [50, 30, 18, 0.1],
    "RADIAL_FISHEYE": [50, 30, 18, 0.1, -0.02],
    "OPENCV_FISHEYE": [50, 55, 30, 18, 0.1, -0.02, 0.003, -0.004],
}
POSE = [0.9, 0.1, -0.2, 0.3], [1, 2, 3], (61, 37)


@pytest.mark.parametrize("model", COLMAP)
def test_colmap_keeps_its_lens(model):
    params = COLMAP[model]
    camera = ibr.Camera.from_colmap(model, params, *POSE)
    points = points_before(camera)
    fx, fy, cx, cy, *k = params[:1] * model.startswith(("SIMPLE", "RADIAL")) + params  # these have one focal length
    if model.endswith("FISHEYE"):
        local = points @ camera.camera_from_world[:3, :3].T + camera.camera_from_world[:3, 3]
        u, v = local[:, 0] / local[:, 2], local[:, 1] / local[:, 2]
        r = np.hypot(u, v)
        theta = np.arctan(r)
        scale = theta * (1 + sum(one * theta ** (2 * n) for n, one in enumerate(k, 1))) / r
        expected = np.column_stack([fx * u * scale + cx, fy * v * scale + cy]) - 0.5
    else:
        _, rvec, tvec = camera.to_opencv()
        K = np.array([[fx, 0, cx - 0.5], [0, fy, cy - 0.5], [0, 0, 1]])
        expected = cv2.projectPoints(points, rvec, tvec, K, np.pad(k, (0, max(4 - len(k), 0))))[0][:, 0]
    seen = camera.project(points)[0]
    inside = np.isfinite(seen[:, 0])
    assert inside.mean() > 0.5
    np.testing.assert_allclose(seen[inside], expected[inside], atol=1e-8)
    again = ibr.Camera.from_colmap(*camera.to_colmap(), camera.size)
    np.testing.assert_allclose(again.project(points)[0][inside], expected[inside], atol=1e-8)


def test_ros_ways_to_say_one_thing():
    d, k = [-0.2, 0.05, 0.001, -0.002, 0.01], [500, 0, 320, 0, 510, 240, 0, 0, 1]

    class Message:
        width, height, distortion_model, D, K = 640, 480, "plumb_bob", d, k

    file = {"image_width": 640, "image_height": 480, "distortion_model": "plumb_bob"}
    file |= {"camera_matrix": {"rows": 3, "cols": 3, "data": k}, "distortion_coefficients": {"data": d}}
    fields = {"width": 640, "height": 480, "distortion_model": "plumb_bob", "d": np.array(d), "k": np.array(k)}
    cameras = [ibr.Camera.from_ros(info) for info in (Message(), file, fields)]
    assert cameras[0] == cameras[1] == cameras[2] == ibr.Camera.from_ros(cameras[0].to_ros())
    assert cameras[0].lens == ibr.Lens("brown_conrady", d) and cameras[0].K.ravel().tolist() == k
    fisheye = ibr.Camera.from_ros(fields | {"distortion_model": "equidistant", "d": [0.1, 0, 0, 0]})
    assert ibr.Camera.from_ros(fisheye.to_ros()) == fisheye
    assert ibr.Camera.from_ros(fields | {"d": []}).lens is None  # simulators write an empty list for no distortion


def test_kalibr_both_ways():
    entry = {"camera_model": "pinhole", "intrinsics": [458.6, 457.3, 367.2, 248.4], "resolution": [752, 480]}
    entry |= {"distortion_model": "radtan", "distortion_coeffs": [-0.283, 0.074, 0.0002, 1.8e-05]}
    camera = ibr.Camera.from_kalibr(entry)
    assert camera.lens == ibr.Lens("brown_conrady", entry["distortion_coeffs"])
    assert camera.to_kalibr() == entry
    fisheye = entry | {"distortion_model": "equidistant"}
    assert ibr.Camera.from_kalibr(fisheye).to_kalibr() == fisheye


def test_an_azure_kinects_cameras_are_opencvs():
    depth, color = (ibr.Camera.from_azure_kinect(kinect(), mode) for mode in ("NFOV_UNBINNED", "720P"))
    assert (depth.size, color.size) == ((640, 576), (1280, 720))
    points = np.random.default_rng(3).uniform((-0.6, -0.5, 1), (0.6, 0.5, 2), (99, 3))
    K = np.array([[0.4928 * 1024, 0, 0.513 * 1024 - 192.5], [0, 0.4929 * 1024, 0.517 * 1024 - 180.5], [0, 0, 1]])
    lens = np.array([0.55, -0.02, 2e-5, -7e-5, -0.003, 0.89, 0.09, -0.014])
    theirs = cv2.projectPoints(points, np.zeros(3), np.zeros(3), K, lens)[0][:, 0]
    np.testing.assert_allclose(depth.project(points)[0], theirs, atol=1e-9)
    K = np.array([[0.478 * 1280, 0, 0.4998 * 1280 - 0.5], [0, 0.6374 * 960, 0.507 * 960 - 120.5], [0, 0, 1]])
    lens = np.array([0.33, -2.49, -2e-4, -1e-4, 1.45, 0.21, -2.3, 1.37])
    moved = np.array([-0.032, -0.002, 0.004])  # translation from the depth camera's frame
    theirs = cv2.projectPoints(points, np.array([-0.09, 0.001, 0.002]), moved, K, lens)[0][:, 0]
    np.testing.assert_allclose(color.project(points)[0], theirs, atol=1e-9)
    assert (depth.lens.radius, color.lens.radius) == (1.74, 1.7)  # 1.7, the SDK's default, replaces 0


@pytest.mark.parametrize(
    ("mode", "other", "times", "shift"),
    [
        ("WFOV_UNBINNED", "NFOV_UNBINNED", 1, (-192, -180)),
        ("WFOV_2X2BINNED", "WFOV_UNBINNED", 2, (0, 0)),
        ("NFOV_2X2BINNED", "NFOV_UNBINNED", 2, (0, 0)),
        ("PASSIVE_IR", "WFOV_UNBINNED", 1, (0, 0)),
        ("720P", "1080P", 1.5, (0, 0)),
        ("720P", "1440P", 2, (0, 0)),
        ("720P", "2160P", 3, (0, 0)),
        ("1536P", "3072P", 2, (0, 0)),
        ("1536P", "720P", 1280 / 2048, (0, -120)),
    ],
)
@pytest.mark.parametrize("wide", [3 / 4, 9 / 16])
def test_an_azure_kinects_modes_see_along_the_same_rays(mode, other, times, shift, wide):
    """Modes scale images about the corner (-0.5, -0.5), or crop them: 16:9 lacks 120 of 960 rows at top and bottom."""
    one, two = (ibr.Camera.from_azure_kinect(kinect(wide), each) for each in (mode, other))
    pixels = np.random.default_rng(4).uniform(0.4, 0.6, (50, 2)) * one.size
    expected = two.ideal_positions((pixels + 0.5) * times - 0.5 + shift)
    np.testing.assert_allclose(one.ideal_positions(pixels), expected, atol=1e-9)


def test_an_azure_kinects_early_calibration_is_of_a_lower_image():
    for mode in ("720P", "3072P"):
        early, usual = (ibr.Camera.from_azure_kinect(kinect(wide), mode) for wide in (9 / 16, 3 / 4))
        np.testing.assert_allclose(early.K, usual.K, atol=1e-9)


def test_an_azure_kinects_modes_have_many_names():
    pose = ibr.Camera.look_at((1, 2, 3), (0, 0, 0), (0, 1, 0), (61, 37)).world_from_camera
    color = ibr.Camera.from_azure_kinect(kinect(), "720P")
    for name in ("K4A_COLOR_RESOLUTION_720P", "MJPG_720P", "res_720p"):
        assert ibr.Camera.from_azure_kinect(kinect(), name) == color
    moved = ibr.Camera.from_azure_kinect(kinect(), "720P", pose)
    np.testing.assert_allclose(moved.world_from_camera, pose @ color.world_from_camera)
    for name in ("1720P", "UNBINNED", 2):
        with pytest.raises(ibr.ArgumentError, match="one of NFOV_UNBINNED, NFOV_2X2BINNED"):
            ibr.Camera.from_azure_kinect(kinect(), name)


# ---- cameras


@pytest.mark.parametrize("name", CALIBRATIONS)
def test_unproject_inverts_project_through_a_lens(name):
    model, coefficients, (fx, fy, cx, cy), size = CALIBRATIONS[name]
    pose = ibr.Camera.look_at((1, 2, 3), (0, 0, 0), (0, 1, 0), size).world_from_camera
    camera = ibr.Camera([[fx, 0.1, cx], [0, fy, cy], [0, 0, 1]], size, pose, lens=ibr.Lens(model, coefficients))
    pixels = np.random.default_rng(1).uniform(0.2, 0.8, (200, 2)) * size
    depth = np.linspace(0.5, 5, 200)
    seen, z = camera.project(camera.unproject(pixels, depth))
    np.testing.assert_allclose(seen, pixels, atol=1e-7)
    np.testing.assert_allclose(z, depth, atol=1e-9)


def test_cameras_keep_their_lens_wherever_they_go(tmp_path: Path):
    lens = ibr.Lens("brown_conrady", [-0.2, 0.05, 0.001, 0], radius=2)
    camera = ibr.Camera(GOOD_K, (61, 37), lens=lens)
    for other in (camera.moved(1, 0, 0), camera.orbited(9, (0, 0, 1)), camera.resized((122, 74))):
        assert other.lens == lens
    assert pickle.loads(pickle.dumps(camera)) == camera != ibr.Camera(GOOD_K, (61, 37))
    camera.save(tmp_path / "camera.json")
    assert ibr.Camera.load(tmp_path / "camera.json") == camera
    plain = ibr.Camera(GOOD_K, (61, 37))
    plain.save(tmp_path / "plain.json")
    assert "lens" not in json.loads((tmp_path / "plain.json").read_text())
    assert "brown_conrady" in repr(camera)


def test_a_lens_that_bends_nothing_is_none():
    camera = ibr.Camera(GOOD_K, (61, 37), lens=ibr.Lens("rational", np.zeros(8)))
    assert camera.lens is None and camera == ibr.Camera(GOOD_K, (61, 37))
    assert ibr.Camera(GOOD_K, (61, 37), lens=ibr.Lens("kannala_brandt", np.zeros(4))).lens is not None


FIELDS = {"width": 7, "height": 13, "distortion_model": "plumb_bob", "d": [0] * 5, "k": [1, 0, 0, 0, 1, 0, 0, 0, 1]}
ENTRY = {"camera_model": "pinhole", "intrinsics": [1, 1, 0, 0], "resolution": [7, 13], "distortion_model": "radtan"}


def from_kinect(calibration, *pose):
    return ibr.Camera.from_azure_kinect(calibration, "NFOV_UNBINNED", *pose)


@pytest.mark.parametrize(
    ("call", "argument", "words"),
    [
        (lambda c: ibr.Lens("pinhole", []), "model", "brown_conrady"),
        (lambda c: ibr.Lens("brown_conrady", [1, 2, 3]), "coefficients", "4 or 5 coefficients for brown_conrady"),
        (lambda c: ibr.Lens("brown_conrady", [0, 0, 0, np.nan]), "coefficients", "finite"),
        (lambda c: ibr.Lens.from_opencv(np.zeros(7)), "distortion", "4, 5, 8, 12 or 14"),
        (lambda c: TILTED.to_colmap(), "lens", "a lens that COLMAP supports: no thin"),
        (lambda c: TILTED.to_realsense(), "lens", "a lens that RealSense supports"),
        (lambda c: ibr.Lens.from_opencv(np.ones(5), fisheye=True), "distortion", "4 numbers of a fisheye"),
        (lambda c: ibr.Camera(GOOD_K, (61, 37), lens=[0, 0, 0, 0]), "lens", "a pyibr.Lens or None"),
        (lambda c: ibr.Camera(GOOD_K, (9, 9), projection="orthographic", lens=c.lens), "lens", "None for an ortho"),
        (lambda c: c.to_opengl(), "camera", "no lens for OpenGL"),
        (lambda c: c.to_pytorch3d(), "camera", "no lens for PyTorch3D"),
        (lambda c: c.to_kalibr(), "lens", "a lens that Kalibr supports"),
        (lambda c: ibr.Lens("modified_brown_conrady", [0, 0, 1, 1]).to_opencv(), "lens", "a lens that OpenCV supports"),
        (lambda c: ibr.Camera.from_ros(FIELDS | {"distortion_model": "fov"}), "info", "plumb_bob"),
        (lambda c: ibr.Camera.from_ros(FIELDS | {"binning_x": 2}), "info", "full resolution"),
        (lambda c: ibr.Camera.from_ros(FIELDS | {"roi": {"x_offset": 2}}), "info", "not cropped"),
        (lambda c: ibr.Camera.from_ros({"k": []}), "info", "something with distortion_model"),
        (lambda c: ibr.Camera.from_realsense({"fx": 1}), "intrinsics", "something with fy"),
        (lambda c: ibr.Camera.from_kalibr(ENTRY | {"camera_model": "omni"}), "camera", "pinhole"),
        (lambda c: ibr.Camera.from_kalibr(ENTRY | {"distortion_model": "fov"}), "camera", "radtan"),
        (lambda c: ibr.Camera.from_kalibr(ENTRY), "camera", "something with distortion_coeffs"),
        (lambda c: from_kinect("no JSON"), "calibration", "something with CalibrationInformation"),
        (lambda c: from_kinect({"CalibrationInformation": {"Cameras": []}}), "calibration", "with the Location"),
        (lambda c: from_kinect({"CalibrationInformation": {"Cameras": 5}}), "calibration", "a list of Cameras"),
        (lambda c: from_kinect(kinect(ModelType="Theta")), "calibration", "BrownConrady"),
        (lambda c: from_kinect(kinect(ModelParameters=[0.5] * 14)), "calibration", "about the principal point"),
        (lambda c: from_kinect(kinect(ModelParameters=[0.5] * 9)), "calibration", "14"),
        (lambda c: from_kinect(kinect(ModelParameters=None)), "calibration", "14"),
        (lambda c: from_kinect(kinect(), np.eye(3)), "world_from_depth_camera", "(4, 4)"),
    ],
)
def test_errors_are_named(call, argument, words):
    camera = ibr.Camera(GOOD_K, (61, 37), lens=ibr.Lens("brown_conrady", [0.1, 0, 0, 0, 0.1]))
    with pytest.raises(ibr.ArgumentError, match=words) as caught:
        call(camera)
    assert caught.value.argument == argument and "\n" not in str(caught.value)


def test_realsense_models_that_are_none_of_ours():
    given = {"width": 64, "height": 48, "fx": 50, "fy": 50, "ppx": 32, "ppy": 24, "coeffs": [0.9, 0, 0, 0, 0]}
    for model in ("ftheta", 3, 99, "unknown"):
        with pytest.raises(ibr.ArgumentError, match="a model of none, modified_brown_conrady"):
            ibr.Camera.from_realsense(given | {"model": model})
