"""Camera files that Open3D writes, and Open3D's sample files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pyibr as ibr
from pyibr.io import read_cameras
from tests.data import shared

K = [[50, 0.25, 30.5], [0, 51, 17.75], [0, 0, 1]]
CAMERAS = [ibr.Camera(K, (61, 37)).orbited(25 * k, (0.3, 0, 2), axis=(1, 2, 0.5)).moved(0.1, k, -0.2) for k in range(3)]


@pytest.fixture
def o3d() -> Any:
    return pytest.importorskip("open3d", exc_type=ImportError)


def parameters(o3d: Any, camera: ibr.Camera) -> Any:
    """The camera as an object of Open3D's class."""
    (fx, _, cx), (_, fy, cy), _ = camera.K
    made = o3d.camera.PinholeCameraParameters()
    made.intrinsic = o3d.camera.PinholeCameraIntrinsic(*camera.size, fx, fy, cx, cy)
    made.intrinsic.intrinsic_matrix = camera.K
    made.extrinsic = camera.camera_from_world
    return made


def check(found: ibr.Camera, expected: ibr.Camera) -> None:
    assert found.size == expected.size and found.projection == "perspective" and found.lens is None
    np.testing.assert_array_equal(found.K, expected.K)
    # Rotations are inverted by transposing, which float64's rounding makes inexact.
    np.testing.assert_allclose(found.world_from_camera, expected.world_from_camera, atol=1e-14)


def test_an_intrinsic_is_a_camera_at_the_origin(o3d, tmp_path: Path):
    path = tmp_path / "intrinsic.json"
    assert o3d.io.write_pinhole_camera_intrinsic(str(path), parameters(o3d, CAMERAS[1]).intrinsic)
    check(ibr.Camera.load(path), ibr.Camera(K, (61, 37)))
    assert read_cameras(path) == {"0": ibr.Camera.load(path)}


def test_parameters_have_a_pose(o3d, tmp_path: Path):
    for number, camera in enumerate(CAMERAS):
        path = tmp_path / f"camera_{number}.json"
        assert o3d.io.write_pinhole_camera_parameters(str(path), parameters(o3d, camera))
        check(ibr.Camera.load(path), camera)
    found = read_cameras(tmp_path)
    assert list(found) == ["camera_0", "camera_1", "camera_2"]
    check(found["camera_2"], CAMERAS[2])


def test_a_point_projects_where_open3d_projects_it(o3d, tmp_path: Path):
    """Points on the rays that Open3D casts through pixels are projected to the same pixels by the loaded camera."""
    camera, path = CAMERAS[1], tmp_path / "camera.json"
    theirs = parameters(o3d, camera)
    assert o3d.io.write_pinhole_camera_parameters(str(path), theirs)
    matrix = np.array(theirs.intrinsic.intrinsic_matrix)
    rays = o3d.t.geometry.RaycastingScene.create_rays_pinhole(
        o3d.core.Tensor(matrix), o3d.core.Tensor(np.array(theirs.extrinsic)), *camera.size
    ).numpy()
    y, x = np.mgrid[: camera.height, : camera.width]
    points = (rays[..., :3] + 3 * rays[..., 3:]).reshape(-1, 3).astype(float)
    pixels, depth = ibr.Camera.load(path).project(points)
    # Open3D's rays are float32, and pass through (x + 0.5, y + 0.5), although its images have centres at (x, y).
    np.testing.assert_allclose(pixels, np.column_stack([x.ravel(), y.ravel()]) + 0.5, atol=1e-4)
    np.testing.assert_allclose(depth, 3, rtol=1e-5)


def test_trajectories_are_cameras_of_several_frames(o3d, tmp_path: Path):
    path = tmp_path / "trajectory.json"
    trajectory = o3d.camera.PinholeCameraTrajectory()
    trajectory.parameters = [parameters(o3d, camera) for camera in CAMERAS]
    assert o3d.io.write_pinhole_camera_trajectory(str(path), trajectory)
    found = read_cameras(path)
    assert list(found) == ["0", "1", "2"]
    for one, camera in zip(found.values(), CAMERAS, strict=True):
        check(one, camera)
    with pytest.raises(ibr.FileFormatError, match="expected one camera, got Open3D's trajectory"):
        ibr.Camera.load(path)


@pytest.mark.thorough
def test_open3ds_samples():
    primesense = ibr.Camera.load(shared("formats/redwood_open3d/camera_primesense.json"))
    assert primesense == ibr.Camera([[525, 0, 319.5], [0, 525, 239.5], [0, 0, 1]], (640, 480))
    (one,) = read_cameras(shared("formats/open3d_camera_json/depth_syn_camera.json")).values()
    assert one.K.tolist() == [[415.69219381653068, 0, 319.5], [0, 415.69219381653068, 239.5], [0, 0, 1]]
    # The file stores camera_from_world by columns: first the world's x axis, last the world's origin.
    np.testing.assert_array_equal(one.camera_from_world[:3, 0].round(6), [0.914014, 0.011576, -0.405516])
    np.testing.assert_allclose(one.camera_from_world[:3, 3], [0.273673, 0.036354, 1.239966], atol=1e-6)


INTRINSIC = {"width": 61, "height": 37, "intrinsic_matrix": [50, 0, 0, 0, 51, 0, 30, 18, 1]}
EXTRINSIC = np.eye(4).ravel().tolist()


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (INTRINSIC | {"width": 0}, "size: expected"),
        ({"width": 61, "intrinsic_matrix": []}, "has no height"),
        (INTRINSIC | {"intrinsic_matrix": [1, 2, 3]}, "intrinsic_matrix: expected"),
        (INTRINSIC | {"intrinsic_matrix": "K"}, "intrinsic_matrix: expected"),
        (INTRINSIC | {"intrinsic_matrix": [50, 0, 30, 0, 51, 18, 0, 0, 1]}, "K: expected"),  # row by row
        (INTRINSIC | {"lens": None}, "has 'lens', which Open3D's cameras lack"),
        ({"class_name": "PinholeCameraParameters"}, "has no intrinsic_matrix, and no intrinsic with one"),
        ({"intrinsic": 3}, "has no intrinsic_matrix, and no intrinsic with one"),
        ({"intrinsic": INTRINSIC}, "has no extrinsic"),
        ({"intrinsic": INTRINSIC, "extrinsic": [1] * 16}, "extrinsic: expected a rigid motion"),
        ({"intrinsic": INTRINSIC, "extrinsic": 3}, "extrinsic: expected"),
        ({"intrinsic": INTRINSIC, "extrinsic": [*EXTRINSIC[:3], 1, *EXTRINSIC[4:]]}, "extrinsic: expected"),
        ({"parameters": 3}, "expected"),
        ({"class_name": "PinholeCameraTrajectory", "parameters": []}, "expected cameras, got an empty list"),
        ({"class_name": "PinholeCameraTrajectory", "parameters": [{}]}, "camera 0: has no"),
        ({"intrinsic": INTRINSIC, "extrinsic": [EXTRINSIC, 3]}, "camera 1: extrinsic: expected"),
    ],
)
def test_damaged_files_are_told(tmp_path: Path, data, words):
    path = tmp_path / "camera.json"
    path.write_text(json.dumps(data))
    with pytest.raises(ibr.FileFormatError, match=words) as caught:
        read_cameras(path)
    assert str(caught.value).startswith(str(path))
