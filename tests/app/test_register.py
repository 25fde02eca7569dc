"""`pyibr register` registers each frame of a recording as the library does; errors are one line."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import pyibr as ibr
from pyibr.app.commands.cameras import depth_camera_in
from pyibr.io.recordings import PLAIN
from pyibr.io.video import Video
from tests.app.commands import assert_one_line, run, succeeded
from tests.app.recorded import COUNT, SCALE, SIZE, Recorded

COLORS = ibr.Camera([[60, 0, 34], [0, 60, 22], [0, 0, 1]], (72, 44)).moved(0.05, 0.01, 0)


class Pair(Recorded):
    """A recording whose pictures come from a second camera, of another size, beside the depth camera."""

    def __init__(self) -> None:
        super().__init__()
        Path("poses.txt").rename("path.txt")  # not found as a trajectory
        COLORS.save("colors.json")
        rng = np.random.default_rng(1)
        self.pictures = [rng.integers(0, 256, (44, 72, 3), dtype=np.uint8) for _ in range(COUNT)]
        for number, picture in enumerate(self.pictures):
            ibr.write_color(f"rgb/{number}.png", picture)

    def register(self, *words: object, depth: str = "camera.json", color: str = "colors.json", output: str = "new.png"):
        """Run `pyibr register` with files of the two cameras."""
        cameras = ["--depth-camera", depth, "--color-camera", color]
        return run("register", *words, *cameras, scale=SCALE, output=output)

    def stored(self, depth: np.ndarray) -> np.ndarray:
        return ibr.depth_from_uint16(ibr.uint16_from_depth(depth, SCALE), SCALE)


@pytest.fixture
def pair(folder: Path) -> Pair:
    return Pair()


def test_of_several_cameras_that_of_the_depths_size_is_taken(tmp_path: Path):
    kinds = {"wide": (20, 10), "narrow": (13, 7)}
    rig = {name: {"width": w, "height": h, "fx": w, "fy": w, "cx": 6, "cy": 3} for name, (w, h) in kinds.items()}
    (tmp_path / "rig.json").write_text(json.dumps(rig))
    for name in ("d.png", "d.npy", "d.pfm"):
        ibr.write_depth(tmp_path / name, np.ones((7, 13), np.float32), depth_scale=1)
        assert depth_camera_in(tmp_path / "rig.json", tmp_path / name, PLAIN, COLORS, None).size == (13, 7)


assert_refused = partial(assert_one_line, progress="Registering")


@pytest.mark.parametrize("place", ["depth", "."])
def test_each_frame_of_depth_is_registered(pair: Pair, place):
    """Depth comes from a folder of depth, or from a folder with pictures and depth."""
    out = succeeded(pair.register(place))
    expected = [ibr.register(pair.depth(number), pair.base, COLORS) for number in range(COUNT)]
    for number, depth in enumerate(expected):
        made = ibr.read_depth(f"new_{number:04d}.png", depth_scale=SCALE)
        np.testing.assert_array_equal(made, pair.stored(depth))
    share = np.mean([np.isfinite(depth).mean() for depth in expected])
    assert f"new_0003.png: 4 frames, 72x44, {share:.1%} covered" in out
    assert not Path("new_0004.png").exists()
    succeeded(pair.register("depth", "--take", "0:1", "--far", 1.5))
    near = np.where(pair.depth(0) < 1.5, pair.depth(0), np.float32(np.nan))
    made = ibr.read_depth("new_0000.png", depth_scale=SCALE)
    np.testing.assert_array_equal(made, pair.stored(ibr.register(near, pair.base, COLORS)))


@pytest.mark.parametrize("words", [("depth", "--color", "rgb"), (".", "--color", "."), ("depth", "--color", "c.mkv")])
def test_each_frame_gets_its_colours(pair: Pair, words):
    """Colours come from a folder of pictures, a folder with pictures and depth, or a video."""
    ibr.write_video("c.mkv", pair.pictures, 12)
    out = succeeded(pair.register(*words, "--seen-out", "seen.png", "--take", "1:"))
    assert "3 frames, 62x38" in out
    for number in range(1, COUNT):
        found = ibr.register_color(pair.depth(number), pair.base, COLORS, pair.pictures[number])
        made = ibr.read_color(f"new_{number:04d}.png")
        np.testing.assert_array_equal(made, found.color)
        seen = ibr.read_color(f"seen_{number:04d}.png")[..., 0] == 255
        np.testing.assert_array_equal(seen, found.seen)


def test_colours_become_a_video(pair: Pair):
    succeeded(pair.register("depth", "--color", "rgb", output="new.mkv"))
    made = Video("new.mkv")
    for number, color in enumerate(made.frames(range(COUNT))):
        found = ibr.register_color(pair.depth(number), pair.base, COLORS, pair.pictures[number])
        np.testing.assert_array_equal(color, found.color)


def test_cleaning_knows_the_last_frame(pair: Pair):
    succeeded(pair.register("depth", "--clean"))
    last = None
    for number in range(COUNT):
        last = ibr.clean_depth(pair.depth(number), before=last).depth
        made = ibr.read_depth(f"new_{number:04d}.png", depth_scale=SCALE)
        np.testing.assert_array_equal(made, pair.stored(ibr.register(last, pair.base, COLORS)))


def test_frames_without_any_depth_are_empty_and_told(pair: Pair):
    for number in (0, 2):
        ibr.write_depth(f"depth/{number}.png", np.full(SIZE[::-1], np.nan, np.float32), depth_scale=SCALE)
    for words in ((), ("--color", "rgb")):
        result = pair.register("depth", "--clean", *words)
        succeeded(result)
        assert "2 of 4 frames are empty, as" in result.stderr and "their depth is out of view" in result.stderr
        for number in range(COUNT):
            assert ibr.read_color(f"new_{number:04d}.png").any() == (number in (1, 3))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("rgb/0.png", "--color", "rgb"), ("DEPTH: expected a folder", "rgb")),
        (("depth", "--color", "rgb/0.png"), ("depth: expected a file, got a folder",)),
        (("depth/0.png", "--take", "0:1"), ("--take: expected a recording", "single pictures")),
        (("depth", "--take", "9:"), ("--take: expected some of the 4 frames",)),
        (("cameras",), ("cameras: no file of depth in it",)),
        (("none.png",), ("none.png: no such file",)),
        (("depth", "--seen-out", "s.png"), ("--seen-out: expected --color with it",)),
        (("depth", "--color", "few"), ("depth: expected", "a depth for each of the 2 frames of colour")),
    ],
)  # fmt: skip
def test_mistakes_are_told_in_one_line(pair: Pair, words, said):
    for number in (0, 1):
        ibr.write_color(f"few/a_{number}_{number}.png", pair.pictures[0])
    assert_refused(pair.register(*words), *said)
    assert not list(Path().glob("new*"))


def test_a_frame_of_another_size_is_left_out_and_named(pair: Pair):
    ibr.write_depth("depth/2.png", pair.depth(2)[:20], depth_scale=SCALE)
    result = pair.register("depth")
    assert "3 frames" in succeeded(result) and not Path("new_0002.png").exists()
    assert "depth/2.png: depth: expected" in result.stderr and "(38, 62)" in result.stderr


def test_nothing_that_is_read_is_overwritten(pair: Pair):
    for number in range(COUNT):
        Path(f"depth/{number}.png").rename(f"depth/d_{number:04d}.png")
    assert_refused(pair.register("depth", output="depth/d.png"), "--output: expected a file of its own", "DEPTH")


@pytest.mark.parametrize("torn", ["depth", "rgb"])
def test_frames_that_cannot_be_read_are_left_out_and_told(pair: Pair, torn: str):
    Path(f"{torn}/1.png").write_bytes(b"torn")
    result = pair.register("depth", "--color", "rgb")
    assert "3 frames" in succeeded(result) and "1 file cannot be used; left out: " in result.stderr
    for number in (0, 2, 3):
        found = ibr.register_color(pair.depth(number), pair.base, COLORS, pair.pictures[number])
        np.testing.assert_array_equal(ibr.read_color(f"new_{number:04d}.png"), found.color)


def test_two_cameras_at_the_origin_are_told_once_and_extrinsics_set_them_apart(pair: Pair):
    """RealSense's calibrations lack the pose between the cameras; a file of its own gives it."""
    for name, camera in {"depth": pair.base, "color": COLORS}.items():
        data = {"width": camera.width, "height": camera.height, "fx": camera.K[0, 0], "fy": camera.K[1, 1]}
        data |= {"ppx": camera.K[0, 2], "ppy": camera.K[1, 2]}
        Path(f"{name}_intrinsics.json").write_text(json.dumps(data))
    moved = COLORS.camera_from_world @ pair.base.world_from_camera
    told = {"rot": moved[:3, :3].T.ravel().tolist(), "tran": moved[:3, 3].tolist()}
    Path("extrinsics.json").write_text(json.dumps(told))
    cameras = {"depth": "depth_intrinsics.json", "color": "color_intrinsics.json"}
    plain = pair.register("depth", **cameras)
    succeeded(plain)
    assert plain.stderr.count("the cameras of depth and colour differ, but both stand at the origin") == 1
    assert plain.stderr.count("--extrinsics") == 1
    apart = pair.register("depth", "--extrinsics", "extrinsics.json", **cameras)
    succeeded(apart)
    assert "origin" not in apart.stderr
    for number in range(COUNT):
        made = ibr.read_depth(f"new_{number:04d}.png", depth_scale=SCALE)
        expected = pair.stored(ibr.register(pair.depth(number), pair.base, COLORS))
        assert np.isclose(made, expected, rtol=1e-3, equal_nan=True).mean() > 0.99  # the frames differ by rounding
