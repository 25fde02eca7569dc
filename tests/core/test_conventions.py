"""Conversions between pyibr's and other libraries' conventions, compared with those libraries if installed."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

import pyibr as ibr
from tests.core.test_camera import points_before, random_camera


@pytest.mark.parametrize("seed", range(4))
def test_opencv_projects_the_same_pixels(seed):
    camera = random_camera(seed)
    points = points_before(camera)
    K, rvec, tvec = camera.to_opencv()
    expected, _ = cv2.projectPoints(points, rvec, tvec, K, None)
    np.testing.assert_allclose(camera.project(points)[0], expected[:, 0], atol=1e-8)
    np.testing.assert_allclose(cv2.Rodrigues(rvec)[0], camera.camera_from_world[:3, :3], atol=1e-12)
    again = ibr.Camera.from_opencv(K, rvec[:, None], tvec[:, None], camera.size)
    np.testing.assert_allclose(again.world_from_camera, camera.world_from_camera, atol=1e-12)
    matrix = ibr.Camera.from_opencv(K, cv2.Rodrigues(rvec)[0], tvec, camera.size)
    np.testing.assert_allclose(matrix.world_from_camera, camera.world_from_camera, atol=1e-12)


@pytest.mark.parametrize("rvec", [(0, 0, 0), (np.pi, 0, 0), (0, -np.pi, 0), (1e-9, 0, 0), (2, 2, 1e-12)])
def test_opencv_rotation_vectors_at_the_ends(rvec):
    camera = ibr.Camera.from_opencv(np.eye(3), rvec, (0, 0, 0), (7, 13))
    np.testing.assert_allclose(camera.camera_from_world[:3, :3], cv2.Rodrigues(np.array(rvec, float))[0], atol=1e-12)
    _, again, _ = camera.to_opencv()
    np.testing.assert_allclose(cv2.Rodrigues(again)[0], camera.camera_from_world[:3, :3], atol=1e-12)


def test_opengl_clip_space_gives_the_same_pixels():
    """OpenGL's view, frustum and viewport transforms, with pixel centres at halves, lead to the same pixels."""
    camera = random_camera(7)
    pose, K = camera.to_opengl()
    (w, h), n, f = camera.size, 0.1, 100
    left, right = -K[0, 2] / K[0, 0], (w - K[0, 2]) / K[0, 0]
    top, bottom = K[1, 2] / K[1, 1], (K[1, 2] - h) / K[1, 1]
    frustum = [[2 / (right - left), 0, (right + left) / (right - left), 0]]
    frustum += [[0, 2 / (top - bottom), (top + bottom) / (top - bottom), 0]]
    frustum += [[0, 0, -(f + n) / (f - n), -2 * f * n / (f - n)], [0, 0, -1, 0]]
    points = points_before(camera)
    clip = frustum @ np.linalg.inv(pose) @ np.column_stack([points, np.ones(len(points))]).T
    x, y = clip[:2] / clip[3]
    window = np.column_stack([(x + 1) / 2 * w, (1 - y) / 2 * h])
    np.testing.assert_allclose(window - 0.5, camera.project(points)[0], atol=1e-9)


def test_nerf_camera_at_plus_z_looks_at_the_origin_with_y_up():
    pose = np.eye(4)
    pose[2, 3] = 4
    camera = ibr.Camera.from_opengl(pose, [[50, 0, 30.5], [0, 50, 18.5], [0, 0, 1]], (61, 37))
    pixels, depth = camera.project([[0, 0, 0], [0, 1, 0], [1, 0, 0]])
    np.testing.assert_allclose(pixels, [[30, 18], [30, 18 - 12.5], [30 + 12.5, 18]])
    np.testing.assert_allclose(depth, 4)


@pytest.mark.parametrize("center", [0.0, 0.5])
def test_opengl_round_trip(center):
    camera = random_camera(8, skew=0.7)
    again = ibr.Camera.from_opengl(*camera.to_opengl(pixel_center=center), camera.size, pixel_center=center)
    np.testing.assert_allclose(again.K, camera.K)
    np.testing.assert_allclose(again.world_from_camera, camera.world_from_camera, atol=1e-15)


def test_colmap_known_camera():
    half = np.sqrt(0.5)  # a quarter turn about y, so that the camera looks along the world's -x
    camera = ibr.Camera.from_colmap("SIMPLE_PINHOLE", [50, 30.5, 18.5], [half, 0, half, 0], [0, 0, 4], (61, 37))
    np.testing.assert_allclose(camera.K, [[50, 0, 30], [0, 50, 18], [0, 0, 1]])
    np.testing.assert_allclose(camera.center, [4, 0, 0], atol=1e-12)
    np.testing.assert_allclose(camera.forward, [-1, 0, 0], atol=1e-12)
    assert camera.lens is None


@pytest.mark.parametrize("seed", range(4))
def test_colmap_round_trip(seed):
    camera = random_camera(seed)
    again = ibr.Camera.from_colmap(*camera.to_colmap(), camera.size)
    np.testing.assert_allclose(again.K, camera.K)
    np.testing.assert_allclose(again.world_from_camera, camera.world_from_camera, atol=1e-12)


def test_pytorch3d_ndc():
    """In PyTorch3D's NDC, x grows to the left, y upwards, and the image's shorter side goes from -1 to 1."""
    camera = random_camera(9)
    theirs = camera.to_pytorch3d()
    assert theirs["image_size"] == (37, 61)
    corners = np.array([[-0.5, -0.5], [60.5, 36.5]])
    local = camera.unproject(corners, np.array([2.0, 3.0])) @ theirs["R"] + theirs["T"]
    ndc = theirs["focal_length"] * local[:, :2] / local[:, 2:] + theirs["principal_point"]
    np.testing.assert_allclose(ndc, [[61 / 37, 1], [-61 / 37, -1]], atol=1e-12)
    np.testing.assert_allclose(local[:, 2], [2, 3])
    given = (theirs[name] for name in ("R", "T", "focal_length", "principal_point"))
    again = ibr.Camera.from_pytorch3d(*given, camera.size)
    np.testing.assert_allclose(again.K, camera.K)
    np.testing.assert_allclose(again.world_from_camera, camera.world_from_camera, atol=1e-12)


def test_converters_refuse_what_the_other_convention_cannot_hold():
    flat = random_camera(1, projection="orthographic")
    for convert in (flat.to_opencv, flat.to_opengl, flat.to_colmap, flat.to_pytorch3d):
        with pytest.raises(ibr.ArgumentError, match="perspective"):
            convert()
    skewed = random_camera(1, skew=2.0)
    for convert in (skewed.to_colmap, skewed.to_pytorch3d):
        with pytest.raises(ibr.ArgumentError, match="skew"):
            convert()
