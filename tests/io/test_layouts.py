"""Layouts of recordings are read by the right conventions, as specimens of a known scene show.

A layout's K, pose, depth and scale place each sample at a point. The point must lie on the scene's surface, and have
the sample's colour; the two frames must agree on colours of the same points. This fails if a similar convention is
taken instead: y up, inverse poses, pixel centres half a pixel off, another scale.
"""

from __future__ import annotations

import json
import random
import shutil
import warnings
import zipfile
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

import pyibr as ibr
from pyibr.io.layouts import LAYOUTS, recording_in
from pyibr.io.recordings import are_placed, cameras_of, shots_of
from tests.io.damages import damaged
from tests.io.layouts import SPECIMENS, phones
from tests.io.layouts.wall import GL, NORMAL, OFFSET

PICTURES = (".png", ".jpg", ".ppm", ".pgm")  # other tests damage these files

Frame = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def frames_of(folder: Path) -> list[Frame]:
    """Colours, depth, K and pose of each usable frame; colours are reduced to the resolution of the depth."""
    recording = recording_in(folder)
    found = []
    for shot in shots_of(recording, cameras_of(recording)):
        if shot is not None:
            color, (depth, _) = shot.stored.color(shot.color), shot.read_depth()
            camera = shot.depth_camera or shot.camera
            if color.dtype != np.uint8:
                color = np.rint(255 * color)
            step = color.shape[0] // depth.shape[0]  # pixels along a depth sample's side
            small = color.reshape(depth.shape[0], step, depth.shape[1], step, 3).mean((1, 3))
            found.append((small, depth.astype(np.float64), camera.K, camera.world_from_camera))
    return found


def points_of(frame: Frame) -> tuple[np.ndarray, np.ndarray]:
    """A frame's samples as points (N, 3) in the world, with their colours (N, 3)."""
    color, depth, K, pose = frame
    y, x = np.nonzero(np.isfinite(depth) & (depth > 0))
    local = np.column_stack([x, y, np.ones(len(x))]) @ np.linalg.inv(K).T * depth[y, x, None]
    return local @ pose[:3, :3].T + pose[:3, 3], color[y, x]


def scene_colors(points: np.ndarray) -> np.ndarray:
    waves = [np.sin(5 * points[:, 0] + k) * np.cos(4 * points[:, 1] - k) for k in range(3)]
    return 127.5 + 110 * np.column_stack(waves)


def off_scene(frames: list[Frame]) -> float:
    """Median difference between samples' colours and the scene's colours at their points, in levels of 255."""
    each = [np.abs(scene_colors(points) - colors) for points, colors in map(points_of, frames)]
    return float(np.median(np.concatenate(each)))


def off_other(frames: list[Frame]) -> float:
    """Median difference between two frames' colours, where the second shows points of the first."""
    points, colors = points_of(frames[0])
    other, _, K, pose = frames[1]
    local = (points - pose[:3, 3]) @ pose[:3, :3]
    x, y = (local[:, :2] / local[:, 2:] @ K[:2, :2].T + K[:2, 2]).T
    seen = (local[:, 2] > 0) & (x >= 0) & (y >= 0) & (x < other.shape[1] - 1) & (y < other.shape[0] - 1)
    if not seen.any():
        return np.inf
    x, y, colors = x[seen], y[seen], colors[seen]
    i, j = x.astype(int), y.astype(int)
    u, v = (x - i)[:, None], (y - j)[:, None]
    top, bottom = (other[j + k, i] * (1 - u) + other[j + k, i + 1] * u for k in (0, 1))
    return float(np.median(np.abs(top * (1 - v) + bottom * v - colors)))


def neighbours(frames: list[Frame]) -> dict[str, list[Frame]]:
    """The frames as they would be if read by similar, wrong conventions."""
    found = {f"half a pixel {by:+}": [(c, z, shifted(K, by), p) for c, z, K, p in frames] for by in (-0.5, 0.5)}
    found |= {f"{by} times as deep": [(c, z * by, K, p) for c, z, K, p in frames] for by in (0.97, 1.03)}
    if len({pose.tobytes() for *_, pose in frames}) > 1:
        found["y up"] = [(c, z, K, p @ GL) for c, z, K, p in frames]
        found["world to camera"] = [(c, z, K, np.linalg.inv(p)) for c, z, K, p in frames]
    return found


def shifted(K: np.ndarray, by: float) -> np.ndarray:
    moved = K.copy()
    moved[:2, 2] += by
    return moved


@pytest.mark.parametrize("name", SPECIMENS)
def test_a_specimen_beats_its_neighbours_in_convention(tmp_path: Path, name):
    make, count = SPECIMENS[name]
    make(tmp_path / "it")
    frames = frames_of(tmp_path / "it")
    assert len(frames) == count
    points = np.concatenate([points_of(frame)[0] for frame in frames])
    # Less than a unit of stored depth, or than a pixel of disparity in float32.
    assert np.abs(points @ NORMAL - OFFSET).max() < 0.006
    right = off_scene(frames)
    assert right < 1.5
    for convention, wrong in neighbours(frames).items():
        assert off_scene(wrong) > 1.5 * right, convention
    if len({pose.tobytes() for *_, pose in frames}) > 1:
        right = off_other(frames)
        assert right < 2
        turned = len({pose[:3, :3].tobytes() for *_, pose in frames}) > 1
        for convention, wrong in neighbours(frames).items():
            if turned or convention.endswith(("deep", "camera")):  # other errors cancel for parallel cameras
                assert off_other(wrong) > right, convention


@pytest.mark.thorough
@pytest.mark.parametrize("name", SPECIMENS)
def test_damaged_layouts(folder: Path, name):
    """A recording with damaged files of cameras, poses or names is refused, or read completely."""
    SPECIMENS[name][0](folder / "it")
    told = [file for file in sorted(folder.rglob("*")) if file.is_file() and file.suffix not in PICTURES]
    whole, rng = {file: file.read_bytes() for file in told}, random.Random(name)
    for number in range(40 if name.startswith("ros_") else 200):  # few, because rosbags opens files slowly
        file = rng.choice(told)
        file.write_bytes(damaged(whole[file], rng, number))
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                recording = recording_in(folder / "it")
                shots = [shot for shot in shots_of(recording, cameras_of(recording)) if shot is not None]
                for shot in shots[:1]:
                    assert np.isfinite(shot.camera.world_from_camera).all()
                    shot.read_depth(depth_scale=1000)
        except ibr.Error:
            pass
        file.write_bytes(whole[file])


def test_what_no_layout_is_tells_which_were_looked_for(tmp_path: Path):
    (tmp_path / "transforms.json").write_text('{"frames": [{"file_path": "a"}]}')  # without depth
    with pytest.raises(ibr.FileFormatError) as raised:
        recording_in(tmp_path)
    for layout in LAYOUTS:
        assert f"{layout.name} ({layout.signs})" in str(raised.value)


def test_raw_kinect_counts_of_nyu(tmp_path: Path):
    """Counts, with swapped bytes, become depth by the toolbox's formula. The depth camera is 25 mm beside the other."""
    Image.fromarray(np.zeros((480, 640, 3), np.uint8)).save(tmp_path / "r-1294886360.208451-2996770081.ppm")
    stored = np.full((480, 640), 917, ">u2")  # 351.3 / (1092.5 - 917) m
    stored[0] = 2047
    data = b"P5\n640 480\n65535\n" + stored.byteswap().tobytes()
    (tmp_path / "d-1294886360.216451-2996770082.pgm").write_bytes(data)
    recording = recording_in(tmp_path)
    (shot,) = shots_of(recording, cameras_of(recording))
    depth, _ = shot.read_depth()
    assert np.isnan(depth[0]).all()
    np.testing.assert_allclose(depth[1:], 351.3 / 175.5, rtol=1e-6)
    from_depth = shot.camera.camera_from_world @ shot.depth_camera.world_from_camera
    np.testing.assert_allclose(from_depth[:3, 3], (-0.0250, -0.0007, 0.0003), atol=5e-5)


def test_a_bag_of_realsenses_recorder(tmp_path: Path):
    """The recorder's names of topics and lenses are known. Topics give the unit of depth and the poses of streams."""
    pytest.importorskip("rosbags")
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    types = {name.rpartition("/")[2]: kind for name, kind in store.types.items()}
    region = types["RegionOfInterest"](0, 0, 0, 0, False)
    turn = np.array([[0.8, 0, 0.6], [0, 1, 0], [-0.6, 0, 0.8]])  # the rotation of a quaternion with y = 0.1 ** 0.5
    messages = [("/device_0/sensor_0/option/Depth_Units/value", types["Float32"](0.0001))]
    streams = (("sensor_0/Depth_0", "mono16"), ("sensor_0/Infrared_1", "mono8"), ("sensor_1/Color_0", "rgb8"))
    for stream, encoding in streams:
        head = types["Header"](0, store.types["builtin_interfaces/msg/Time"](5, 0), "0")
        is_color = stream.endswith("Color_0")
        x, y = (-0.015, 0.1**0.5) if is_color else (0.0, 0.0)  # relative to the first stream
        told = types["Transform"](types["Vector3"](x, 0.0, 0.0), types["Quaternion"](0.0, y, 0.0, (1 - y * y) ** 0.5))
        info = types["CameraInfo"](
            head, 3, 4, "Inverse Brown Conrady", np.full(5, 0.01 * is_color), np.array([5.0, 0, 1.5, 0, 5, 1, 0, 0, 1]),
            np.eye(3).ravel(), np.zeros(12), 0, 0, region,
        )  # fmt: skip
        values = np.full((3, 4, 3) if is_color else (3, 4), 7, np.uint8) if encoding != "mono16" else None
        data = np.full((3, 4), 12345, "<u2") if values is None else values
        picture = types["Image"](head, 3, 4, encoding, 0, data.nbytes // 3, np.frombuffer(data.tobytes(), np.uint8))
        prefix = f"/device_0/{stream}"
        messages += [(f"{prefix}/tf/0", told), (f"{prefix}/info/camera_info", info), (f"{prefix}/image/data", picture)]
    with Writer(tmp_path / "one.bag") as writer:
        for topic, message in messages:
            connection = writer.add_connection(topic, message.__msgtype__, typestore=store)
            writer.write(connection, 5_000_000_000, store.serialize_ros1(message, message.__msgtype__))
    recording = recording_in(tmp_path / "one.bag")
    (shot,) = shots_of(recording, cameras_of(recording))
    np.testing.assert_allclose(shot.read_depth()[0], 1.2345, rtol=1e-6)
    assert shot.stored.color(shot.color).shape == (3, 4, 3)
    assert shot.camera.lens == ibr.Lens("inverse_brown_conrady", [0.01] * 5)
    color_from_depth = shot.camera.camera_from_world @ shot.depth_camera.world_from_camera
    np.testing.assert_allclose(color_from_depth[:3, :3], turn, atol=1e-9)
    np.testing.assert_allclose(color_from_depth[:3, 3], (-0.015, 0, 0), atol=1e-9)


def test_intrinsics_of_larger_pictures_are_refused(tmp_path: Path):
    """Some exporters make pictures smaller, but leave the intrinsics as they were."""
    SPECIMENS["scannet"][0](tmp_path)
    for picture in (tmp_path / "color").iterdir():
        with Image.open(picture) as image:
            small = image.resize((image.width // 3, image.height // 3))
        small.save(picture)
    with pytest.raises(ibr.FileFormatError, match=r"color\.txt: its centre .* lies outside of pictures of 21 x 16"):
        cameras_of(recording_in(tmp_path))


def test_a_file_may_be_a_recording(tmp_path: Path):
    SPECIMENS["r3d_packed"][0](tmp_path / "it")
    (tmp_path / "it/one.r3d").rename(tmp_path / "one.R3D")
    for one, other in zip(frames_of(tmp_path / "one.R3D"), frames_of(tmp_path), strict=True):
        assert all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))
    (tmp_path / "one.bag").write_bytes(b"no bag")
    with pytest.raises(ibr.FileFormatError, match=r"one\.bag: not a readable ROS bag file"):
        ibr.load(tmp_path / "one.bag")


def test_a_lens_that_is_not_known_is_named(tmp_path: Path):
    """ETH3D's pictures have a lens that pyibr does not know; the error names it."""
    SPECIMENS["eth3d_views"][0](tmp_path)
    file = tmp_path / "dslr_calibration_jpg/cameras.txt"
    file.write_text("1 THIN_PRISM_FISHEYE 64 48 60 62 30.8 24.7 0.2 0.2 0 0 -0.1 0.4 0 0\n")
    with pytest.raises(ibr.FileFormatError, match=r"images\.txt: cam0/0001\.png: .*got .*THIN_PRISM_FISHEYE"):
        cameras_of(recording_in(tmp_path))


def test_depth_of_fewer_samples_has_a_camera_of_its_own(tmp_path: Path):
    """A phone's depth in transforms.json has fewer samples than pixels: one for each 2 x 2 pixels here."""
    SPECIMENS["nerfstudio"][0](tmp_path)
    for file in tmp_path.rglob("*depth*/*.png"):
        with Image.open(file) as image:
            small = Image.fromarray(np.asarray(image)[::2, ::2])
        small.save(file)
    recording = recording_in(tmp_path)
    for shot in shots_of(recording, cameras_of(recording)):
        own = shot.depth_camera
        assert own is not None and own.size == (shot.camera.width // 2, shot.camera.height // 2)
        np.testing.assert_allclose(own.world_from_camera, shot.camera.world_from_camera)
        np.testing.assert_allclose(own.K[0], (shot.camera.K[0] + (0, 0, 0.5)) / 2 - (0, 0, 0.5))


def test_files_of_transforms_as_people_write_them(tmp_path: Path, caplog: pytest.LogCaptureFixture):
    """Names may have backslashes or no suffix. NPY files in millimetres and frames without depth are logged."""
    SPECIMENS["nerfstudio"][0](tmp_path)
    first, file = frames_of(tmp_path), tmp_path / "transforms.json"
    told = json.loads(file.read_text())
    for frame in told["frames"]:
        depth = tmp_path / frame["depth_file_path"]
        np.save(depth.with_suffix(".npy"), 1000 * ibr.read_depth(depth, depth_scale=1000))
        frame["depth_file_path"] = frame["depth_file_path"].replace("/", "\\").replace(".png", ".npy")
        frame["file_path"] = frame["file_path"].replace("/", "\\").removesuffix(".png")
    lone = {"file_path": "images/lone.png", "transform_matrix": np.eye(4).tolist()}
    file.write_text(json.dumps(told | {"frames": [*told["frames"], lone]}))
    for one, other in zip(first, frames_of(tmp_path), strict=True):
        np.testing.assert_allclose(other[1], one[1], rtol=1e-6)
    assert len(ibr.load(tmp_path)) == 2
    assert "as millimetres, as in nerfstudio" in caplog.text
    assert "1 files are left out, because picture or depth is missing: lone.png" in caplog.text


def test_frames_without_poses_are_at_no_known_place(tmp_path: Path):
    SPECIMENS["bop"][0](tmp_path)
    file = tmp_path / "scene_camera.json"
    assert are_placed(cameras_of(recording_in(tmp_path)))
    told = json.loads(file.read_text())
    kept = {number: {key: one[key] for key in ("cam_K", "depth_scale")} for number, one in told.items()}
    file.write_text(json.dumps(kept))
    assert not are_placed(cameras_of(recording_in(tmp_path)))


def test_unsure_samples_are_left_out(tmp_path: Path):
    """Samples below ARKit's medium confidence are left out by default: here, an eighth of them."""
    SPECIMENS["stray"][0](tmp_path)
    recording = recording_in(tmp_path)
    shot = shots_of(recording, cameras_of(recording))[0]
    depth, share = shot.read_depth()
    assert share == 1 / 8 and np.isnan(depth[:3]).all() and np.isfinite(depth[3:]).all()
    assert shot.read_depth(0)[1] == 0 and shot.read_depth(3)[1] == 1


@pytest.mark.parametrize("name", ["r3d", "r3d_packed"])
@pytest.mark.parametrize("damage", [b"no picture", b"\xff\xd8"])
def test_a_damaged_picture_in_a_packed_recording_is_named(tmp_path: Path, name: str, damage: bytes):
    SPECIMENS[name][0](tmp_path / "it")
    folder = tmp_path / "it"
    if name == "r3d_packed":
        with zipfile.ZipFile(folder / "one.r3d") as packed:
            files = {one: packed.read(one) for one in packed.namelist()}
        with zipfile.ZipFile(folder / "one.r3d", "w") as packed:
            for one, data in files.items():
                packed.writestr(one, damage if one.endswith("0.jpg") else data)
    else:
        (folder / "rgbd/0.jpg").write_bytes(damage)
    shots = shots_of(recording_in(folder), cameras_of(recording_in(folder)))
    with pytest.raises(ibr.FileFormatError, match=r"0\.jpg: not a readable picture file"):
        shots[0].stored.picture(shots[0].color)
    assert len(ibr.load(folder)) == 1


def test_a_damaged_archive_is_named(tmp_path: Path):
    SPECIMENS["r3d_packed"][0](tmp_path / "it")
    shutil.unpack_archive(tmp_path / "it/one.r3d", tmp_path / "out", "zip")
    with zipfile.ZipFile(tmp_path / "it/one.r3d", "w") as packed:
        for file in (tmp_path / "out").rglob("*"):
            packed.write(file, file.relative_to(tmp_path / "out"))
    data = (tmp_path / "it/one.r3d").read_bytes()
    at = data.index(b"\xff\xd8\xff") + 40  # within a picture: its checksum fails
    (tmp_path / "it/one.r3d").write_bytes(data[:at] + bytes(9) + data[at + 9 :])
    assert len(ibr.load(tmp_path / "it")) == 1


def test_depth_pro_as_apples_program_writes_it(tmp_path: Path):
    """Its NPZ has no focal length, and a colour map with the stem of the photograph lies beside it."""
    SPECIMENS["depth_pro"][0](tmp_path)
    with np.load(tmp_path / "a.npz") as stored:
        depth = stored["depth"]
    np.savez_compressed(tmp_path / "a.npz", depth=depth)
    near = 1 / depth
    level = np.uint8(255 * (near - near.min()) / (near.max() - near.min()))
    cv2.imwrite(str(tmp_path / "a.jpg"), cv2.applyColorMap(level, cv2.COLORMAP_TURBO))
    camera = ibr.Camera([[60.0, 0, 31.5], [0, 60.0, 23.5], [0, 0, 1]], (64, 48))
    (view,) = ibr.load(tmp_path, camera=camera)
    np.testing.assert_array_equal(view.color, ibr.read_color(tmp_path / "a.png"))
    np.testing.assert_array_equal(view.depth, depth)
    with pytest.raises(ibr.FileFormatError, match=r"has neither a\.json nor camera\.json"):
        ibr.load(tmp_path)
    Image.open(tmp_path / "a.png").save(tmp_path / "b.jpg", quality=98)
    (tmp_path / "a.npz").rename(tmp_path / "b.npz")
    assert len(ibr.load(tmp_path, camera=camera)) == 1  # the photograph may be a JPEG, too
    (tmp_path / "b.npz").rename(tmp_path / "a.npz")
    (tmp_path / "a.png").unlink()
    with pytest.raises(ibr.FileFormatError, match=r"a\.jpg: is a colour map of a\.npz; expected the photograph"):
        ibr.load(tmp_path, camera=camera)


def test_the_manual_lists_every_layout():
    manual = (Path(__file__).parents[2] / "docs/howto/recordings.md").read_text(encoding="utf-8")
    rows = [line.split("|")[1] for line in manual.splitlines() if line.startswith("| ")]
    lacking = [layout.name for layout in LAYOUTS if not any(layout.name in row for row in rows)]
    assert not lacking


def test_lenses_and_poses_in_a_recordings_files_are_not_dropped_without_a_word(tmp_path: Path):
    phones.polycam(tmp_path)
    for file in tmp_path.rglob("*.json"):
        told = json.loads(file.read_text())
        file.write_text(json.dumps(told | {"k1": 0.1, "T_lidar": [1, 2, 3]}) if "t_00" in told else file.read_text())
    with pytest.warns(UserWarning, match=r"\.json: not read, though it may be a lens or a pose: k1, T_lidar"):
        recording_in(tmp_path)


def test_eth3ds_calibration_may_have_a_lens(tmp_path: Path):
    for name in ("rgb", "depth"):
        (tmp_path / f"{name}.txt").write_text(f"1.5 {name}.png\n")
    ibr.write_color(tmp_path / "rgb.png", np.zeros((37, 61, 3), np.uint8))
    ibr.write_depth(tmp_path / "depth.png", np.ones((37, 61), np.float32), depth_scale=5000)
    (tmp_path / "calibration.txt").write_text("50 51 30.5 17.75 -0.2 0.05 0.001 -0.002\n")
    (camera,) = recording_in(tmp_path).known()
    assert camera.lens == ibr.Lens("brown_conrady", [-0.2, 0.05, 0.001, -0.002])
