"""Trajectories: every form gives the same poses, and invalid files are reported."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import pyibr as ibr
from pyibr.io import read_poses

AHEAD = [ibr.Camera.look_at((0.1 * k, -0.2 * k, 0.3), (k, 1, 4), (0, -1, 0.1), (7, 5)) for k in range(12)]
CAMERAS = [camera.orbited(40 * k, (0, 0, 1)) for k, camera in enumerate(AHEAD)]
MATRICES = np.array([camera.world_from_camera for camera in CAMERAS])
TIMES = 1305031232.5 + 0.0333 * np.arange(len(CAMERAS))


def words(numbers: object) -> str:
    return " ".join(repr(float(number)) for number in np.ravel(numbers))


def tum(number: int) -> str:
    w, x, y, z = CAMERAS[number].to_colmap()[2] * [1, -1, -1, -1]  # COLMAP has the rotation from world to camera
    return words([TIMES[number], *MATRICES[number, :3, 3], x, y, z, w])


def rows(matrix: np.ndarray) -> str:
    return "\n".join(words(row) for row in matrix)


FORMS = {
    "TUM": (lambda k: tum(k), True),
    "KITTI": (lambda k: words(MATRICES[k, :3]), False),
    "16": (lambda k: words(MATRICES[k]), False),
    "time and 12": (lambda k: words([TIMES[k], *MATRICES[k, :3].ravel()]), True),
    "time and 16": (lambda k: words([TIMES[k], *MATRICES[k].ravel()]), True),
    "matrices": (lambda k: rows(MATRICES[k]), False),
    "Redwood": (lambda k: f"{k} {k} {k + 1}\n{rows(MATRICES[k])}", None),
}


@pytest.mark.parametrize("form", FORMS)
def test_each_form_holds_the_poses(tmp_path: Path, form):
    line, timed = FORMS[form]
    text = "# a remark\n\n" + "\n".join(line(k) for k in range(len(CAMERAS))) + "\n"
    (tmp_path / "poses.txt").write_text(text)
    found = read_poses(tmp_path / "poses.txt")
    np.testing.assert_allclose(found.world_from_camera, MATRICES, atol=1e-12)
    if timed is False:
        assert found.times is None
    else:
        np.testing.assert_allclose(found.times, TIMES if timed else np.arange(len(CAMERAS)))


X, Y, Z, W = 0.1, -0.4, 0.2, float(np.sqrt(1 - 0.21))
HEADERS = {
    "#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z []": "txyzWXYZ",
    "#timestamp, p_x [m], p_y [m], p_z [m], q_w [], q_x [], q_y [], q_z [], v_x [m s^-1], v_y [m s^-1], v_z [m s^-1], "
    "b_w_x [rad s^-1], b_w_y [rad s^-1], b_w_z [rad s^-1], b_a_x, b_a_y, b_a_z": "txyzWXYZ---------",
    "# timestamp tx ty tz qx qy qz qw": "txyzXYZW",
    "# timestamp tx ty tz qw qx qy qz": "txyzWXYZ",
    "timestamp,x,y,z,qw,qx,qy,qz": "txyzWXYZ",
    "Time;Position X;Position Y;Position Z;Rotation W;Rotation X;Rotation Y;Rotation Z": "txyzWXYZ",
    "# Format: [timestamp, tx, ty, tz, qw, qx, qy, qz]": "txyzWXYZ",
    "# time qx qy qz qw tx ty tz": "tXYZWxyz",
    "# t x y z w x y z": "txyzWXYZ",
    "# t tx ty tz, quaternion (w x y z)": "txyzWXYZ",
    "# the quaternions are wxyz": "txyzWXYZ",
    "# timestamp tx ty tz q0 q1 q2 q3": "txyzWXYZ",
    "#timestamp x y z qx qy qz qw id": "txyzXYZW-",
    "%time,field.header.seq,field.pose.position.x,field.pose.position.y,field.pose.position.z,field.pose.orientation.x,"
    "field.pose.orientation.y,field.pose.orientation.z,field.pose.orientation.w": "t-xyzXYZW",
    "tx ty tz qw qx qy qz": "xyzWXYZ",
}


@pytest.mark.parametrize("header", HEADERS)
def test_a_header_names_the_columns(tmp_path: Path, header: str):
    known = {"x": 1.0, "y": 2.0, "z": 3.0, "X": X, "Y": Y, "Z": Z, "W": W, "-": 7.0}
    lines = [[known.get(one, 100.5 + number) for one in HEADERS[header]] for number in range(2)]
    text = "\n".join((", " if "," in header else " ").join(map(repr, line)) for line in lines)
    (tmp_path / "p.csv").write_text(f"# a remark\n{header}\n{text}\n")
    found = read_poses(tmp_path / "p.csv")
    plain = " ".join(map(repr, (0, 1, 2, 3, X, Y, Z, W)))
    (tmp_path / "plain.txt").write_text(f"{plain}\n{plain}\n")
    np.testing.assert_allclose(found.world_from_camera, read_poses(tmp_path / "plain.txt").world_from_camera)
    assert (found.times is None) == ("t" not in HEADERS[header])
    if found.times is not None:
        np.testing.assert_array_equal(found.times, [100.5, 101.5])


def test_a_folder_of_files_is_read_in_the_order_of_their_numbers(tmp_path: Path):
    with pytest.raises(ibr.FileFormatError, match="no text files with poses"):
        read_poses(tmp_path)
    for number, matrix in enumerate(MATRICES):
        (tmp_path / f"frame-{number}.pose.txt").write_text(rows(matrix))
    (tmp_path / "intrinsics.txt").write_text("1 2 3")
    np.testing.assert_allclose(read_poses(tmp_path).world_from_camera, MATRICES, atol=1e-12)


def test_the_cameras_of_a_json_file_have_poses(tmp_path: Path):
    """One file is a trajectory as Open3D's view control writes it, in column order; the other is a list of cameras."""
    intrinsic = {"width": 7, "height": 5, "intrinsic_matrix": CAMERAS[0].K.T.ravel().tolist()}
    several = [{"extrinsic": one.camera_from_world.T.ravel().tolist(), "intrinsic": intrinsic} for one in CAMERAS]
    trajectory = {"class_name": "PinholeCameraTrajectory", "parameters": several}
    (tmp_path / "trajectory.json").write_text(json.dumps(trajectory))
    listed = [{"width": 7, "height": 5, "K": CAMERAS[0].K.tolist(), "world_from_camera": m.tolist()} for m in MATRICES]
    (tmp_path / "cameras.JSON").write_text(json.dumps(listed))
    for name in ("trajectory.json", "cameras.JSON"):
        found = read_poses(tmp_path / name)
        assert found.times is None
        np.testing.assert_allclose(found.world_from_camera, MATRICES, atol=1e-12)


def test_few_digits_are_enough(tmp_path: Path):
    (tmp_path / "p.txt").write_text(" ".join(f"{number:.4f}" for number in MATRICES[5, :3].ravel()))
    (pose,) = read_poses(tmp_path / "p.txt").world_from_camera
    np.testing.assert_allclose(pose, MATRICES[5], atol=2e-4)
    assert ibr.Camera(CAMERAS[5].K, (7, 5), pose)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "empty"),
        ("# nothing\n", "got no"),
        ("1 2 3\n4 5 6", "got 3"),
        ("1 2 3 4 5 6 7", "expected 8, 12, 13, 16 or 17 numbers a line"),
        ("1 2 3 4\n5 6 7 8\n", "4 lines of 4 numbers"),
        ("0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n", "4 lines of 4 numbers"),
        ("a b c d e f g h", "not a readable trajectory file"),
        ("1 0 0 0 0 0 0 0", "pose 0: expected finite numbers"),
        ("nan 0 0 0 0 0 0 1", "times in seconds"),
        (f"{words(np.eye(4)[:3])}\n{words(2 * np.eye(4)[:3])}", "pose 1: expected a rigid motion"),
        (words(np.diag([1, 1, -1, 1])), "mirrored"),
        ("\udcff", "no such file"),
    ],
)
def test_what_is_no_trajectory(tmp_path: Path, text, message):
    if text != "\udcff":
        (tmp_path / "p.txt").write_text(text)
    with pytest.raises(ibr.FileFormatError, match=message):
        read_poses(tmp_path / "p.txt")


@pytest.mark.parametrize("units", [1, 1_000, 1_000_000, 1_000_000_000])
def test_parts_of_a_second_since_1970_become_seconds(tmp_path: Path, units):
    start = 1_700_000_000
    lines = [f"{(start + k) * units} 1 2 3 0 0 0 1\n" for k in range(3)]
    (tmp_path / "poses.txt").write_text("".join(lines))
    assert read_poses(tmp_path / "poses.txt").times.tolist() == [start, start + 1, start + 2]
