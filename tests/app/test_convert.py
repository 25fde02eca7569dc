"""`pyibr convert` writes files that read back equal; errors are one line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import pyibr as ibr
from pyibr.io import read_cameras
from pyibr.io.depth_frames import DepthFrames
from tests.app.commands import run
from tests.app.recorded import Recorded
from tests.core.test_calibrations import same
from tests.data import shared
from tests.io.layouts import SPECIMENS

SIZE = (61, 37)
CAMERA = ibr.Camera([[50, 0, 30], [0, 51, 18], [0, 0, 1]], SIZE)
DEPTH = np.linspace(1, 4, 61 * 37, dtype=np.float32).reshape(37, 61)
DEPTH[:4] = np.nan


@pytest.fixture
def folder(folder: Path) -> Path:
    CAMERA.save("camera.json")
    ibr.write_depth("depth.npy", DEPTH)
    ibr.write_depth("counts.png", DEPTH, depth_scale=1000)
    ibr.Mesh([[0, 0, 1], [1, 0, 1], [0, 2, 1]], [[0, 1, 2]]).save("tri.ply")
    np.savez("three.npz", depth=np.stack([DEPTH, DEPTH + 1, DEPTH + 2]))
    return folder


def convert(*words: object, status: int = 0) -> str:
    """Run `pyibr convert`; return its output or its error."""
    result = run("convert", *words)
    assert result.exit_code == status and "Traceback" not in result.output, result.output
    return result.output if status == 0 else result.stderr.strip().splitlines()[-1]


# ---- cameras


def test_a_calibration_becomes_json(folder: Path):
    Path("K.txt").write_text("50 0 30\n0 51 18\n0 0 1\n")
    assert "camera.json: 1 camera, as pyibr" in convert("K.txt", "--size", 61, 37, "-o", "out/camera.json")
    assert ibr.Camera.load("out/camera.json") == CAMERA
    one = {"width": 61, "height": 37, "fx": 50, "fy": 51, "cx": 30, "cy": 18}
    Path("rig.json").write_text(json.dumps({"left": one | {"fx": 40}, "right": one}))
    assert "one.json: 1 camera, as pyibr" in convert("rig.json#right", "-o", "one.json")
    assert ibr.Camera.load("one.json") == CAMERA
    said = convert("rig.json#right", "-o", "rig.json", status=2)
    assert "--output: expected a file of its own" in said


@pytest.mark.parametrize(
    ("form", "place"), [("colmap", "model"), ("open3d", "o.json"), ("nerfstudio", "transforms.json"), (None, "o.json")]
)
def test_cameras_of_a_recording(folder: Path, form, place):
    """The cameras of a recording in ScanNet's layout, one for each picture with its pose, are written in each form."""
    SPECIMENS["scannet"][0](Path("scan"))
    words = ("--as", form) if form else ()
    assert "2 cameras" in convert("scan", *words, "-o", place)
    expected = [view.camera for view in ibr.load("scan")]
    for camera, other in zip(read_cameras(place).values(), expected, strict=True):
        same(camera, other)
    if form in ("colmap", "nerfstudio"):
        assert list(read_cameras(place)) == ["0.png", "1.png"]
    convert(place, "-o", "back.json")
    assert len(json.loads(Path("back.json").read_text())) == 2


REAL = ["kalibr/euroc_mav", "azure_kinect_raw", "opencv_samples_calib", "realsense_json", "colmap_text"]


@pytest.mark.parametrize("name", REAL)
def test_real_calibrations(folder: Path, name: str):
    place = shared("formats") / name
    files = [place] if name == "colmap_text" else sorted(file for file in place.iterdir() if file.suffix != ".xml")
    made = 0
    for file in files:
        try:
            expected = list(read_cameras(file).values())
        except ibr.Error:
            continue
        convert(file, "-o", "out.json")
        assert list(read_cameras("out.json").values()) == expected
        made += 1
    assert made


# ---- depth

INVERSE = ("depth.npy", "--to-kind", "inverse")


@pytest.mark.parametrize(
    ("words", "out", "how"),
    [
        (("counts.png", "--depth-scale", 1000), "out.exr", {}),
        (("counts.png", "--depth-scale", 1000), "out.png", {"depth_scale": 1000}),
        (("depth.npy", "--to-scale", 5000), "out.png", {"depth_scale": 5000}),
        ((*INVERSE, "--to-scale", 64), "out.pfm", {"depth_kind": "inverse", "depth_scale": 64}),
        (("depth.npy", "--to-kind", "distance", "--camera", "camera.json"), "out.npz", {"depth_kind": "distance"}),
    ],
)
def test_depth_in_other_formats(folder: Path, words, out: str, how):
    if out.endswith(".exr"):
        pytest.importorskip("OpenEXR", reason="needs OpenEXR, of the extra exr")
    assert "depth from 1" in convert(*words, "-o", out)
    np.testing.assert_allclose(ibr.read_depth(out, camera=CAMERA, **how), DEPTH, atol=6e-4)


def test_frames_become_a_video_and_files(folder: Path):
    pytest.importorskip("av", reason="needs PyAV, of the extra video")
    assert "3 frames" in convert("three.npz", "--to-scale", 8000, "-o", "out.mkv", "--fps", 12)
    frames = DepthFrames("out.mkv")
    assert frames.fps == 12
    for number, depth in enumerate(frames.read(range(3), depth_scale=8000)):
        np.testing.assert_allclose(depth, DEPTH + number, atol=6.3e-5)
    convert("out.mkv", "--depth-scale", 8000, "-o", "files/depth.png")
    last = ibr.read_depth("files/depth_0002.png", depth_scale=8000)
    np.testing.assert_allclose(last, DEPTH + 2, atol=6.3e-5)
    convert("files", "--depth-scale", 8000, "-o", "again.mkv")
    for depth, other in zip(DepthFrames("again.mkv").read(range(3), depth_scale=8000), range(3), strict=True):
        np.testing.assert_allclose(depth, DEPTH + other, atol=6.3e-5)


# ---- recordings, meshes


@pytest.mark.parametrize("name", ["scannet", "replica", "bop", "depth_anything"])
def test_a_recording_in_a_simple_layout(folder: Path, name: str):
    SPECIMENS[name][0](Path("scan"))
    convert("scan", "-o", "out")
    for view, other in zip(ibr.load("out"), ibr.load("scan"), strict=True):
        np.testing.assert_array_equal(view.color, other.color)
        np.testing.assert_allclose(view.depth, other.depth, atol=5.1e-4)  # millimetres
        same(view.camera, other.camera)


UPRIGHT = ibr.Mesh([[0, 0, 1], [1, 0, 1], [0, 2, 1]], [[0, 1, 2]])  # 2 high along y


@pytest.mark.parametrize("kind", ["obj", "ply", "off", "stl"])
def test_meshes_keep_their_up_direction_as_in_trimesh(folder: Path, kind):
    """Both libraries give the same numbers: y is up in glTF, and by custom in other formats."""
    trimesh = pytest.importorskip("trimesh")
    UPRIGHT.save(f"one.{kind}")
    assert f"1 triangles; y is up in one.{kind}" in convert(f"one.{kind}", "-o", "one.glb")
    assert f"; y is up in back.{kind}" in convert("one.glb", "-o", f"back.{kind}")
    assert " is up in" not in convert(f"one.{kind}", "-o", f"same.{kind}")
    trimesh.load_mesh(f"one.{kind}").export("theirs.glb")
    assert "1 triangles" in convert("theirs.glb", "-o", f"theirs.{kind}")
    for name in (f"one.{kind}", "one.glb", f"back.{kind}", f"same.{kind}", f"theirs.{kind}"):
        np.testing.assert_array_equal(trimesh.load_mesh(name).vertices, UPRIGHT.vertices)


@pytest.mark.parametrize("up", ["x", "y", "z", "-x", "-y", "-z"])
def test_another_direction_is_up(folder: Path, up):
    """--up names the direction in the file that defines none, whether it is read or written."""
    UPRIGHT.save("one.ply")
    convert("one.ply", "--up", up, "-o", "one.glb")
    height = UPRIGHT.vertices[:, "xyz".index(up[-1])] * (-1 if up[0] == "-" else 1)
    np.testing.assert_array_equal(ibr.Mesh.load("one.glb", axes="gltf").vertices[:, 1], height)
    convert("one.glb", "--up", up, "-o", "back.ply")
    np.testing.assert_array_equal(ibr.Mesh.load("back.ply").vertices, UPRIGHT.vertices)


@pytest.mark.parametrize(
    ("kind", "lost"), [("stl", "texture, uv, normals"), ("ply", "texture, uv"), ("off", "texture, uv, normals")]
)
def test_contents_that_a_format_lacks_are_left_out_and_reported(folder: Path, kind, lost):
    uv, normals = np.zeros((3, 2)), np.tile([0.0, 0.0, 1.0], (3, 1))
    painted = ibr.Mesh(UPRIGHT.vertices, UPRIGHT.faces, uv=uv, normals=normals, texture=np.zeros((2, 2, 3), np.uint8))
    painted.save("painted.glb")
    said = convert("painted.glb", "-o", f"bare.{kind}")
    assert f"bare.{kind}: left out, as .{kind} cannot hold them: {lost}\n" in said
    found = ibr.Mesh.load(f"bare.{kind}")
    assert found.texture is None and found.uv is None and (found.normals is None) == ("normals" in lost)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("nothing", "-o", "out.json"), "nothing: no such file or folder"),
        (("tri.ply", "--up", "z", "-o", "out.obj"), "--up: expected a .glb, which has an up direction"),
        (("scan", "-o", "out.mp4"), "--output: expected a folder for a recording, or .json for its cameras"),
        (("scan", "-o", "out.png"), "--output: expected a folder for a recording, or .json for its cameras"),
        (("film.mp4", "-o", "out.png"), "film.mp4 is read as depth), got none"),
        (("depth.npy", "-o", "out.png"), "--to-scale: expected stored units per scene unit, for the integers of"),
        (("counts.png", "-o", "out.npy"), "--depth-scale: expected stored units"),
        (("depth.npy", "-o", "out.mp4"), "out.mp4: no depth format .mp4"),
        (("depth.npy", "-o", "out.mkv", "--to-scale", 9), "out.mkv: no depth format .mkv"),
        (("depth.npy", "-o", "out.npy", "--to-kind", "distance"), "--camera: expected the camera of the depth"),
        (("depth.npy", "-o", "depth.npy"), "--output: expected a file of its own"),
        (("three.npz", "-o", "out.png", "--to-scale", 50000), "depth: expected 1 to 65535 units of 1/50000"),
        (("camera.json", "--as", "colmap", "-o", "model.json"), "--output: expected a folder, for a COLMAP model"),
        (("camera.json", "--as", "open3d", "-o", "model"), "--output: expected a file that ends in .json, as open3d"),
        (("depth.npy", "-o", "out.json"), "--size: expected the (width, height)"),
        (("camera.json", "-o", "camera.json"), "--output: expected a file of its own"),
        (("bent.json", "--as", "open3d", "-o", "out.json"), "cameras: expected perspective cameras without a lens"),
        (("scan", "-o", "scan/out"), "--output: expected a path outside of the recording"),
    ],
)
def test_mistakes_are_told_in_one_line(folder: Path, words, said):
    ibr.Camera(CAMERA.K, SIZE, lens=ibr.Lens("brown_conrady", [0.1, 0, 0, 0])).save("bent.json")
    SPECIMENS["scannet"][0](Path("scan"))
    ibr.write_video("film.mp4", [np.zeros((36, 60, 3), np.uint8)] * 2, 25)
    assert said in convert(*words, status=2)


def test_pictures_and_depth_of_two_places(recorded: Recorded):
    words = ("--depth-scale", 1000, "--camera", "camera.json", "--poses", "poses.txt", "--take", "1:")
    assert "3 frames" in convert("rgb", "depth", *words, "-o", "out")
    for view, other in zip(ibr.load("out"), recorded.views()[1:], strict=True):
        np.testing.assert_array_equal(view.color, other.color)
        np.testing.assert_array_equal(view.depth, other.depth)
        np.testing.assert_allclose(view.camera.world_from_camera, other.camera.world_from_camera, atol=1e-12)
    assert {file.name for file in Path("out/color").iterdir()} == {f"{k:06d}.png" for k in (1, 2, 3)}
    assert "--output: expected a folder" in convert("rgb", "depth", *words, "-o", "out.json", status=2)
