"""`pyibr warp` of several sources, recordings and videos: the same as the library's calls; mistakes in one line."""

from __future__ import annotations

import json
import re
import signal
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import pyibr as ibr
from pyibr.app.cli import app
from pyibr.io.depth_frames import DepthFrames
from pyibr.io.video import Video
from pyibr.io.video_writing import VideoWriter
from tests.app.browser import until
from tests.data import shared
from tests.processes import with_path

SIZE = (62, 38)
COUNT = 4
SCALE = 1000
runner = CliRunner()


class Recorded:
    """A wall and a box before it, in files: a camera that goes to the right by 2 cm a frame."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.base = ibr.Camera([[50, 0, 30], [0, 50, 18], [0, 0, 1]], SIZE)
        self.cameras = [self.base.moved(0.02 * number, 0, 0) for number in range(COUNT)]
        rng = np.random.default_rng(0)
        self.colors = [rng.integers(0, 256, (*SIZE[::-1], 3), dtype=np.uint8) for _ in range(COUNT)]
        self.depths: list[np.ndarray] = []
        for number in range(COUNT):
            depth = np.full(SIZE[::-1], 2, np.float32) + rng.integers(-9, 10, SIZE[::-1]).astype(np.float32) / SCALE
            depth[10:25, 20 - number : 40 - number] = 1
            depth[rng.random(depth.shape) < 0.05] = np.nan
            self.depths.append(depth)
            ibr.write_color(folder / f"rgb/{number}.png", self.colors[number])
            ibr.write_depth(folder / f"depth/{number}.png", depth, depth_scale=SCALE)
            self.cameras[number].save(folder / f"cameras/{number}.json")
        self.base.save(folder / "camera.json")
        rows = [" ".join(map(str, camera.world_from_camera[:3].ravel())) for camera in self.cameras]
        (folder / "poses.txt").write_text("\n".join(rows))

    def views(self) -> list[ibr.DepthImage]:
        read = [ibr.read_depth(self.folder / f"depth/{number}.png", depth_scale=SCALE) for number in range(COUNT)]
        return [ibr.DepthImage(*frame) for frame in zip(self.colors, read, self.cameras, strict=True)]

    def views_but(self, lost: int) -> list[ibr.DepthImage]:
        """The views of the frames that can be read."""
        read = [number for number in range(COUNT) if number != lost]
        depths = [ibr.read_depth(self.folder / f"depth/{number}.png", depth_scale=SCALE) for number in read]
        return [ibr.DepthImage(self.colors[k], z, self.cameras[k]) for k, z in zip(read, depths, strict=True)]

    def run(self, *words: object, camera: object = "camera.json", output: object = "new.png"):
        """Words that name a file of the folder are its paths."""
        places = [str(self.folder / str(word)) if (self.folder / str(word)).exists() else str(word) for word in words]
        places += ["--camera", str(self.folder / str(camera))] if camera else []
        return runner.invoke(app, ["warp", *places, "--depth-scale", str(SCALE), "-o", str(self.folder / str(output))])

    def new(self, number: int) -> np.ndarray:
        return ibr.read_color(self.folder / f"new_{number:04d}.png")


@pytest.fixture
def recorded(tmp_path: Path) -> Recorded:
    return Recorded(tmp_path)


def succeeded(result) -> str:
    assert result.exit_code == 0, result.output
    return result.stdout


def assert_one_line(result, *words: str, progress: str = "Warping") -> None:
    assert result.exit_code == 2, result.output
    *above, line = result.stderr.strip().splitlines()
    assert line.startswith("pyibr: ") and all(progress in one for one in above), result.stderr
    for word in words:
        assert word in line, result.stderr


# ---- several sources of one scene


@pytest.mark.parametrize("blend", ["quality", "nearest"])
def test_pairs_become_one_view(recorded: Recorded, blend):
    pairs = ("rgb/0.png", "depth/0.png", "rgb/3.png", "depth/3.png")
    cameras = ("--camera", "cameras/0.json", "--camera", "cameras/3.json")
    out = succeeded(recorded.run(*pairs, *cameras, "--to", "cameras/1.json", "--blend", blend, camera=None))
    views = recorded.views()
    expected = ibr.warp([views[0], views[3]], recorded.cameras[1], blend=blend)
    np.testing.assert_array_equal(ibr.read_color(recorded.folder / "new.png"), expected.color)
    assert f"new.png: 62x38, {expected.valid.mean():.1%} covered" in out


@pytest.mark.parametrize("kind", ["list", "folder", "poses"])
def test_cameras_of_pairs_in_other_forms(recorded: Recorded, kind):
    listed = [json.loads((recorded.folder / f"cameras/{number}.json").read_text()) for number in (0, 3)]
    (recorded.folder / "list.json").write_text(json.dumps(listed))
    text = (recorded.folder / "poses.txt").read_text().splitlines()
    (recorded.folder / "two.txt").write_text("\n".join([text[0], text[3]]))
    asked = {"list": ("--camera", "list.json"), "folder": ("--camera", "cameras")}
    asked["poses"] = ("--camera", "camera.json", "--poses", "two.txt")
    pairs = ("rgb/0.png", "depth/0.png", "rgb/3.png", "depth/3.png")
    succeeded(recorded.run(*pairs, *asked[kind], "--to", "cameras/1.json", camera=None))
    views = recorded.views()
    expected = ibr.warp([views[0], views[3]], recorded.cameras[1])
    np.testing.assert_array_equal(ibr.read_color(recorded.folder / "new.png"), expected.color)


def test_all_frames_of_a_recording_together(recorded: Recorded):
    out = succeeded(recorded.run("rgb", "depth", "--together", "--poses", "poses.txt", "--move", 0.05, 0, 0))
    expected = ibr.warp(recorded.views(), recorded.base.moved(0.05, 0, 0))
    np.testing.assert_array_equal(ibr.read_color(recorded.folder / "new.png"), expected.color)
    assert "new.png: 62x38" in out
    taken = ("--take", "1::2", "--poses", "poses.txt")
    out = succeeded(recorded.run("rgb", "depth", "--together", *taken, "--orbit", 5, "--frames", 3))
    views = recorded.views()[1::2]
    pivot = views[0].camera.center + views[0].camera.forward * np.median(views[0].depth[views[0].valid])
    expected = ibr.warp(views, views[0].camera.orbited(2.5, pivot))
    np.testing.assert_array_equal(recorded.new(1), expected.color)
    assert "new_0002.png: 3 views" in out and not (recorded.folder / "new_0003.png").exists()


# ---- frame by frame


@pytest.mark.parametrize("cameras", [("--camera", "cameras"), ("--camera", "camera.json", "--poses", "poses.txt")])
def test_a_recording_gives_a_view_for_each_frame(recorded: Recorded, cameras):
    asked = (*cameras, "--move", 0.1, 0, 0.2, "--fill", "background", "--depth-out", recorded.folder / "z.npy")
    out = succeeded(recorded.run("rgb", "depth", *asked, "--valid-out", recorded.folder / "v.png", camera=None))
    for number, view in enumerate(recorded.views()):
        expected = ibr.warp(view, view.camera.moved(0.1, 0, 0.2), fill="background")
        np.testing.assert_array_equal(recorded.new(number), expected.color)
        stored = ibr.read_depth(recorded.folder / f"z_{number:04d}.npy", depth_scale=SCALE)
        np.testing.assert_allclose(stored, expected.depth, rtol=1e-6)
        valid = ibr.read_color(recorded.folder / f"v_{number:04d}.png")[..., 0] == 255
        np.testing.assert_array_equal(valid, expected.valid)
    assert f"new_0000.png to {recorded.folder}/new_0003.png: 4 views, 62x38" in out.replace("\n", "")
    assert not (recorded.folder / "new_0004.png").exists()


def test_a_recording_without_a_camera_gets_one_that_is_told(recorded: Recorded):
    """Also a folder that has another, in the page's command and the library, too."""
    wide = ibr.Camera.from_fov(SIZE, fov_x=90)
    succeeded(recorded.run("rgb", "depth", "--fov", 90, "--poses", "poses.txt", "--move", 0.1, 0, 0, camera=None))
    succeeded(recorded.run(recorded.folder, "--fov", 90, "--move", 0.1, 0, 0, camera=None, output="folder.png"))
    for number, view in enumerate(recorded.views()):
        own = ibr.Camera(wide.K, SIZE, view.camera.world_from_camera)
        expected = ibr.warp(ibr.DepthImage(view.color, view.depth, own), own.moved(0.1, 0, 0)).color
        np.testing.assert_array_equal(recorded.new(number), expected)
        np.testing.assert_array_equal(ibr.read_color(recorded.folder / f"folder_{number:04d}.png"), expected)
        assert ibr.load(recorded.folder, depth_scale=SCALE, camera=wide)[number].camera == own
    pairs = [f"{kind}/{k}.png" for k in (0, 1) for kind in ("rgb", "depth")]
    result = recorded.run(*pairs, "--fov", 90, "--move", 0, 0, 0, camera=None)
    assert_one_line(result, "--fov, --focal-35mm: expected a single picture, or a recording, got 2 pictures")


@pytest.mark.parametrize("kind", ["camera.json", "intrinsics.K.txt", "frame by frame"])
def test_a_folder_that_has_all(recorded: Recorded, kind):
    """Its cameras and poses are found, by the library, too."""
    if kind != "camera.json":
        (recorded.folder / "camera.json").unlink()
    if kind == "intrinsics.K.txt":
        np.savetxt(recorded.folder / kind, recorded.base.K)
    if kind == "frame by frame":
        (recorded.folder / "cameras").rename(recorded.folder / "camera")
        (recorded.folder / "poses.txt").unlink()
    succeeded(recorded.run(recorded.folder, "--move", 0.1, 0, 0.2, camera=None))
    loaded = ibr.load(recorded.folder, depth_scale=SCALE)
    for number, (view, own) in enumerate(zip(recorded.views(), loaded, strict=True)):
        np.testing.assert_array_equal(recorded.new(number), ibr.warp(view, view.camera.moved(0.1, 0, 0.2)).color)
        np.testing.assert_array_equal(own.color, view.color)
        np.testing.assert_array_equal(own.depth, view.depth)
        assert own.camera == view.camera


def test_frames_without_depth_or_pose_of_their_time_are_left_out_and_told(recorded: Recorded):
    """As in the TUM data sets: lists with times, and a trajectory of its own times."""
    listed = {"rgb": [f"{k}.00 rgb/{k}.png" for k in range(4)], "depth": [f"{k}.01 depth/{k}.png" for k in (0, 2, 3)]}
    for name, lines in listed.items():
        (recorded.folder / f"{name}.txt").write_text("# a list\n" + "\n".join(lines))
    poses = [f"{k}.005 {0.02 * k} 0 0 0 0 0 1" for k in (1, 2, 3)]
    (recorded.folder / "groundtruth.txt").write_text("\n".join(poses))
    result = recorded.run(recorded.folder, "--move", 0.1, 0, 0)
    assert "2 views" in succeeded(result)
    assert re.search("1 picture of .*rgb: no depth of its time; left out", result.stderr)
    assert re.search("1 picture of .*rgb: no pose of its time; left out", result.stderr)
    for number, view in enumerate(recorded.views()[2:], start=2):  # their numbers
        np.testing.assert_array_equal(recorded.new(number), ibr.warp(view, view.camera.moved(0.1, 0, 0)).color)


@pytest.mark.parametrize("words", [["--camera", "cameras"], ["--camera", "camera.json", "--poses", "poses.txt"]])
def test_lost_frames_are_left_out_and_told(recorded: Recorded, words):
    """Cameras by the pictures' names, or poses in the order of all frames that there were."""
    views = recorded.views()
    (recorded.folder / "depth/1.png").unlink()
    result = recorded.run("rgb", "depth", "--move", 0.1, 0, 0, *words, camera=None)
    assert "3 views" in succeeded(result)
    assert re.search("1 file of .*rgb and .*depth, 1.png: no partner by name or number; left out", result.stderr)
    for number, view in zip((0, 2, 3), (views[0], *views[2:]), strict=True):  # their numbers
        np.testing.assert_array_equal(recorded.new(number), ibr.warp(view, view.camera.moved(0.1, 0, 0)).color)


def test_the_pivot_of_a_recording_is_that_of_its_first_frame(recorded: Recorded):
    succeeded(recorded.run("rgb", "depth", "--orbit", 10))
    views = recorded.views()
    distance = np.median(views[0].depth[views[0].valid])
    for number, view in enumerate(views):
        still = ibr.DepthImage(view.color, view.depth, recorded.base)
        target = recorded.base.orbited(10, recorded.base.center + recorded.base.forward * distance)
        np.testing.assert_array_equal(recorded.new(number), ibr.warp(still, target).color)


@pytest.mark.parametrize("to", ["cameras/2.json", "cameras"])
def test_a_recording_seen_from_given_cameras(recorded: Recorded, to):
    succeeded(recorded.run("rgb", "depth", "--poses", "poses.txt", "--to", to))
    for number, view in enumerate(recorded.views()):
        target = recorded.cameras[number if to == "cameras" else 2]
        np.testing.assert_array_equal(recorded.new(number), ibr.warp(view, target).color)


def test_recordings_of_several_cameras_go_frame_by_frame(recorded: Recorded):
    sources = ("rgb", "depth", "rgb", "depth", "--camera", "camera.json", "--camera", "cameras/3.json")
    succeeded(recorded.run(*sources, "--take", "1:3", "--to", "cameras/1.json", camera=None))
    for number in (1, 2):
        view = recorded.views()[number]
        pair = [ibr.DepthImage(view.color, view.depth, camera) for camera in (recorded.base, recorded.cameras[3])]
        np.testing.assert_array_equal(recorded.new(number), ibr.warp(pair, recorded.cameras[1]).color)


def test_clean_is_steady_and_carried_along(recorded: Recorded):
    asked = ("--poses", "poses.txt", "--clean", "--move", 0, 0, 0.1, "--depth-out", recorded.folder / "z.npy")
    succeeded(recorded.run("rgb", "depth", *asked))
    last = None
    for number, view in enumerate(recorded.views()):
        before = None if last is None else ibr.warp(last, view.camera).depth
        depth = ibr.clean_depth(view.depth, view.color, before=before).depth
        last = ibr.DepthImage(None, depth, view.camera)
        frame = ibr.warp(ibr.DepthImage(view.color, depth, view.camera), view.camera.moved(0, 0, 0.1))
        np.testing.assert_array_equal(recorded.new(number), frame.color)
    succeeded(recorded.run("rgb/3.png", "depth/3.png", "--clean", "--holes", 3, "--move", 0, 0, 0.1))
    view = recorded.views()[3]
    alone = ibr.DepthImage(view.color, ibr.clean_depth(view.depth, view.color, holes=3).depth, recorded.base)
    frame = ibr.warp(alone, recorded.base.moved(0, 0, 0.1))
    np.testing.assert_array_equal(ibr.read_color(recorded.folder / "new.png"), frame.color)


def test_depth_of_another_camera_is_registered(recorded: Recorded):
    beside = ibr.Camera([[45, 0, 29], [0, 45, 19], [0, 0, 1]], SIZE).moved(0.05, 0.01, 0)
    beside.save(recorded.folder / "beside.json")
    asked = ("--depth-camera", "beside.json", "--poses", "poses.txt", "--to", "cameras/2.json")
    succeeded(recorded.run("rgb", "depth", *asked))
    for number, view in enumerate(recorded.views()):
        depth = ibr.register(view.depth, beside, recorded.base)
        frame = ibr.warp(ibr.DepthImage(view.color, depth, view.camera), recorded.cameras[2])
        # The rig is moved as a whole: to rounding, what the cameras see at one place they see at another.
        assert np.abs(recorded.new(number).astype(int) - frame.color).mean() < 0.05
    succeeded(recorded.run("rgb/1.png", "depth/1.png", "--depth-camera", "beside.json", "--move", 0, 0, 0))
    view = recorded.views()[1]
    depth = ibr.register(view.depth, beside, recorded.base)
    frame = ibr.warp(ibr.DepthImage(view.color, depth, recorded.base), recorded.base)
    np.testing.assert_array_equal(ibr.read_color(recorded.folder / "new.png"), frame.color)


def test_frames_without_any_depth_are_black_and_told(recorded: Recorded):
    for number in (0, 2):
        ibr.write_depth(
            recorded.folder / f"depth/{number}.png", np.full(SIZE[::-1], np.nan, np.float32), depth_scale=SCALE
        )
    asked = ("--clean", "--default-depth", "farthest", "--orbit", 3, "--fill", "background")
    result = recorded.run("rgb", "depth", *asked)
    succeeded(result)
    assert "2 of 4 views are empty" in result.stderr
    assert not recorded.new(0).any() and not recorded.new(2).any()
    assert recorded.new(1).any() and recorded.new(3).any()


# ---- videos


def test_a_video_and_a_folder_of_depth_become_a_video(recorded: Recorded):
    with VideoWriter(recorded.folder / "color.mkv", 12) as video:
        for color in recorded.colors:
            video.add(color)
    out = succeeded(recorded.run("color.mkv", "depth", "--poses", "poses.txt", "--move", 0.1, 0, 0, output="n.mkv"))
    made = Video(recorded.folder / "n.mkv")
    assert "n.mkv: 4 views, 62x38" in out and made.fps == 12
    for view, color in zip(recorded.views(), made.frames(range(COUNT)), strict=True):
        np.testing.assert_array_equal(color, ibr.warp(view, view.camera.moved(0.1, 0, 0)).color)
    asked = ("--take", "1:4:2", "--fps", 5, "--move", 0, 0, 0)
    succeeded(recorded.run("color.mkv", "depth", *asked, output="few.mkv"))
    made = Video(recorded.folder / "few.mkv")
    assert len(made) == 2 and made.fps == 5
    view = recorded.views()[3]
    frame = ibr.warp(ibr.DepthImage(view.color, view.depth, recorded.base), recorded.base)
    np.testing.assert_array_equal(next(made.frames([1])), frame.color)


@pytest.mark.parametrize("depth", ["depth.mkv", "depth.npy", "depth.npz"])
@pytest.mark.parametrize("color", ["rgb", "color.mkv"])
def test_depth_of_all_frames_in_one_file(recorded: Recorded, color, depth):
    """The same views as of single files; what is drawn and registered is written with its depth as a video."""
    stored = np.stack([ibr.uint16_from_depth(one, SCALE) for one in recorded.depths])
    path = recorded.folder / depth
    if depth == "depth.mkv":
        ibr.write_video(path, stored, 30, bits=16)
    else:
        (np.save if depth.endswith("npy") else np.savez_compressed)(path, stored)
    ibr.write_video(recorded.folder / "color.mkv", recorded.colors, 30)
    out = recorded.folder / "out.mkv"
    succeeded(recorded.run(color, depth, "--take", "1:", "--move", 0.1, 0, 0, "--depth-out", out))
    depths = list(DepthFrames(out).read(range(3), depth_scale=SCALE))
    views = [ibr.DepthImage(view.color, view.depth, recorded.base) for view in recorded.views()]
    for number, view in enumerate(views[1:], 1):
        frame = ibr.warp(view, recorded.base.moved(0.1, 0, 0))
        np.testing.assert_array_equal(recorded.new(number), frame.color)
        np.testing.assert_allclose(depths[number - 1], np.where(frame.valid, frame.depth, np.nan), atol=0.51 / SCALE)
    camera = ("--depth-camera", recorded.folder / "camera.json", "--color-camera", recorded.folder / "camera.json")
    words = ("register", path, *camera, "--depth-scale", SCALE, "--take", "2:", "-o", out)
    succeeded(runner.invoke(app, [str(word) for word in words]))
    registered = ibr.register(views[3].depth, recorded.base, recorded.base)
    np.testing.assert_allclose(next(DepthFrames(out).read([1], depth_scale=SCALE)), registered, atol=0.51 / SCALE)


def test_a_path_becomes_a_video(recorded: Recorded):
    succeeded(recorded.run("rgb/0.png", "depth/0.png", "--orbit", 10, "--frames", 5, output="path.mp4"))
    made = Video(recorded.folder / "path.mp4")
    assert len(made) == 5 and made.fps == 30


# ---- mistakes


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("rgb", "--move", 0, 0, 0), ("rgb: neither frusta.json nor frames", "files with color and depth")),
        (("rgb/0.png", "--move", 0, 0, 0), ("expected COLOR and DEPTH", "0.png")),
        (("rgb/0.png", "depth/0.png", "rgb/1.png", "--move", 0, 0, 0), ("COLOR and DEPTH", "3 paths")),
        (("rgb", "depth/0.png", "--move", 0, 0, 0), ("DEPTH: expected a folder",)),
        (("rgb/0.png", "depth", "--move", 0, 0, 0), ("depth: expected a file, got a folder",)),
        (("rgb", "depth", "rgb/0.png", "depth/0.png", "--move", 0, 0, 0), ("all recordings, or all single",)),
        (("rgb/0.png", "depth/0.png") * 2 + ("--move", 0, 0, 0), ("camera.json: expected a camera for each",)),
        (("rgb", "depth", "--move", 0, 0, 0, "--frames", 3), ("--frames: expected 1 for a recording",)),
        (("rgb", "depth", "--move", 0, 0, 0, "--take", "7:9"), ("--take: expected some of the 4 frames",)),
        (("rgb", "depth", "--move", 0, 0, 0, "--take", "x"), ("--take: expected START:STOP",)),
        (("rgb", "depth", "--move", 0, 0, 0, "--take", "3:0:-1"), ("--take: expected START:STOP",)),
        (("rgb/0.png", "depth/0.png", "--move", 0, 0, 0, "--take", "0:1"), ("--take", "single pictures")),
        (("rgb", "depth", "--move", 0, 0, 0, "--fps", 20), ("--fps: expected a video",)),
        (("rgb", "depth", "--move", 0, 0, 0, "--poses", "none.txt"), ("none.txt: no such file",)),
        (("rgb", "depth", "--move", 0, 0, 0, "--poses", "three.txt"), ("three.txt: expected a pose for each",)),
        (("rgb", "depth", "--to", "three.json"), ("--to: expected one camera, or one for each of the 4", "3")),
        (("rgb", "depth", "--to", "camera.json", "--camera", "three.json"), ("three.json: expected a camera",)),
        (("torn.mp4", "depth", "--move", 0, 0, 0), ("torn.mp4: not a readable video file",)),
        (("rgb", "depth", "--move", 0, 0, 0, "--depth-camera", "none.json"), ("none.json: no such file",)),
        (("none", "depth", "--move", 0, 0, 0), ("none: no such file",)),
    ],
)  # fmt: skip
def test_mistakes_are_told_in_one_line(recorded: Recorded, words, said):
    (recorded.folder / "torn.mp4").write_bytes(b"words " * 99)
    listed = [json.loads((recorded.folder / f"cameras/{number}.json").read_text()) for number in range(3)]
    (recorded.folder / "three.json").write_text(json.dumps(listed))
    lines = (recorded.folder / "poses.txt").read_text().splitlines()
    (recorded.folder / "three.txt").write_text("\n".join(lines[:3]))
    camera = None if "--camera" in words else "camera.json"
    assert_one_line(recorded.run(*words, camera=camera), *said)
    assert not list(recorded.folder.glob("new*"))


def test_frames_that_lack_a_file_are_named(recorded: Recorded):
    move = ("--move", 0, 0, 0)
    assert_one_line(recorded.run("rgb", "depth", *move, camera=None), "--camera: expected a file", "none for", "0.png")
    for number in (1, 2, 3):
        (recorded.folder / f"depth/{number}.png").rename(recorded.folder / f"depth/{number + 3}.png")
    assert_one_line(recorded.run("rgb", "depth", *move), "1.png without depth")
    for number in (1, 2, 3):
        (recorded.folder / f"depth/{number + 3}.png").rename(recorded.folder / f"depth/{number}.png")


@pytest.mark.parametrize("words", [("rgb", "depth"), ("rgb", "depth", "--together"), ("rgb", "depth", "--clean")])
def test_frames_that_cannot_be_read_are_left_out_and_told(recorded: Recorded, words):
    whole = (recorded.folder / "depth/1.png").read_bytes()
    (recorded.folder / "depth/1.png").write_bytes(whole[:90])
    result = recorded.run(*words, "--poses", "poses.txt", "--to", "cameras")
    succeeded(result)
    assert re.search("1 file cannot be used; left out: .*depth/1.png: not a readable image file", result.stderr)
    if words == ("rgb", "depth"):
        assert "3 views" in result.stdout and not (recorded.folder / "new_0001.png").exists()
        for number, view in zip((0, 2, 3), recorded.views_but(1), strict=True):
            np.testing.assert_array_equal(recorded.new(number), ibr.warp(view, view.camera).color)
    (recorded.folder / "rgb/3.png").write_bytes(b"torn")
    result = recorded.run(*words, "--poses", "poses.txt", "--move", 0, 0, 0)
    succeeded(result)
    assert "2 files cannot be used; left out: " in result.stderr


def test_of_several_recordings_those_that_can_be_read_are_shown(recorded: Recorded):
    ibr.write_depth(recorded.folder / "other/1.png", recorded.depths[1], depth_scale=SCALE)
    for number in (0, 2, 3):
        (recorded.folder / f"other/{number}.png").write_bytes(b"torn")
    sources = ("rgb", "depth", "rgb", "other", "--camera", "cameras/0.json", "--camera", "cameras/3.json")
    succeeded(recorded.run(*sources, "--to", "cameras", camera=None))
    for number, view in enumerate(recorded.views()):
        views = [ibr.DepthImage(view.color, view.depth, recorded.cameras[0])]
        if number == 1:
            views.append(ibr.DepthImage(view.color, view.depth, recorded.cameras[3]))
        expected = ibr.warp(views if number == 1 else views[0], recorded.cameras[number])
        np.testing.assert_array_equal(recorded.new(number), expected.color)


def test_a_recording_of_which_nothing_can_be_read(recorded: Recorded):
    for number in range(COUNT):
        (recorded.folder / f"depth/{number}.png").write_bytes(b"torn")
    for words in (("--move", 0, 0, 0), ("--together", "--poses", "poses.txt", "--orbit", 5)):
        for output in ("n.mp4", "new.png"):
            if output == "new.png" or "--together" not in words:
                assert_one_line(recorded.run("rgb", "depth", *words, output=output), "depth/0.png: not a readable")
                assert not (recorded.folder / output).exists()


def test_a_frame_of_another_size_is_left_out_and_named(recorded: Recorded):
    ibr.write_color(recorded.folder / "rgb/2.png", recorded.colors[2][:20])
    for words in ((), ("--clean",)):
        result = recorded.run("rgb", "depth", "--move", 0, 0, 0, *words)
        assert "3 views" in succeeded(result) and not (recorded.folder / "new_0002.png").exists()
        assert re.search("1 file cannot be used; left out: .*rgb/2.png with .*color: expected", result.stderr)
    for number in range(COUNT):
        ibr.write_color(recorded.folder / f"rgb/{number}.png", recorded.colors[number][:20])
    assert_one_line(recorded.run("rgb", "depth", "--move", 0, 0, 0), "rgb/0.png with", "color: expected", "(38, 62, 3)")


def test_no_output_lies_within_a_recording(recorded: Recorded):
    for words, output in (
        (("rgb", "depth"), "depth/n.png"),
        ((recorded.folder,), "rgb/n.png"),
        ((recorded.folder,), "o/n.png"),
    ):
        result = recorded.run(*words, "--move", 0, 0, 0, output=output)
        assert_one_line(result, "--output: expected a place outside of the recording", output)
        assert not list(recorded.folder.rglob("n*.png"))


def test_all_frames_together_need_poses(recorded: Recorded):
    assert_one_line(
        recorded.run("rgb", "depth", "--together", "--orbit", 5), "--together: expected frames whose places"
    )


def test_frames_keep_their_numbers(recorded: Recorded):
    """Those in their names, of frames that are taken and that are not lost; what is there is left as it is."""
    for kind, number in (("rgb", 3), ("depth", 3)):
        (recorded.folder / f"{kind}/{number}.png").rename(recorded.folder / f"{kind}/17.png")
    (recorded.folder / "pose").mkdir()
    for number in (0, 1, 2, 17):
        pose = np.full((4, 4), -np.inf) if number == 2 else np.eye(4)
        np.savetxt(recorded.folder / f"pose/{number}.txt", pose)
    result = recorded.run("rgb", "depth", "--poses", "pose", "--take", "1:", "--move", 0, 0, 0)
    assert "2 views" in succeeded(result) and "1 picture of" in result.stderr and "no usable pose" in result.stderr
    assert sorted(path.name for path in recorded.folder.glob("new*")) == ["new_0001.png", "new_0017.png"]
    for number, color in ((1, recorded.colors[1]), (17, recorded.colors[3])):
        seen = recorded.new(number).any(axis=2)
        assert seen.mean() > 0.8
        np.testing.assert_array_equal(recorded.new(number)[seen], color[seen])
    (recorded.folder / "new_0001.png").write_bytes(b"mine")
    (recorded.folder / "new_0017.png").unlink()
    asked = ("--poses", "pose", "--move", 0, 0, 0, "--skip-existing")
    assert "2 views" in succeeded(recorded.run("rgb", "depth", *asked))
    assert (recorded.folder / "new_0001.png").read_bytes() == b"mine" and recorded.new(17).any()
    assert "all of it is there already" in succeeded(recorded.run("rgb", "depth", *asked))


def test_a_video_of_another_length(recorded: Recorded):
    with VideoWriter(recorded.folder / "color.mkv", 12) as video:
        for color in recorded.colors[:3]:
            video.add(color)
    result = recorded.run("color.mkv", "depth", "--move", 0, 0, 0)
    assert_one_line(result, "depth: expected a depth for each of the 3 frames of colour, got 4 of depth")


def test_no_output_is_a_frame_that_is_read(recorded: Recorded):
    for number in range(COUNT):
        (recorded.folder / f"rgb/{number}.png").rename(recorded.folder / f"rgb/new_{number:04d}.png")
    before = (recorded.folder / "rgb/new_0002.png").read_bytes()
    assert_one_line(recorded.run("rgb", "depth", "--move", 0, 0, 0, output="rgb/new.png"), "which is COLOR's too")
    assert (recorded.folder / "rgb/new_0002.png").read_bytes() == before


def write_model(folder: Path, names: list[str]) -> None:
    """A COLMAP model in the binary form: images side by side, by one camera."""
    folder.mkdir(parents=True)
    (folder / "cameras.bin").write_bytes(struct.pack("<QiiQQ4d", 1, 1, 1, *SIZE, 50, 50, 30.5, 18.5))
    heads = [struct.pack("<i7di", 1, 1, 0, 0, 0, 0.01 * k, 0, 0, 1) for k in range(len(names))]
    images = [head + name.encode() + struct.pack("<xQ", 0) for head, name in zip(heads, names, strict=True)]
    (folder / "images.bin").write_bytes(struct.pack("<Q", len(names)) + b"".join(images))


@pytest.mark.parametrize("name", ["cameras.bin", "images.bin"])
def test_no_output_is_a_file_of_a_model_that_is_read(recorded: Recorded, name: str):
    """A COLMAP model is named by its folder, or found in a recording; its files have the suffix of COLMAP's depth."""
    write_model(recorded.folder / "one", ["0.png"])
    write_model(recorded.folder / "work/sparse/0", [f"{number}.png" for number in range(COUNT)])
    for number in range(COUNT):
        ibr.write_color(recorded.folder / f"work/images/{number}.png", recorded.colors[number])
        ibr.write_depth(recorded.folder / f"work/stereo/depth_maps/{number}.png.geometric.bin", recorded.depths[number])
    cases = [
        ("one", ("rgb/0.png", "depth/0.png", "--to", "one"), "camera.json", "--to's too"),
        ("one", ("rgb/0.png", "depth/0.png", "--orbit", 5), "one", "--camera's too"),
        ("work/sparse/0", ("work", "--together", "--orbit", 5), None, "the recording's too"),
    ]
    for model, words, camera, said in cases:
        file = recorded.folder / model / name
        before = file.read_bytes()
        for place in (file, recorded.folder / "rgb" / ".." / model / name):
            result = recorded.run(*words, "--depth-out", place, camera=camera)
            assert_one_line(result, "--depth-out: expected a file of its own, got", said)
        assert file.read_bytes() == before
        free = file.with_name("new.bin") if words[0] != "work" else recorded.folder / "new.bin"
        succeeded(recorded.run(*words, "--depth-out", free, camera=camera))


def test_a_video_that_fails_leaves_nothing(recorded: Recorded):
    for number in range(COUNT):
        ibr.write_depth(recorded.folder / f"depth/{number}.png", recorded.depths[number][:20], depth_scale=SCALE)
    assert_one_line(recorded.run("rgb", "depth", "--move", 0, 0, 0, output="n.mp4"), "depth")
    assert not (recorded.folder / "n.mp4").exists()


# ---- real ones


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("name", "focal", "scale"),
    [
        ("formats/tum_rgbd_fr1_rpy", 525, 5000),
        ("formats/7scenes_tsdf_fusion", 585, 1000),
        ("formats/redwood_open3d", 525, 1000),
    ],
)
def test_real_recordings(tmp_path: Path, name, focal, scale):
    folder = shared(name)
    camera = {"width": 640, "height": 480, "fx": focal, "fy": focal, "cx": 319.5, "cy": 239.5}
    (tmp_path / "camera.json").write_text(json.dumps(camera))
    shown = [
        "warp",
        folder,
        "--camera",
        tmp_path / "camera.json",
        "--depth-scale",
        scale,
        "--together",
        "--move",
        0,
        0,
        0,
    ]
    out = succeeded(runner.invoke(app, [str(word) for word in (*shown, "-o", tmp_path / "new.png")]))
    assert float(out.split("480, ")[1].split("%")[0]) > 60
    # The first frame's camera sees the first frame's picture, and around its holes the others'.
    color = next(iter(sorted([*folder.glob("**/*color*.jpg"), *folder.glob("rgb/*"), *folder.glob("color/*")])))
    made = ibr.read_color(tmp_path / "new.png")
    seen = made.any(axis=2)
    off = np.abs(made.astype(int) - ibr.read_color(color))[seen]
    assert np.median(off) <= 12


@pytest.mark.thorough
def test_the_library_reads_real_recordings():
    views = ibr.load(shared("formats/7scenes_tsdf_fusion"), depth_scale=1000)
    assert [view.camera.K[0, 0] for view in views] == 5 * [585]
    assert len(ibr.load(shared("rgbd_realsense_shelf"), depth_scale=1000)) == 9
    views = ibr.load(shared("formats/colmap_dense_binary"))
    assert [view.camera.size for view in views] == [view.color.shape[1::-1] for view in views]
    assert [view.camera.K[0, 0] for view in ibr.load(shared("formats/tum_rgbd_fr1_rpy"))] == 2 * [525]


@pytest.mark.thorough
def test_a_real_colmap_workspace_needs_no_camera_file(tmp_path: Path):
    folder = shared("formats/colmap_dense_binary")
    shown = ["warp", folder, "--together", "--clean", "--orbit", 5, "-o", tmp_path / "new.png"]
    out = succeeded(runner.invoke(app, [str(word) for word in shown]))
    assert "new.png: 200x148" in out


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGTERM")
def test_a_film_that_is_ended_keeps_its_frames(recorded: Recorded):
    """By SIGTERM, as by Ctrl-C; nothing is left in the folder of temporary files."""
    (recorded.folder / "temporary").mkdir()
    words = ["warp", "rgb/0.png", "depth/0.png", "--depth-scale", str(SCALE), "--camera", "camera.json"]
    words += ["--orbit", "10", "--frames", "100000", "-o", "long.mp4"]
    environment = with_path() | {"TMPDIR": str(recorded.folder / "temporary")}
    command = subprocess.Popen([sys.executable, "-m", "pyibr", *words], cwd=recorded.folder, env=environment)
    try:
        until(lambda: any(file.stat().st_size > 10_000 for file in recorded.folder.glob(".pyibr-*")))
        command.send_signal(signal.SIGTERM)
        assert command.wait(60) == 143
    finally:
        command.kill()
    assert len(Video(recorded.folder / "long.mp4")) > 10
    assert not [*recorded.folder.glob(".pyibr-*"), *(recorded.folder / "temporary").iterdir()]
