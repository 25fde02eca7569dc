"""Pairing of a recording's files, in artificial folders and in real data sets."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import pyibr as ibr
from pyibr.io.folders import at_one_time
from pyibr.io.layouts import recording_in
from pyibr.io.recordings import Recording, cameras_of, paired, shots_of
from tests.data import shared


def touch(folder: Path, *names: str) -> None:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).touch()


def names(recording: Recording) -> list[tuple[str, str]]:
    return [(a.name, b.name) for a, b in zip(recording.colors, recording.depths, strict=True)]


def test_things_at_one_time_are_each_others_nearest():
    assert at_one_time([0, 1, 2], [0.001, 0.99, 2.1]) == [(0, 0), (1, 1)]
    assert at_one_time([0.0, 0.01], [0.008]) == [(1, 0)]
    assert at_one_time([5.0], [7.0, 5.02, 4.99]) == [(0, 2)]
    assert at_one_time([], [1.0]) == at_one_time([1.0], []) == []


@pytest.mark.parametrize("places", [("rgb", "depth"), ("Color", "depth"), ("images", "DEPTHS"), ("RGB", "Depth")])
def test_two_folders(tmp_path: Path, places):
    color, depth = places
    touch(tmp_path, f"{color}/9.jpg", f"{color}/10.jpg", f"{depth}/9.png", f"{depth}/10.png")
    touch(tmp_path, f"{color}/notes.txt", f"{depth}/.hidden.png", "trajectory.log")
    found = recording_in(tmp_path)
    assert names(found) == [("9.jpg", "9.png"), ("10.jpg", "10.png")]
    assert found.poses == tmp_path / "trajectory.log" and not found.left_out
    assert names(paired(tmp_path / color, tmp_path / depth)) == names(found)


def test_cameras_of_a_folder(tmp_path: Path):
    touch(tmp_path, "a.color.png", "a.depth.png", "b.color.png", "b.depth.png", "intrinsics.K.txt")
    assert recording_in(tmp_path).cameras == (tmp_path / "intrinsics.K.txt",)
    for name in ("camera_primesense.json", "camera_intrinsic.json", "intrinsic.json", "camera.json"):
        touch(tmp_path, name)
        assert recording_in(tmp_path).cameras == (tmp_path / name,)
    touch(tmp_path, "camera/a.json", "camera/b.json")
    assert recording_in(tmp_path).cameras == (tmp_path / "camera/a.json", tmp_path / "camera/b.json")
    touch(tmp_path, "a.json")  # reading would report that b.json is missing
    assert recording_in(tmp_path).cameras == (tmp_path / "a.json", tmp_path / "b.json")
    (tmp_path / "pose").mkdir()
    assert recording_in(tmp_path).poses is None
    touch(tmp_path, "pose/a.txt")
    assert recording_in(tmp_path).poses == tmp_path / "pose"


def test_one_folder(tmp_path: Path):
    for number in (0, 3):
        stem = f"frame-{number:06d}"
        touch(tmp_path, f"{stem}.color.png", f"{stem}.depth.png", f"{stem}.pose.txt")
    found = recording_in(tmp_path)
    assert names(found)[1] == ("frame-000003.color.png", "frame-000003.depth.png")
    assert found.poses == tmp_path


def test_tum_lists_go_by_time(tmp_path: Path):
    (tmp_path / "rgb.txt").write_text("# color\n1.00 rgb/a.png\n1.10 rgb/b.png\n1.20 rgb/c.png\n")
    (tmp_path / "depth.txt").write_text("# depth\n1.215 depth/z.png\n0.99 depth/x.png\n1.15 depth/y.png\n")
    (tmp_path / "groundtruth.txt").write_text("")
    found = recording_in(tmp_path)
    assert names(found) == [("a.png", "x.png"), ("c.png", "z.png")] and len(found.left_out) == 1
    assert found.poses == tmp_path / "groundtruth.txt"


def test_names_that_are_times_go_by_time(tmp_path: Path):
    touch(tmp_path, "rgb/10.00.png", "rgb/10.03.png", "rgb/10.07.png", "depth/10.031.png", "depth/10.069.png")
    found = paired(tmp_path / "rgb", tmp_path / "depth")
    assert names(found) == [("10.03.png", "10.031.png"), ("10.07.png", "10.069.png")] and len(found.left_out) == 1


@pytest.mark.parametrize(("digits", "form"), [(3, "{}"), (6, "rgb_{}"), (9, "frame{}_a")])
def test_names_that_count_parts_of_a_second_go_by_time(tmp_path: Path, digits, form):
    """ROS names files by time: there are as many pictures as depth files, but their times differ."""
    start = 1_700_000_000

    def name(milliseconds: int) -> str:
        return form.format((start * 1000 + milliseconds) * 10 ** (digits - 3))

    touch(tmp_path, *(f"rgb/{name(ms)}.png" for ms in (0, 33, 100)), *(f"depth/{name(ms)}.png" for ms in (30, 66, 99)))
    found = paired(tmp_path / "rgb", tmp_path / "depth")
    assert names(found) == [(f"{name(33)}.png", f"{name(30)}.png"), (f"{name(100)}.png", f"{name(99)}.png")]
    assert len(found.left_out) == 1
    np.testing.assert_allclose(found.times, [start + 0.033, start + 0.1], rtol=0, atol=1e-6)


def test_long_numbers_that_are_no_times(tmp_path: Path):
    touch(tmp_path, *(f"{kind}/{number:016d}.png" for kind in ("rgb", "depth") for number in (1, 2)))
    assert paired(tmp_path / "rgb", tmp_path / "depth").times is None


def test_frames_that_are_lost_are_left_out(tmp_path: Path):
    touch(tmp_path, *(f"rgb/c{n}.png" for n in (1, 2, 3, 10)), *(f"depth/{n}_raw.png" for n in (1, 3, 4, 10, 11)))
    found = paired(tmp_path / "rgb", tmp_path / "depth")
    assert names(found) == [("c1.png", "1_raw.png"), ("c3.png", "3_raw.png"), ("c10.png", "10_raw.png")]
    assert len(found.left_out) == 3 and found.times is None


def test_other_numbers_are_a_mistake(tmp_path: Path):
    touch(tmp_path, *(f"rgb/{n}.png" for n in (1, 2, 3)), *(f"depth/{n}.png" for n in (3, 4, 5, 6)))
    with pytest.raises(ibr.ArgumentError, match=r"colour and depth of the same numbers, got 1.png without depth"):
        paired(tmp_path / "rgb", tmp_path / "depth")
    touch(tmp_path, *(f"rgb2/{n}.png" for n in (0, 1, 2, 3)), *(f"depth2/{n}.png" for n in (1, 2, 3, 4)))
    with pytest.raises(ibr.ArgumentError, match=r"got 0.png without depth"):  # counted from 0 and from 1
        paired(tmp_path / "rgb2", tmp_path / "depth2")


def test_names_are_heeded_before_order(tmp_path: Path):
    touch(tmp_path, "left.color.png", "right.color.png", "right_depth.npy", "left_depth.npy", "left_depth.png")
    found = [("left.color.png", "left_depth.png"), ("right.color.png", "right_depth.npy")]
    assert names(recording_in(tmp_path)) == found


def test_without_common_numbers_there_must_be_as_many(tmp_path: Path):
    touch(tmp_path, "rgb/a.png", "rgb/b.png", "depth/x.png", "depth/y.png")
    assert names(paired(tmp_path / "rgb", tmp_path / "depth")) == [("a.png", "x.png"), ("b.png", "y.png")]
    touch(tmp_path, "depth/z.png")
    with pytest.raises(ibr.ArgumentError, match="a depth for each of the 2 frames of colour, got 3 of depth"):
        paired(tmp_path / "rgb", tmp_path / "depth")


def test_folders_without_a_recording(tmp_path: Path):
    with pytest.raises(ibr.FileFormatError, match=r"found neither frusta\.json nor frames of colour and depth"):
        recording_in(tmp_path)
    touch(tmp_path, "rgb/1.png", "depth/notes.txt")
    with pytest.raises(ibr.FileFormatError, match="depth: no file of depth in it"):
        recording_in(tmp_path)
    (tmp_path / "rgb.txt").write_text("1.0 rgb/1.png")
    (tmp_path / "depth.txt").write_text("2.0 depth/1.png")
    with pytest.raises(ibr.FileFormatError, match=r"no depth within 0.02 s of a colour image; the nearest is 1 s away"):
        recording_in(tmp_path)
    (tmp_path / "depth.txt").write_text("words")
    with pytest.raises(ibr.FileFormatError, match=r"depth.txt: not a readable list of images"):
        recording_in(tmp_path)
    touch(tmp_path, "dense/images/a.jpg", "dense/stereo/depth_maps/b.jpg.geometric.bin")
    with pytest.raises(ibr.FileFormatError, match=r"expected a depth map for an image, such as a.jpg.geometric.bin"):
        recording_in(tmp_path / "dense")


# ---- pairing of poses

K = {"width": 4, "height": 3, "fx": 5, "fy": 5, "cx": 1.5, "cy": 1}


@pytest.mark.parametrize(
    ("names", "times", "expected"),
    [
        ((0, 2, 3), (0, 1, 2, 3, 4), (0, 2, 3)),  # by number
        ((1, 2, 3), (0.0, 0.033, 0.067), (0, 1, 2)),  # in order: the times are no frame numbers
        (("5.00", "5.03", "5.06"), (5.031, 5.0, 5.5), (1, 0, None)),  # by time
        (("5.00", "5.03"), (0.0, 1.0), (0, 1)),  # in order: the times are another clock's
        ((0, 1, 7), (0, 1, 2, 3), (0, 1, None)),
        ((4, 5), (0, 1, 2), "a pose for each of 2 frames, got 3"),
    ],
)
def test_poses_go_by_time_or_number_or_in_order(tmp_path: Path, names, times, expected):
    touch(tmp_path, *(f"rgb/{name}.png" for name in names), *(f"depth/{name}.png" for name in names))
    (tmp_path / "camera.json").write_text(json.dumps(K))
    (tmp_path / "poses.txt").write_text("\n".join(f"{time} {k} 0 0 0 0 0 1" for k, time in enumerate(times)))
    recording = recording_in(tmp_path)
    if isinstance(expected, str):
        with pytest.raises(ibr.FileFormatError, match=expected):
            cameras_of(recording)
    else:
        found = [pose if pose is None else int(pose[0, 3]) for _, pose in cameras_of(recording)]
        assert found == list(expected)


# ---- real recordings: one frame's depth, warped with its poses, is the other frame's depth


REAL = {
    # by folder: focal length in pixels, depth units per metre, and the least error in its README, in metres
    "formats/tum_rgbd_fr1_rpy": (525.0, 5000, 0.0046),
    "formats/7scenes_tsdf_fusion": (585.0, 1000, 0.0051),
    "formats/redwood_open3d": (525.0, 1000, 0.0053),
    "rgbd_livingroom1": (525.0, 1000, 0.0006),
}


@pytest.mark.thorough
@pytest.mark.parametrize("name", REAL)
def test_poses_and_frames_of_real_recordings_belong_together(name):
    focal, scale, least = REAL[name]
    camera = ibr.Camera([[focal, 0, 319.5], [0, focal, 239.5], [0, 0, 1]], (640, 480))
    first, *_, last = ibr.load(shared(name), depth_scale=scale, camera=camera)
    frame = ibr.warp(first, last.camera)
    both = frame.valid & last.valid
    assert both.mean() > 0.3
    assert np.median(np.abs(frame.depth - last.depth)[both]) < 1.3 * least + 0.0005  # 0.0005: the README's rounding


@pytest.mark.thorough
def test_a_real_colmap_workspace():
    recording = recording_in(shared("formats/colmap_dense_binary"))
    assert names(recording) == [(f"image{k}.jpg", f"image{k}.jpg.geometric.bin") for k in ("07", "018", "019")]
    assert not recording.left_out


def test_a_depth_camera_moves_with_the_cameras_of_the_colours():
    first = ibr.Camera([[50, 0, 30], [0, 50, 18], [0, 0, 1]], (61, 37)).orbited(20, (0, 0, 2))
    cameras = [first.moved(0.1 * k, 0, 0).orbited(10 * k, (0, 0, 2)) for k in range(3)]
    beside = first.moved(0.05, 0, 0)
    recording = Recording([Path(f"{k}.png") for k in range(3)], [Path(f"d{k}.png") for k in range(3)])
    for shot in shots_of(recording, [(camera, camera.world_from_camera) for camera in cameras], beside):
        apart = shot.camera.camera_from_world @ shot.depth_camera.world_from_camera
        np.testing.assert_allclose(apart, first.camera_from_world @ beside.world_from_camera, atol=1e-12)
