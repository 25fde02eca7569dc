"""The camera's invariants, files and errors."""

from __future__ import annotations

import json
import pickle
import warnings
from pathlib import Path

import cv2
import numpy as np
import pytest

import pyibr as ibr

SIZES = [(7, 13), (1, 1), (61, 37), (640, 480)]


def random_camera(seed: int, size=(61, 37), projection="perspective", skew=0.0) -> ibr.Camera:
    rng = np.random.default_rng(seed)
    rotation, _ = cv2.Rodrigues(rng.normal(size=3))
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, rng.normal(size=3)
    K = [[70 + seed, skew, 28.3], [0, 65.5, 20.1], [0, 0, 1]]
    return ibr.Camera(K, size, pose, projection=projection)


def points_before(camera: ibr.Camera, count=50, seed=0) -> np.ndarray:
    local = np.random.default_rng(seed).uniform((-1, -1, 0.5), (1, 1, 5), (count, 3))
    return local @ camera.world_from_camera[:3, :3].T + camera.center


# ---- invariants


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
@pytest.mark.parametrize("seed", range(3))
def test_unproject_inverts_project(projection, seed):
    camera = random_camera(seed, projection=projection, skew=1.5)
    points = points_before(camera)
    np.testing.assert_allclose(camera.unproject(*camera.project(points)), points, atol=1e-12)


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_pixel_matrix_agrees_with_project(projection):
    camera = random_camera(1, projection=projection, skew=1.5)
    points = points_before(camera)
    homogeneous = np.column_stack([points, np.ones(len(points))])
    u, v, w, q = camera.pixel_matrix @ camera.camera_from_world @ homogeneous.T
    pixels, depth = camera.project(points)
    np.testing.assert_allclose(np.column_stack([u / w, v / w]), pixels, atol=1e-9)
    np.testing.assert_allclose(q / w, 1 / depth if projection == "perspective" else -depth, atol=1e-9)


def test_points_behind_a_perspective_camera_have_no_pixel():
    pixels, depth = ibr.Camera(np.eye(3), (7, 13)).project([[1, 1, -1], [0, 0, 0], [1, 2, 2]])
    assert np.isnan(pixels[:2]).all() and pixels[2].tolist() == [0.5, 1.0]
    assert depth.tolist() == [-1, 0, 2]


@pytest.mark.parametrize("size", SIZES)
def test_look_at_sees_the_target_in_the_middle_and_up_is_up(size):
    camera = ibr.Camera.look_at((1, 2, 3), (4, -1, 7), (0, 0, 1), size, fov_y=40)
    middle = (np.array(size) - 1) / 2
    pixels, depth = camera.project([[4, -1, 7], [4, -1, 7.1]])
    np.testing.assert_allclose(pixels[0], middle, atol=1e-9)
    assert depth[0] == pytest.approx(np.sqrt(9 + 9 + 16))
    assert pixels[1, 0] == pytest.approx(middle[0]) and pixels[1, 1] < middle[1]


def test_look_at_reaches_to_the_image_border():
    camera = ibr.Camera.look_at((0, 0, 0), (0, 0, 1), (0, -1, 0), (61, 37), fov_y=50)
    np.testing.assert_array_equal(camera.world_from_camera, np.eye(4))
    border, _ = camera.project([[0, np.tan(np.radians(25)), 1]])
    assert border[0, 1] == pytest.approx(36.5)
    camera = ibr.Camera.look_at((0, 0, 9), (0, 0, 0), (0, 1, 0), (61, 37), projection="orthographic", height=5)
    pixels, depth = camera.project([[0, 2.5, 1], [0, -2.5, 1]])
    np.testing.assert_allclose(pixels, [[30, -0.5], [30, 36.5]], atol=1e-12)
    np.testing.assert_allclose(depth, 8)


def test_moved_goes_along_the_cameras_own_axes():
    camera = random_camera(2)
    moved = camera.moved(1, 2, 3)
    np.testing.assert_allclose((camera.camera_from_world @ [*moved.center, 1])[:3], [1, 2, 3])
    np.testing.assert_array_equal(moved.world_from_camera[:3, :3], camera.world_from_camera[:3, :3])


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_orbit_keeps_its_pivot_and_moves_to_the_right(projection):
    camera = random_camera(3, projection=projection)
    pivot = camera.center + 4 * camera.forward
    turned = camera.orbited(90, pivot)
    for a, b in zip(camera.project([pivot]), turned.project([pivot]), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-9)
    # The pivot is 4 ahead: a quarter turn moves the camera by 4 to the right and by 4 ahead, in the old axes.
    np.testing.assert_allclose((camera.camera_from_world @ [*turned.center, 1])[:3], [4, 0, 4], atol=1e-9)
    back = turned.orbited(-90, pivot)
    np.testing.assert_allclose(back.world_from_camera, camera.world_from_camera, atol=1e-12)


def test_orbit_about_a_given_axis_is_right_handed():
    camera = ibr.Camera(np.eye(3), (7, 13)).orbited(90, (0, 0, 2), axis=(5, 0, 0))
    np.testing.assert_allclose(camera.center, [0, 2, 2], atol=1e-12)


def test_resized_keeps_the_borders_of_the_view():
    camera = random_camera(4)
    resized = camera.resized((122, 111))
    corners = np.array([[-0.5, -0.5], [60.5, 36.5], [10, 20]])
    world = camera.unproject(corners, np.ones(3))
    pixels, _ = resized.project(world)
    np.testing.assert_allclose(pixels, (corners + 0.5) * [2, 3] - 0.5, atol=1e-9)
    np.testing.assert_allclose(resized.resized((61, 37)).K, camera.K, atol=1e-12)


def test_immutable_equal_hashable_picklable():
    camera, twin = random_camera(5), random_camera(5)
    assert camera == twin and hash(camera) == hash(twin)
    assert camera not in (random_camera(6), camera.resized((1, 1)))
    copy = pickle.loads(pickle.dumps(camera))
    assert copy == camera
    for array in (camera.K, camera.world_from_camera, camera.camera_from_world, copy.K, camera.center):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1
    with pytest.raises(AttributeError, match="immutable"):
        camera.K = np.eye(3)


def test_arguments_are_copied_and_intrinsics_may_stand_in_4_x_4():
    for K, pose in ((np.eye(3), np.eye(4)), (np.eye(4), np.eye(4))):
        camera = ibr.Camera(K, (7, 13), pose)
        K[0, 0] = pose[0, 3] = 9
        assert camera == ibr.Camera(np.eye(3), (7, 13))


def test_poses_of_four_digits_become_the_nearest_rotation():
    exact = random_camera(7)
    rounded = ibr.Camera(exact.K, exact.size, np.round(exact.world_from_camera, 4))
    rotation = rounded.world_from_camera[:3, :3]
    np.testing.assert_allclose(rotation.T @ rotation, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(rotation, exact.world_from_camera[:3, :3], atol=1e-4)  # twice the digits' rounding


def test_fields_of_view_reach_from_border_to_border():
    for angles, pixel, ray in (
        ({"fov_x": 70}, [60.5, 18], [np.tan(np.radians(35)), 0, 1]),
        ({"fov_y": 40}, [30, -0.5], [0, -np.tan(np.radians(20)), 1]),
    ):
        camera = ibr.Camera.from_fov((61, 37), **angles)
        np.testing.assert_allclose(camera.unproject([pixel], [1.0])[0], ray, atol=1e-12)
    # If the focal length equals the film's diagonal, every picture's diagonal sees an angle of 2 atan(1 / 2).
    camera = ibr.Camera.from_fov((60, 80), focal_35mm=np.hypot(36, 24))
    assert camera.K[0, 0] == pytest.approx(100) and camera.K[:2, 2].tolist() == [29.5, 39.5]
    for given in ({}, {"fov_x": 50, "focal_35mm": 20}):
        with pytest.raises(ibr.ArgumentError, match="one of fov_x, fov_y and focal_35mm"):
            ibr.Camera.from_fov((61, 37), **given)


def test_exchanged_focal_lengths_and_centres_are_warned_of():
    with pytest.warns(UserWarning, match=r"fx, fy = 319.5, 239.5 and cx, cy = 525, 525 look exchanged"):
        ibr.Camera([[319.5, 0, 525], [0, 239.5, 525], [0, 0, 1]], (640, 480))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ibr.Camera([[320, 0, 319.5], [0, 240, 239.5], [0, 0, 1]], (640, 480))  # no warning: both angles are 90 degrees


# ---- errors

GOOD_K = [[50, 0, 30], [0, 50, 18], [0, 0, 1]]
ONE_COEFFICIENT = '{"width": 6, "height": 3, "K": [], "lens": {"model": "rational", "coefficients": [1]%s}}'


def pose_with(**rows) -> np.ndarray:
    pose = np.eye(4)
    for row, values in rows.items():
        pose[int(row[1:])] = values
    return pose


@pytest.mark.parametrize(
    ("changed", "argument", "words"),
    [
        ({"K": np.ones((4, 4))}, "K", r"shape \(3, 3\), got .*\(4, 4\)"),
        ({"K": np.zeros((3, 3))}, "K", "fx, fy > 0"),
        ({"K": [[50, 0, 30], [0, 0, 18], [0, 0, 1]]}, "K", "fx, fy > 0"),
        ({"K": [[50, 0, 30], [0, -50, 18], [0, 0, 1]]}, "K", "fx, fy > 0"),
        ({"K": [[50, 0, 30], [0, 50, 18], [0, 0, 2]]}, "K", r"\[0, 0, 1\]"),
        ({"K": [[50, 0, np.nan], [0, 50, 18], [0, 0, 1]]}, "K", "finite numbers .* 1 that are not finite"),
        ({"K": "K"}, "K", "numbers"),
        ({"K": [[1, 2], [3]]}, "K", "numbers"),
        ({"K": np.eye(3, dtype=complex)}, "K", "complex"),
        ({"size": (0, 37)}, "size", r"two integers > 0, got tuple \(0, 37\)"),
        ({"size": (61, -1)}, "size", "two integers > 0"),
        ({"size": (61.5, 37)}, "size", "two integers > 0"),
        ({"size": (61, 37, 3)}, "size", "two integers > 0"),
        ({"size": 61}, "size", "two integers > 0"),
        ({"world_from_camera": np.eye(3)}, "world_from_camera", r"\(4, 4\)"),
        ({"world_from_camera": 2 * np.eye(4)}, "world_from_camera", "last row"),
        ({"world_from_camera": pose_with(r3=(1, 2, 3, 1))}, "world_from_camera", "last row"),
        ({"world_from_camera": pose_with(r0=(2, 0, 0, 0))}, "world_from_camera", "R.T R off by 3"),
        ({"world_from_camera": pose_with(r0=(1, 2e-2, 0, 0))}, "world_from_camera", "R.T R off"),
        ({"world_from_camera": pose_with(r0=(-1, 0, 0, 0))}, "world_from_camera", "mirrored"),
        ({"world_from_camera": pose_with(r0=(1, 0, 0, np.inf))}, "world_from_camera", "finite"),
        ({"projection": "fisheye"}, "projection", "fisheye"),
    ],
)
def test_bad_arguments_are_named(changed, argument, words):
    arguments = {"K": GOOD_K, "size": (61, 37)} | changed
    with pytest.raises(ibr.ArgumentError, match=words) as caught:
        ibr.Camera(**arguments)
    assert caught.value.argument == argument and "\n" not in str(caught.value)


def look_at(**changed) -> ibr.Camera:
    arguments = {"eye": (0, 0, 0), "target": (0, 0, 1), "up": (0, -1, 0), "size": (7, 13)}
    return ibr.Camera.look_at(**arguments | changed)


@pytest.mark.parametrize(
    ("call", "argument"),
    [
        (lambda c: look_at(target=(0, 0, 0)), "target"),
        (lambda c: look_at(up=(0, 0, 2)), "up"),
        (lambda c: look_at(up=(0, 0, 0)), "up"),
        (lambda c: look_at(fov_y=180), "fov_y"),
        (lambda c: look_at(fov_y=0), "fov_y"),
        (lambda c: look_at(fov_y=np.nan), "fov_y"),
        (lambda c: look_at(height=3), "height"),
        (lambda c: look_at(projection="orthographic"), "height"),
        (lambda c: look_at(projection="fisheye"), "projection"),
        (lambda c: look_at(projection=None, height=3), "projection"),
        (lambda c: look_at(size=(0, 1)), "size"),
        (lambda c: look_at(eye=(0, 0)), "eye"),
        (lambda c: c.project(np.zeros((5, 2))), "points"),
        (lambda c: c.unproject(np.zeros((5, 2)), np.zeros(4)), "depth"),
        (lambda c: c.moved(0, 0, np.nan), "(dx, dy, dz)"),
        (lambda c: c.orbited("9", (0, 0, 1)), "degrees"),
        (lambda c: c.orbited(9, (0, 0, 1), axis=(0, 0, 0)), "axis"),
        (lambda c: c.resized((0, 0)), "size"),
        (lambda c: c.from_opencv(GOOD_K, (1, 2), (0, 0, 0), (7, 13)), "rotation"),
        (lambda c: c.from_opencv(GOOD_K, (0, 0, 0), (0, 0), (7, 13)), "translation"),
        (lambda c: c.from_opengl(np.eye(3), GOOD_K, (7, 13)), "camera_to_world"),
        (lambda c: c.from_colmap("FISHEYE", [1], [1, 0, 0, 0], [0, 0, 0], (7, 13)), "model"),
        (lambda c: c.from_colmap("PINHOLE", [1, 2, 3], [1, 0, 0, 0], [0, 0, 0], (7, 13)), "params of PINHOLE"),
        (lambda c: c.from_colmap("PINHOLE", [1, 2, 3, 4], [0, 0, 0, 0], [0, 0, 0], (7, 13)), "qvec"),
    ],
)
def test_methods_name_the_bad_argument(call, argument):
    with pytest.raises(ibr.ArgumentError) as caught:
        call(ibr.Camera(GOOD_K, (61, 37)))
    assert caught.value.argument == argument


# ---- files


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_json_round_trip_is_exact(tmp_path: Path, projection):
    camera = random_camera(3, projection=projection, skew=0.1)
    camera.save(tmp_path / "new" / "camera.json")
    assert ibr.Camera.load(tmp_path / "new" / "camera.json") == camera


def test_json_with_focal_lengths_and_defaults(tmp_path: Path):
    file = tmp_path / "camera.json"
    file.write_text(json.dumps({"width": 61, "height": 37, "fx": 50, "fy": 50, "cx": 30, "cy": 18}))
    assert ibr.Camera.load(file) == ibr.Camera(GOOD_K, (61, 37))


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "no such file"),
        ("", "empty"),
        ('{"width": 61', "not a readable"),
        ("[1, 2]", "expected a JSON object, got list"),
        ("{}", "has no width, height, fx, fy, cx, cy"),
        ('{"width": 61, "height": 37, "fx": 5, "fy": 5, "cx": 3}', "has no cy"),
        ('{"width": 61, "height": 37, "K": 3}', "K: expected"),
        ('{"width": 61, "height": 37, "K": null}', "K: expected"),
        ('{"width": "61", "height": 37, "K": [[1,0,0],[0,1,0],[0,0,1]]}', "size: expected"),
        ('{"width": 61, "height": 37, "K": [], "world_to_camera": 1}', "unknown key 'world_to_camera'"),
        ('{"width": 61, "height": 37, "K": [], "fx": 1}', "both K and fx"),
        ('{"width": 6, "height": 3, "K": [[1,0,0],[0,1,0],[0,0,1]], "projection": 5}', "projection"),
        ('{"width": 6, "height": 3, "K": [], "lens": 5}', "expected a lens with model, coefficients"),
        ('{"width": 6, "height": 3, "K": [], "lens": {"model": "rational"}}', "its lens has no coefficients"),
        (ONE_COEFFICIENT % "", "8 coefficients for rational"),
        (ONE_COEFFICIENT % ', "k1": 5', "unknown key 'k1'"),
    ],
)
def test_bad_camera_files_are_named(tmp_path: Path, content, words):
    file = tmp_path / "camera.json"
    if content is not None:
        file.write_text(content)
    with pytest.raises(ibr.FileFormatError, match=words) as caught:
        ibr.Camera.load(file)
    assert str(caught.value).startswith(str(file))
