"""Lenses and poses beside K in other programs' files: read, refused by name, or reported."""

from __future__ import annotations

import json
import re
import warnings
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import pyibr as ibr
from pyibr.core.calibrations import cameras_in, read_calibration
from pyibr.io import read_cameras, read_poses
from tests.calibrations import AZURE, BENT, FILES, INTRINSIC, ORBBEC, ORBBEC_JSON, SIZE, K, oak, transforms
from tests.core.test_calibrations import PRISM, written

POINT = np.array([[0.3, 0.2, 1.0]])
FRAMES = [{"file_path": "a.png", "transform_matrix": np.diag([1.0, -1, -1, 1]).tolist()}]  # at the origin
HALF = {"w": 61, "h": 37, "fl_x": 50, "fl_y": 51, "cx": 31, "cy": 18.25, "frames": FRAMES}
NAMED = {"k1": -0.2, "k2": 0.05, "p1": 0.001, "p2": -0.002}
LIST = [-0.2, 0.05, 0.001, -0.002]
FISHEYE = dict(zip(("k1", "k2", "k3", "k4"), LIST, strict=True))
OF_PRISM = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "taux", "tauy")
MATRIX = {"camera_matrix": K, "image_width": 61, "image_height": 37}
CAMODOCAL = """%YAML:1.0
---
model_type: {}
image_width: 61
image_height: 37
{}
"""
INSIDE = "projection_parameters:\n   fx: 50\n   fy: 51\n   cx: 30.5\n   cy: 17.75\n"
NAMES = "distortion_parameters:\n   k1: -0.2\n   k2: 0.05\n   p1: 0.001\n   p2: -0.002\n"
EUROC = f"""sensor_type: camera
camera_model: pinhole
intrinsics: [50, 51, 30.5, 17.75]
resolution: [61, 37]
distortion_model: radial-tangential
distortion_coefficients: {LIST}
"""
BASALT = {"camera_type": "kb4", "resolution": [61, 37]}
BASALT |= {"intrinsics": {"fx": 50, "fy": 51, "cx": 30.5, "cy": 17.75, **FISHEYE}}

READ: dict[str, tuple[Any, str, list[float]]] = {  # content, kind of lens, coefficients
    "nerfstudio, fisheye flag": (HALF | {"is_fisheye": True, **FISHEYE}, "fisheye", LIST),
    "nerfstudio, fisheye": (HALF | {"camera_model": "OPENCV_FISHEYE", "k1": 0.1}, "fisheye", [0.1, 0, 0, 0]),
    "nerfstudio, rational": (HALF | {"camera_model": "FULL_OPENCV", "k4": 0.02} | NAMED, "", [*LIST, 0, 0.02, 0, 0]),
    "nerfstudio, camera per frame": (HALF | {"frames": [FRAMES[0] | NAMED]}, "", LIST),
    "camodocal": (CAMODOCAL.format("PINHOLE", INSIDE + NAMES), "", LIST),
    "camodocal, fisheye": (
        CAMODOCAL.format(
            "KANNALA_BRANDT",
            "projection_parameters:\n   k2: -0.2\n   k3: 0.05\n   k4: 0.001\n   k5: -0.002\n"
            "   mu: 50\n   mv: 51\n   u0: 30.5\n   v0: 17.75\n",
        ),
        "fisheye",
        LIST,
    ),
    **{
        f"beside K: {name}": (MATRIX | {name: LIST}, "", LIST)
        for name in ("dist_coefs", "kc", "distortion_parameters", "distCoef", "D", "dist", "distortion_params")
    },
    "beside K: names": (MATRIX | NAMED, "", LIST),
    "beside K: an object": (MATRIX | {"distortion": NAMED}, "", LIST),
    "beside K: a model in an object": (MATRIX | {"distortion": {"model": "fisheye", "coeffs": LIST}}, "fisheye", LIST),
    **{
        f"Orbbec, {one}": ({"rgbIntrinsic": INTRINSIC, "rgbDistortion": FISHEYE | {"model": one}}, "fisheye", LIST)
        for one in (5, "OB_DISTORTION_KANNALA_BRANDT4")
    },
    "beside K: two coefficients": (MATRIX | {"dist_coeffs": LIST[:2]}, "", [*LIST[:2], 0, 0]),
    "beside K: a model": (MATRIX | {"dist_coeffs": LIST, "lens_model": "equidistant"}, "fisheye", LIST),
    "numbers, names": (INTRINSIC | dict(zip(("k1", "k2", "p1", "p2", "k3"), BENT, strict=True)), "", BENT),
    "numbers, a list": (INTRINSIC | {"distortion_model": "radtan", "dist_coeffs": LIST}, "", LIST),
    "numbers, a model above them": ({"model_type": "fisheye", "camera": INTRINSIC | {"D": LIST}}, "fisheye", LIST),
    "Basalt": (BASALT, "fisheye", LIST),
    "intrinsics and distortion": ({"intrinsics": INTRINSIC, "distortion": NAMED}, "", LIST),
    "intrinsics and a list": ({"intrinsics": INTRINSIC, "dist_coeffs": LIST}, "", LIST),
    "Orbbec, snake case": ({"rgb_intrinsic": INTRINSIC, "rgb_distortion": NAMED}, "", LIST),
    "EuRoC": (EUROC, "", LIST),
    "numbers in a row": ("50 51 30.5 17.75 -0.2 0.05 0.001 -0.002\n", "", LIST),
    "numbers in a row, k3": ("50 51 30.5 17.75 -0.2 0.05 0 0 0.01\n", "", [-0.2, 0.05, 0, 0, 0.01]),
    "rational": ("50 51 30.5 17.75 0.1 0 0 0 0.1 0.2 0.3 0.4\n", "", [0.1, 0, 0, 0, *np.arange(1, 5) / 10]),
    "K and a row": ("50 0 30.5\n0 51 17.75\n0 0 1\n-0.2 0.05 0.001 -0.002\n", "", LIST),
    "K in a row": ("50 0 30.5 0 51 17.75 0 0 1\n", "", [0, 0, 0, 0]),
    "ARKit's pincam": ("61 37 50 51 30.5 17.75\n", "", [0, 0, 0, 0]),
    "a prism and a tilt by name": (MATRIX | dict(zip(OF_PRISM, PRISM, strict=True)), "", PRISM),
}


@pytest.mark.parametrize("name", READ)
def test_lenses_are_those_of_opencv(tmp_path: Path, name):
    content, kind, coefficients = READ[name]
    text = content if isinstance(content, str) else json.dumps(content)
    suffix = "txt" if text[0].isdigit() else "yaml" if isinstance(content, str) else "json"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        (camera,) = read_cameras(written(tmp_path, f"a.{suffix}", text), size=SIZE).values()
    matrix, still = np.array(K, np.float64), np.zeros(3)
    if kind == "fisheye":
        expected = cv2.fisheye.projectPoints(POINT[None], still, still, matrix, np.array(coefficients))[0]
    else:
        expected = cv2.projectPoints(POINT, still, still, matrix, np.array(coefficients))[0]
    np.testing.assert_allclose(camera.project(POINT)[0], expected.reshape(1, 2), atol=1e-9)


def test_a_tilted_sensor_of_an_oak_is_opencvs(tmp_path: Path):
    data = oak()
    data["cameraData"][0][1]["distortionCoeff"] = PRISM
    camera = ibr.Camera.load(written(tmp_path, "oak.json", json.dumps(data)) + "#CAM_A")
    expected = cv2.projectPoints(POINT, np.zeros(3), np.zeros(3), np.array(K, np.float64), np.array(PRISM))[0][0]
    np.testing.assert_allclose(camera.project(POINT)[0], expected, atol=1e-9)
    data["cameraData"][0][1]["cameraType"] = 2
    with pytest.raises(ibr.FileFormatError, match="cameraType: expected a lens that pyibr has, got 'equirectangular'"):
        ibr.Camera.load(written(tmp_path, "oak.json", json.dumps(data)) + "#CAM_A")


def test_two_angles_of_view_are_two_focal_lengths(tmp_path: Path):
    data = {"w": 61, "h": 37, "camera_angle_x": 1.0, "camera_angle_y": 0.5, "frames": FRAMES}
    camera = ibr.Camera.load(written(tmp_path, "transforms.json", json.dumps(data)))
    np.testing.assert_allclose(np.diag(camera.K)[:2], [30.5 / np.tan(0.5), 18.5 / np.tan(0.25)])
    del data["camera_angle_x"]
    camera = ibr.Camera.load(written(tmp_path, "transforms.json", json.dumps(data)))
    np.testing.assert_allclose(np.diag(camera.K)[:2], 18.5 / np.tan(0.25))


def test_orbbecs_colour_camera_is_moved_by_the_transform(tmp_path: Path):
    turn = cv2.Rodrigues(np.array([0.1, 0.2, -0.1]))[0]
    rig = {f"{name}_intrinsic": INTRINSIC for name in ("depth", "rgb")}
    rig["transform"] = {"rot": turn.ravel().tolist(), "transform": [-32.5, 1, 2]}
    cameras = read_cameras(written(tmp_path, "rig.json", json.dumps(rig)))
    np.testing.assert_allclose(cameras["rgb_intrinsic"].camera_from_world[:3, :3], turn)
    np.testing.assert_allclose(cameras["rgb_intrinsic"].camera_from_world[:3, 3], [-0.0325, 0.001, 0.002])
    assert (cameras["depth_intrinsic"].world_from_camera == np.eye(4)).all()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        *(
            (HALF | {"camera_model": name}, f"camera_model: expected a lens .*, got '{name}'")
            for name in ("EQUIRECTANGULAR", "FISHEYE624", "ORTHOPHOTO", "THIN_PRISM_FISHEYE", "VR180_L", "FOV")
        ),
        ({"camera_model": "EQUIRECTANGULAR", "frames": FRAMES}, "got 'EQUIRECTANGULAR'"),
        (HALF | {"latlong": True}, "lens: expected a lens that pyibr has, got 'latlong'"),
        (HALF | {"ftheta_p0": 0.1}, "got 'ftheta_p0'"),
        (HALF | {"frames": [FRAMES[0] | {"camera_model": "FISHEYE624"}]}, "got 'FISHEYE624'"),
        (HALF | {"k1": 0.1, "k4": 0.08}, "k4: expected 0, as no lens of pyibr has nerfstudio's k4"),
        (HALF | {"is_fisheye": 1, "p1": 0.1}, "expected a lens of k1, k2, k3, k4, got p1"),
        (CAMODOCAL.format("MEI", INSIDE), "model_type: expected a lens that pyibr has, got 'MEI'"),
        (CAMODOCAL.format("SCARAMUZZA", "poly_parameters: {p0: 1}"), "got 'SCARAMUZZA'"),
        (BASALT | {"camera_type": "ds"}, "camera_type: expected a lens that pyibr has, got 'ds'"),
        (MATRIX | {"k7": 0.1}, "expected a lens of k1, k2, .*, got k7"),
        (MATRIX | {"distortion_model": "mei", "D": LIST}, "expected a distortion_model of plumb_bob, .*, got 'mei'"),
        (MATRIX | {"dist_coeffs": LIST, "kc": LIST}, "expected one for each K, .*, got dist_coeffs, kc"),
        (MATRIX | {"D1": LIST}, "expected one for each K, with a name like K's, got D1"),
        (MATRIX | {"dist_coeffs": LIST[:3]}, "distortion: expected 4, 5, 8, 12 or 14 numbers, got 3"),
        (MATRIX | {"dist_coeffs": LIST, "k1": 0.3}, "expected coefficients in a list or by name, got both"),
        ({"rgbIntrinsic": INTRINSIC, "transform": [1, 2]}, "transform: expected rot and trans"),
        ({"rot": np.eye(3).tolist(), "tran": [1, 0, 0]}, "expected K, got a transform between two cameras"),
    ],
    ids=lambda content: str(content)[-40:],
)
def test_what_pyibr_lacks_is_refused_by_name(tmp_path: Path, content, message):
    text = content if isinstance(content, str) else json.dumps(content)
    with pytest.raises(ibr.FileFormatError, match=message) as caught:
        read_cameras(written(tmp_path, "a.yaml" if isinstance(content, str) else "a.json", text), size=SIZE)
    assert "\n" not in str(caught.value)


# ---- keys that nobody knows

_SCALARS = ("k1", "K2", "k_3", "p1", "s1", "tau_x", "xi", "alpha", "skew", "radial_k1")
_LISTS = ("dist_coefs", "kc", "distortion_parameters", "radial_distortion", "tangential", "coeffs", "lens")
_LISTS += ("fisheye_params", "params", "thin_prism", "D", "poly_parameters", "quaternion", "distort_fixed")
_POSES = ("T_BS", "pose", "extrinsics", "c2w", "Rt", "cam2world", "world_from_camera", "T_cn_cnm1", "camera_to_world")
_SHIFTS = ("rvec", "tvec", "translation", "position", "t", "T", "orientation")
_MODELS = ("camera_model", "distortion_model", "model_type", "lens_model", "projection_type")
_FLAGS = ("is_fisheye", "latlong", "isMirrored", "equirectangular")
OTHERS: dict[str, Any] = {
    **dict.fromkeys(_SCALARS, 0.1),
    **{key: [0.11, 0.03, 0.002, 0.001] for key in _LISTS},
    "mirror_parameters": {"xi": 0.9},
    "distortion": {"k1": 0.1},
    **{key: [[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3]] for key in _POSES},
    **{key: [1, 2, 3] for key in _SHIFTS},
    **dict.fromkeys(_MODELS, "mei"),
    **dict.fromkeys(_FLAGS, True),
}
FRAME_FILE = transforms()[0]
FRAME_FILE["frames"] = FRAME_FILE["frames"][:1]
OPEN3D = {"width": 61, "height": 37, "intrinsic_matrix": np.array(K).T.ravel().tolist()}
SPECIMENS: dict[str, tuple[str, Any]] = {  # file, and the cameras that are made
    **{name: (name, text) for name, (text, _) in FILES.items() if ".txt" not in name and ".csv" not in name},
    "orbbec.ini#Color": ("orbbec.ini", ORBBEC),
    "orbbec.json": ("orbbec.json", json.dumps(ORBBEC_JSON)),
    "oak.json#CAM_A": ("oak.json", json.dumps(oak())),
    "transforms.json#0001.jpg": ("transforms.json", json.dumps(FRAME_FILE)),
    "azure.json#NFOV_UNBINNED": ("azure.json", json.dumps(AZURE)),
    "camodocal.yaml": ("camodocal.yaml", CAMODOCAL.format("PINHOLE", INSIDE + NAMES)),
    "euroc.yaml": ("euroc.yaml", EUROC),
    "open3d.json": ("open3d.json", json.dumps(OPEN3D)),
    "own.json": ("own.json", json.dumps({"width": 61, "height": 37, "K": K})),
}
_OWN = {"oak.json#CAM_A": ["translation", "coeffs"]}  # read elsewhere in such a file
_KINDS_OF_K = re.compile(r"fx|fl_x|k|camera.?matrix|intrinsic_?matrix|m1|intrinsics?|.*intrinsic", re.I)


def nodes_with_k(tree: object) -> list[dict[str, Any]]:
    """The objects in a tree that hold K, or a part of it."""
    if isinstance(tree, list):
        return [node for value in tree for node in nodes_with_k(value)]
    if not isinstance(tree, dict):
        return []
    own = [tree] if any(_KINDS_OF_K.fullmatch(key) for key in tree) else []
    return own + [node for value in tree.values() for node in nodes_with_k(value)]


def cameras_of(file: Path, tree: object) -> tuple[dict[str, ibr.Camera], str]:
    """The cameras in a tree that can be read, and the messages of errors and warnings."""
    made, errors = dict[str, ibr.Camera](), list[str]()
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        for name, make in cameras_in(tree, file, SIZE).items():
            try:
                made[name] = ibr.Camera(**make())
            except ibr.Error as error:
                errors.append(str(error))
    return made, " ".join([*errors, *(str(one.message) for one in told)])


@pytest.mark.parametrize("specimen", SPECIMENS)
def test_no_lens_is_dropped_without_a_word(tmp_path: Path, specimen):
    """Each name of a lens or pose beside each K changes the camera, is refused, or is named by a warning."""
    file = Path(written(tmp_path, *SPECIMENS[specimen]).partition("#")[0])
    tree = read_calibration(file)[2]
    plain, usual = cameras_of(file, tree)
    assert plain and nodes_with_k(tree)
    for node in nodes_with_k(tree):
        for key, value in OTHERS.items():
            if key.lower() in map(str.lower, (*node, *_OWN.get(specimen, ()))):
                continue
            kept = dict(node)
            node[key] = value
            try:
                made, told = cameras_of(file, tree)
            except ibr.Error as error:  # of camera files of pyibr
                made, told = plain, str(error)
            node.clear()
            node.update(kept)
            words = (key, f"got {key}", "'mei'", "distortion: expected", "coefficients: expected")
            is_told = any(
                told.lower().replace("_", "").count(word.lower().replace("_", "")) > usual.count(word) for word in words
            )
            assert is_told or made != plain, (specimen, [*node], key)


def test_other_cameras_and_other_things_give_no_warning(tmp_path: Path):
    data = oak()
    data |= {"imuExtrinsics": {"rotationMatrix": K}, "stereoRectificationData": {"rectifiedRotationLeft": K}}
    frames = HALF | {"applied_transform": K, "dist": [0, 0, 0, 0], "camera_note": "pose of the rig"}
    stereo = MATRIX | {"rectification_matrix": K, "R": np.eye(3).tolist(), "tvecs": [[1, 2, 3]], "distortion_model": ""}
    numbers = INTRINSIC | {"k1": 0.1, "exposure": 5, "purpose": [1, 2], "lensPosition": 9}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for tree in (data, frames, stereo, numbers):
            assert read_cameras(written(tmp_path, "a.json", json.dumps(tree)), size=SIZE)


def test_a_warning_names_the_file_and_all_keys_beside_it_once(tmp_path: Path):
    data = {"color": INTRINSIC, "color_T": {"data": [1, 2, 3]}, "more": {"radial": [0.1, 0.2]}, "model": "D435"}
    frames = HALF | {"frames": [FRAMES[0] | {"T_lidar": K, "file_path": f"{k}.png"} for k in range(9)]}
    for tree, keys in ((data, "radial"), (frames, "T_lidar")):
        with pytest.warns(
            UserWarning, match=rf"a\.json: not read, though it may be a lens or a pose: .*{keys}"
        ) as told:
            read_cameras(written(tmp_path, "a.json", json.dumps(tree)))
        assert len(told) == 1 and str(told[0].message).count(keys) == 1


def test_the_manual_lists_the_keys(tmp_path: Path):
    """Each key of a specimen that changes its camera, or without which it is refused, is in the manual's table."""
    text = (Path(__file__).parents[2] / "docs" / "cli.md").read_text(encoding="utf-8")
    table = text.partition("| file | keys that are read | pose |")[2].partition("\n\n")[0]
    listed = {word.lower() for word in re.findall(r"`([^`]+)`", table)}
    for specimen, (name, content) in SPECIMENS.items():
        tree = read_calibration(written(tmp_path, name, content))[2]
        for node in nodes_with_k(tree):
            for key in node:
                if re.search("K|dist|intrinsic|matrix|^f|^c[xy]|k1|model|width|coeff", key) and not re.search(
                    "rect|proj", key
                ):
                    assert key.lower() in listed or key in ("frames", "file_path", "cameraData"), (specimen, key)


# ---- poses


def test_a_transform_between_two_cameras_is_read_as_a_pose(tmp_path: Path):
    turn = cv2.Rodrigues(np.array([0.1, 0.2, -0.1]))[0]
    shift, expected = np.array([0.0257, 0.001, 0.004]), np.eye(4)
    expected[:3, :3], expected[:3, 3] = turn, shift
    forms: dict[str, Any] = {
        "extrinsics.json": {"rot": turn.T.ravel().tolist(), "tran": shift.tolist()},  # RealSense's, by columns
        "realsense.json": {"rotation": turn.T.ravel().tolist(), "translation": shift.tolist()},
        "rows.json": {"rotation": turn.tolist(), "translation": shift.tolist()},
        "orbbec.json": {"rot": turn.ravel().tolist(), "trans": (1000 * shift).tolist()},
        "opencv.yaml": f"%YAML:1.0\n---\nR: {{rows: 3, cols: 3, data: {turn.ravel().tolist()}}}\nT: {shift.tolist()}\n",
    }
    for name, content in forms.items():
        (tmp_path / name).write_text(content if isinstance(content, str) else json.dumps(content))
        found = read_poses(tmp_path / name)
        assert found.times is None
        np.testing.assert_allclose(found.world_from_camera, [expected], atol=1e-12)
    (tmp_path / "bad.json").write_text(json.dumps(forms["rows.json"] | {"rotation": K}))
    with pytest.raises(ibr.FileFormatError, match=r"bad\.json: extrinsics: expected a rigid motion"):
        read_poses(tmp_path / "bad.json")


def test_a_pose_with_k_is_no_transform_between_cameras(tmp_path: Path):
    (tmp_path / "a.json").write_text(json.dumps(MATRIX | {"R": np.diag([1, -1, -1]).tolist(), "T": [1, 2, 3]}))
    with pytest.warns(UserWarning, match=r"a\.json: not read, though it may be a lens or a pose: R, T"):
        assert (read_poses(tmp_path / "a.json").world_from_camera == np.eye(4)).all()


def test_rtabmaps_node_numbers_are_left_out(tmp_path: Path):
    head = "#timestamp x y z qx qy qz qw id\n"
    (tmp_path / "poses.txt").write_text(f"{head}12.5 1 2 3 0 0 0 1 7\n12.75 2 2 3 0 0 1 0 8\n")
    found = read_poses(tmp_path / "poses.txt")
    assert found.times.tolist() == [12.5, 12.75] and found.world_from_camera[1, :3, 3].tolist() == [2, 2, 3]
    assert np.allclose(found.world_from_camera[1, :3, :3], np.diag([-1, -1, 1]))
    (tmp_path / "poses.txt").write_text("12.5 1 2 3 0 0 0 1 7.5\n")
    with pytest.raises(ibr.FileFormatError, match=r"17 numbers a line \(9: the last is whole\), .*, got 9"):
        read_poses(tmp_path / "poses.txt")
