"""Each kind of calibration file gives the camera that it describes; errors in files are reported."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

import pyibr as ibr
from pyibr.io import read_cameras
from tests.calibrations import BENT, CAMERA, FILES, FISHEYE, FLAT, KALIBR, ORBBEC, ORBBEC_JSON, SIZE, K, oak, transforms
from tests.data import shared

PRISM = [2.3, 1.4, 1e-3, -2e-3, 0.5, 2.2, 1.4, 0.6, 4e-3, -1e-3, -3e-3, 2e-3, 0.06, -0.04]
DOUBLED = "a0: &a0 1\n" + "".join(f"a{k + 1}: &a{k + 1} [*a{k}, *a{k}]\n" for k in range(40))


def same(found: ibr.Camera, expected: ibr.Camera) -> None:
    np.testing.assert_allclose(found.K, expected.K, rtol=1e-12)  # float64 rounds
    np.testing.assert_allclose(found.world_from_camera, expected.world_from_camera, atol=1e-12)
    assert found.size == expected.size and (found.lens is None) == (expected.lens is None)
    point = [[0.3, -0.2, 1.0]]
    np.testing.assert_allclose(found.project(point)[0], expected.project(point)[0], atol=1e-9)


def written(folder: Path, name: str, text: str) -> str:
    """Write a file; return its path, with the name of the camera to load from it."""
    file = folder / name.partition("#")[0]
    file.write_text(text, encoding="utf-16" if "utf16" in name else "utf-8")
    return str(folder / name)


@pytest.mark.parametrize("name", FILES)
def test_each_kind_is_told_by_what_is_in_it(tmp_path: Path, name):
    text, expected = FILES[name]
    path = written(tmp_path, name, text)
    same(ibr.Camera.load(path, size=SIZE), expected)
    (found,) = read_cameras(path, size=SIZE).values()
    same(found, expected)


def test_orbbec_and_oak_tell_how_their_cameras_stand(tmp_path: Path):
    path = written(tmp_path, "CameraParam.ini", ORBBEC)
    same(ibr.Camera.load(f"{path}#depth"), ibr.Camera([[40, 0, 20], [0, 40, 15], [0, 0, 1]], (41, 31)))
    # In the colour camera's frame, the depth camera's origin is at (-25, 0, 4) mm.
    same(ibr.Camera.load(f"{path}#color"), CAMERA.moved(0.025, 0, -0.004))
    path = written(tmp_path, "orbbec.json", json.dumps(ORBBEC_JSON))
    same(ibr.Camera.load(path), CAMERA)

    path = written(tmp_path, "oak.json", json.dumps(oak()))
    same(ibr.Camera.load(f"{path}#CAM_A"), CAMERA)
    assert np.allclose(ibr.Camera.load(f"{path}#CAM_B").center, (-0.0375, 0, 0))
    assert np.allclose(ibr.Camera.load(f"{path}#CAM_C").center, (0.0375, 0, 0))
    assert ibr.Camera.load(f"{path}#CAM_C").lens == FISHEYE.lens


def test_transforms_are_those_of_opengl(tmp_path: Path):
    data, camera = transforms()
    path = written(tmp_path, "transforms.json", json.dumps(data))
    same(ibr.Camera.load(f"{path}#0001.jpg"), camera)
    assert ibr.Camera.load(f"{path}#0002").K[0, 0] == 60
    assert list(read_cameras(path)) == ["0001.jpg", "0002.jpg"]
    # If the file gives just an angle, it is that between the picture's left and right borders.
    path = written(tmp_path, "angle.json", json.dumps({"camera_angle_x": np.radians(70), "frames": data["frames"][:1]}))
    expected = ibr.Camera.from_fov(SIZE, fov_x=70, world_from_camera=camera.world_from_camera)
    same(ibr.Camera.load(path, size=SIZE), expected)


def test_y_upwards_is_turned_with_the_world(tmp_path: Path):
    """ICL-NUIM has fy < 0, and its poses are of cameras whose y points up."""
    up = np.diag([1.0, -1, 1, 1])
    point = np.array([0.3, -0.2, 2.0, 1])
    pose = FLAT.orbited(30, (0, 0, 2), axis=(1, 2, 3)).world_from_camera
    data = {"width": 61, "height": 37, "fx": 50, "fy": -51, "cx": 30.5, "cy": 17.75, "world_from_camera": pose.tolist()}
    with pytest.warns(UserWarning, match="fy < 0: y is mirrored"):
        found = ibr.Camera.load(written(tmp_path, "icl.json", json.dumps(data)))
    X, Y, Z, _ = np.linalg.inv(pose) @ point
    expected = [50 * X / Z + 30.5, -51 * Y / Z + 17.75]
    np.testing.assert_allclose(found.project([(up @ point)[:3]])[0][0], expected, atol=1e-9)
    for lens in (ibr.Lens("brown_conrady", [0.1, 0.02, 0.03, -0.04]), ibr.Lens("tilted", PRISM)):
        data["lens"] = {"model": lens.model, "coefficients": lens.coefficients}
        with pytest.warns(UserWarning, match="fy < 0: y is mirrored"):
            found = ibr.Camera.load(written(tmp_path, "icl.json", json.dumps(data)))
        x, y = lens.distort([[X / Z, Y / Z]])[0]
        np.testing.assert_allclose(found.project([(up @ point)[:3]])[0][0], [50 * x + 30.5, -51 * y + 17.75], atol=1e-9)


def test_of_several_cameras_one_is_chosen(tmp_path: Path):
    path = written(tmp_path, "camchain.yaml", KALIBR)
    with pytest.raises(ibr.FileFormatError, match=r"expected one camera, as .*camchain.yaml#NAME; got cam0, cam1"):
        ibr.Camera.load(path)
    with pytest.raises(ibr.FileFormatError, match="expected one of cam0, cam1 behind #, got cam7"):
        ibr.Camera.load(f"{path}#cam7")
    with pytest.raises(ibr.FileFormatError, match="a camera_model of pinhole, got 'omni'"):
        ibr.Camera.load(f"{path}#cam1")
    same(ibr.Camera.load(path, size=SIZE), FISHEYE)  # the other camera is unreadable
    odd = tmp_path / "a#b.json"  # "a#b.json" is a file, not camera "b.json" of "a"
    CAMERA.save(odd)
    assert ibr.Camera.load(odd) == CAMERA


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.yaml", "images:\n  - left.jpg\n", "a.yaml: no camera in it: expected K, or a calibration"),
        ("a.yaml", "k: [1, 2\n", "a.yaml: not a readable camera file, or truncated: line 2: .*expected ',' or ']'"),
        ("a.yaml", "%YAML:1.0\na: 1\n   b: 2\n", "line 3: mapping values are not allowed"),
        ("a.yaml", "a: *b\n", "line 1: found undefined alias"),
        ("a.yaml", DOUBLED, "more than 1048576 values, with repetitions by aliases"),
        ("a.yaml", f"a: [{'1, ' * 1_500_000}]", "it has 4500005 characters; up to 4194304 of YAML are read"),
        ("a.xml", "<!DOCTYPE x [<!ENTITY a 'aa'>]><x/>", "a DOCTYPE is not allowed"),
        ("a.yaml", "camera_model: pinhole\nintrinsics: [1]\n", "camera: expected something with distortion_model"),
        ("a.yaml", "distortion_model: plumb_bob\nk: 5\nwidth: 3\nheight: 2\n", "a.yaml: info: expected finite numbers"),
        ("a.json", '{"cameraData": [[0, 5]]}', "a.json: not a camera of a known form: TypeError"),
    ],
    ids=lambda text: text[:20],
)
def test_what_is_none_is_told(tmp_path: Path, name, text, message):
    with pytest.raises(ibr.FileFormatError, match=message):
        ibr.Camera.load(written(tmp_path, name, text), size=SIZE)


@pytest.fixture(params=["CBaseLoader", "BaseLoader"])
def by_each_loader(request, monkeypatch: pytest.MonkeyPatch):
    if request.param == "BaseLoader":
        monkeypatch.delattr("yaml.CBaseLoader", raising=False)


@pytest.mark.usefixtures("by_each_loader")
def test_yaml_of_others(tmp_path: Path):
    """YAML may split a value over lines, and write `*id` for a list that occurs again."""
    inside = {"camera_model": "pinhole", "intrinsics": [50, 51, 30.5, 17.75], "resolution": list(SIZE)}
    inside |= {"distortion_model": "radtan", "distortion_coeffs": [1e-3, 0, 0, 0], "note": "no\n# 1: 2"}
    text = yaml.dump({"cam0": inside, "cam1": inside | {"rostopic": "/a: b"}})
    assert "*id001" in text
    path = written(tmp_path, "camchain.yaml", text)
    expected = ibr.Camera(K, SIZE, lens=ibr.Lens("brown_conrady", [1e-3, 0, 0, 0]))
    for name in ("cam0", "cam1"):
        same(ibr.Camera.load(f"{path}#{name}"), expected)
    for name, (text, expected) in FILES.items():
        if ".y" in name:
            same(ibr.Camera.load(written(tmp_path, name, text), size=SIZE), expected)


def test_opencv_s_own_files(tmp_path: Path):
    cv2 = pytest.importorskip("cv2")
    for suffix in ("yml", "xml", "json"):
        file = tmp_path / f"calibration.{suffix}"
        storage = cv2.FileStorage(str(file), cv2.FILE_STORAGE_WRITE)
        storage.write("image_width", SIZE[0])
        storage.write("image_height", SIZE[1])
        storage.startWriteStruct("board", cv2.FileNode_MAP | cv2.FileNode_FLOW)
        storage.write("corners", 9)
        storage.endWriteStruct()
        storage.write("cameraMatrix", np.array(K))
        storage.write("distCoeffs", np.array([BENT]))
        storage.release()
        same(ibr.Camera.load(file), CAMERA)


def test_opencv_s_sample_sees_its_chessboard():
    """The camera projects the chessboard's corners into a real photograph, to the calibration's error of 0.16 px."""
    cv2 = pytest.importorskip("cv2")
    folder = shared("formats/opencv_samples_calib")
    inside = ibr.Camera.load(folder / "left_intrinsics.yml")
    numbers = cv2.FileStorage(str(folder / "left_intrinsics.yml"), cv2.FILE_STORAGE_READ)
    rvec, tvec = np.split(numbers.getNode("extrinsic_parameters").mat()[0], 2)
    camera = ibr.Camera.from_opencv(inside.K, rvec, tvec, inside.size, BENT)
    camera = ibr.Camera(inside.K, inside.size, camera.world_from_camera, lens=inside.lens)
    found, corners = cv2.findChessboardCornersSB(cv2.imread(str(folder / "left01.jpg"), 0), (9, 6))
    assert found
    corners = corners.reshape(-1, 2)
    board = np.array([(0.025 * (k % 9), 0.025 * (k // 9), 0) for k in range(54)])
    off = camera.project(board)[0] - corners
    assert min(np.median(np.hypot(*off.T)), np.median(np.hypot(*(camera.project(board)[0] - corners[::-1]).T))) < 0.25


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("kalibr/tum_vi/kalibr_imucam_chain.yaml#cam1", (512, 512, 190.442, 252.599)),
        ("kalibr/rs_d455/kalibr_imucam_chain.yaml", (848, 480, 416.852, 421.025)),
        ("ros_camera_info/calib8.ini", (640, 480, 369.344588, 320.739078)),
        ("ros_camera_info/rational_polynomial_oakd_topic_echo.yaml", (250, 250, 196.505, 126.867)),
        ("realsense_json/depth_intrinsics.json", (640, 480, 474.295, 312.0926)),
        ("azure_kinect_raw/calibration.json#720P", (1280, 720, 611.795, 639.304)),
        ("instant_ngp_fox/transforms.json#0006", (1080, 1920, 1375.52, 554.058)),
        ("opencv_samples_calib/left_intrinsics.yml", (640, 480, 535.9157, 342.2832)),
    ],
)
def test_real_files(name, expected):
    file, _, chosen = name.partition("#")
    camera = ibr.Camera.load(f"{shared('formats') / file}{'#' * bool(chosen)}{chosen}")
    assert camera.size == expected[:2]
    np.testing.assert_allclose([camera.K[0, 0], camera.K[0, 2]], expected[2:], atol=1e-3)  # to the digits given above
