"""`pyibr warp` draws several sources, recordings and videos as the library does; errors are one line."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import pyibr as ibr
from pyibr.io.depth_frames import DepthFrames
from pyibr.io.video import Video
from tests.app.browser import until
from tests.app.commands import assert_one_line, run, succeeded
from tests.app.recorded import COUNT, SCALE, SIZE, Recorded
from tests.data import shared
from tools.processes import with_path

# ---- several sources of one scene


@pytest.mark.parametrize("blend", ["quality", "nearest"])
@pytest.mark.parametrize("kind", ["each", "list", "folder", "poses"])
def test_pairs_become_one_view(recorded: Recorded, blend, kind):
    listed = [json.loads(Path(f"cameras/{number}.json").read_text()) for number in (0, 3)]
    Path("list.json").write_text(json.dumps(listed))
    text = Path("poses.txt").read_text().splitlines()
    Path("two.txt").write_text("\n".join([text[0], text[3]]))
    asked = {"list": ("--camera", "list.json"), "folder": ("--camera", "cameras")}
    asked["each"] = ("--camera", "cameras/0.json", "--camera", "cameras/3.json")
    asked["poses"] = ("--camera", "camera.json", "--poses", "two.txt")
    pairs = ("rgb/0.png", "depth/0.png", "rgb/3.png", "depth/3.png")
    out = succeeded(recorded.run(*pairs, *asked[kind], "--to", "cameras/1.json", "--blend", blend, camera=None))
    expected = ibr.warp(recorded.views()[::3], recorded.cameras[1], blend=blend)
    recorded.shows(expected)
    assert f"new.png: 62x38, {expected.valid.mean():.1%} covered" in out


def test_all_frames_of_a_recording_together(recorded: Recorded):
    out = succeeded(recorded.run("rgb", "depth", "--together", "--poses", "poses.txt", "--move", 0.05, 0, 0))
    recorded.shows(ibr.warp(recorded.views(), recorded.base.moved(0.05, 0, 0)))
    assert "new.png: 62x38" in out
    taken = ("--take", "1::2", "--poses", "poses.txt")
    out = succeeded(recorded.run("rgb", "depth", "--together", *taken, "--orbit", 5, "--frames", 3))
    views = recorded.views()[1::2]
    pivot = views[0].camera.center + views[0].camera.forward * np.median(views[0].depth[views[0].valid])
    recorded.shows(ibr.warp(views, views[0].camera.orbited(2.5, pivot)), 1)
    assert "new_0002.png: 3 views" in out and not Path("new_0003.png").exists()


# ---- frame by frame


@pytest.mark.parametrize("cameras", [("--camera", "cameras"), ("--camera", "camera.json", "--poses", "poses.txt")])
def test_a_recording_gives_a_view_for_each_frame(recorded: Recorded, cameras):
    asked = (*cameras, "--move", 0.1, 0, 0.2, "--fill", "background", "--depth-out", "z.npy")
    out = succeeded(recorded.run("rgb", "depth", *asked, "--valid-out", "v.png", camera=None))
    for number, view in enumerate(recorded.views()):
        expected = ibr.warp(view, view.camera.moved(0.1, 0, 0.2), fill="background")
        recorded.shows(expected, number)
        stored = ibr.read_depth(f"z_{number:04d}.npy", depth_scale=SCALE)
        np.testing.assert_allclose(stored, expected.depth, rtol=1e-6)
        valid = ibr.read_color(f"v_{number:04d}.png")[..., 0] == 255
        np.testing.assert_array_equal(valid, expected.valid)
    assert "new_0000.png to new_0003.png: 4 views, 62x38" in out.replace("\n", "")
    assert not Path("new_0004.png").exists()


def test_a_recording_without_a_camera_gets_one_that_is_told(recorded: Recorded):
    """`warp`, `view` and the library take a given field of view, even if the folder has another camera."""
    wide = ibr.Camera.from_fov(SIZE, fov_x=90)
    succeeded(recorded.run("rgb", "depth", "--fov", 90, "--poses", "poses.txt", "--move", 0.1, 0, 0, camera=None))
    succeeded(recorded.run(".", "--fov", 90, "--move", 0.1, 0, 0, camera=None, output="folder.png"))
    for number, view in enumerate(recorded.views()):
        own = ibr.Camera(wide.K, SIZE, view.camera.world_from_camera)
        expected = ibr.warp(ibr.DepthImage(view.color, view.depth, own), own.moved(0.1, 0, 0)).color
        np.testing.assert_array_equal(recorded.new(number), expected)
        np.testing.assert_array_equal(ibr.read_color(f"folder_{number:04d}.png"), expected)
        assert ibr.load(".", depth_scale=SCALE, camera=wide)[number].camera == own
    pairs = [f"{kind}/{k}.png" for k in (0, 1) for kind in ("rgb", "depth")]
    result = recorded.run(*pairs, "--fov", 90, "--move", 0, 0, 0, camera=None)
    assert_one_line(result, "--fov, --focal-35mm: expected a single picture, or a recording, got 2 pictures")


@pytest.mark.parametrize("kind", ["camera.json", "intrinsics.K.txt", "frame by frame"])
def test_a_folder_that_has_all(recorded: Recorded, kind):
    """The command and the library find the cameras and poses in a folder."""
    if kind != "camera.json":
        Path("camera.json").unlink()
    if kind == "intrinsics.K.txt":
        np.savetxt(kind, recorded.base.K)
    if kind == "frame by frame":
        Path("cameras").rename("camera")
        Path("poses.txt").unlink()
    succeeded(recorded.run(".", "--move", 0.1, 0, 0.2, camera=None))
    loaded = ibr.load(".", depth_scale=SCALE)
    for number, (view, own) in enumerate(zip(recorded.views(), loaded, strict=True)):
        recorded.shows(ibr.warp(view, view.camera.moved(0.1, 0, 0.2)), number)
        np.testing.assert_array_equal(own.color, view.color)
        np.testing.assert_array_equal(own.depth, view.depth)
        assert own.camera == view.camera


def test_the_pivot_of_a_recording_is_that_of_its_first_frame(recorded: Recorded):
    succeeded(recorded.run("rgb", "depth", "--orbit", 10))
    views = recorded.views()
    distance = np.median(views[0].depth[views[0].valid])
    for number, view in enumerate(views):
        still = ibr.DepthImage(view.color, view.depth, recorded.base)
        target = recorded.base.orbited(10, recorded.base.center + recorded.base.forward * distance)
        recorded.shows(ibr.warp(still, target), number)


@pytest.mark.parametrize("to", ["cameras/2.json", "cameras"])
def test_a_recording_seen_from_given_cameras(recorded: Recorded, to):
    succeeded(recorded.run("rgb", "depth", "--poses", "poses.txt", "--to", to))
    for number, view in enumerate(recorded.views()):
        target = recorded.cameras[number if to == "cameras" else 2]
        recorded.shows(ibr.warp(view, target), number)


def test_recordings_of_several_cameras_go_frame_by_frame(recorded: Recorded):
    sources = ("rgb", "depth", "rgb", "depth", "--camera", "camera.json", "--camera", "cameras/3.json")
    succeeded(recorded.run(*sources, "--take", "1:3", "--to", "cameras/1.json", camera=None))
    for number in (1, 2):
        view = recorded.views()[number]
        pair = [ibr.DepthImage(view.color, view.depth, camera) for camera in (recorded.base, recorded.cameras[3])]
        recorded.shows(ibr.warp(pair, recorded.cameras[1]), number)


def test_clean_is_steady_and_carried_along(recorded: Recorded):
    asked = ("--poses", "poses.txt", "--clean", "--move", 0, 0, 0.1, "--depth-out", "z.npy")
    succeeded(recorded.run("rgb", "depth", *asked))
    last = None
    for number, view in enumerate(recorded.views()):
        before = None if last is None else ibr.warp(last, view.camera).depth
        depth = ibr.clean_depth(view.depth, view.color, before=before).depth
        last = ibr.DepthImage(None, depth, view.camera)
        recorded.shows(ibr.warp(ibr.DepthImage(view.color, depth, view.camera), view.camera.moved(0, 0, 0.1)), number)
    succeeded(recorded.run("rgb/3.png", "depth/3.png", "--clean", "--holes", 3, "--move", 0, 0, 0.1))
    view = recorded.views()[3]
    alone = ibr.DepthImage(view.color, ibr.clean_depth(view.depth, view.color, holes=3).depth, recorded.base)
    recorded.shows(ibr.warp(alone, recorded.base.moved(0, 0, 0.1)))


def test_depth_of_another_camera_is_registered(recorded: Recorded):
    beside = ibr.Camera([[45, 0, 29], [0, 45, 19], [0, 0, 1]], SIZE).moved(0.05, 0.01, 0)
    beside.save("beside.json")
    asked = ("--depth-camera", "beside.json", "--poses", "poses.txt", "--to", "cameras/2.json")
    succeeded(recorded.run("rgb", "depth", *asked))
    for number, view in enumerate(recorded.views()):
        depth = ibr.register(view.depth, beside, recorded.base)
        frame = ibr.warp(ibr.DepthImage(view.color, depth, view.camera), recorded.cameras[2])
        # The rig has moved; this changes registered depth only by rounding.
        assert np.abs(recorded.new(number).astype(int) - frame.color).mean() < 0.05
    succeeded(recorded.run("rgb/1.png", "depth/1.png", "--depth-camera", "beside.json", "--move", 0, 0, 0))
    view = recorded.views()[1]
    depth = ibr.register(view.depth, beside, recorded.base)
    recorded.shows(ibr.warp(ibr.DepthImage(view.color, depth, recorded.base), recorded.base))


# ---- videos


def test_a_video_and_a_folder_of_depth_become_a_video(recorded: Recorded):
    ibr.write_video("color.mkv", recorded.colors, 12)
    out = succeeded(recorded.run("color.mkv", "depth", "--poses", "poses.txt", "--move", 0.1, 0, 0, output="n.mkv"))
    made = Video("n.mkv")
    assert "n.mkv: 4 views, 62x38" in out and made.fps == 12
    for view, color in zip(recorded.views(), made.frames(range(COUNT)), strict=True):
        np.testing.assert_array_equal(color, ibr.warp(view, view.camera.moved(0.1, 0, 0)).color)
    asked = ("--take", "1:4:2", "--fps", 5, "--move", 0, 0, 0)
    succeeded(recorded.run("color.mkv", "depth", *asked, output="few.mkv"))
    made = Video("few.mkv")
    assert len(made) == 2 and made.fps == 5
    view = recorded.views()[3]
    frame = ibr.warp(ibr.DepthImage(view.color, view.depth, recorded.base), recorded.base)
    np.testing.assert_array_equal(next(made.frames([1])), frame.color)


@pytest.mark.parametrize("depth", ["depth.mkv", "depth.npy", "depth.npz"])
@pytest.mark.parametrize("color", ["rgb", "color.mkv"])
def test_depth_of_all_frames_in_one_file(recorded: Recorded, color, depth):
    """Views equal views from single files. Depth that is drawn or registered is written as a video."""
    stored = np.stack([ibr.uint16_from_depth(one, SCALE) for one in recorded.depths])
    if depth == "depth.mkv":
        ibr.write_video(depth, stored, 30, bits=16)
    else:
        (np.save if depth.endswith("npy") else np.savez_compressed)(depth, stored)
    ibr.write_video("color.mkv", recorded.colors, 30)
    succeeded(recorded.run(color, depth, "--take", "1:", "--move", 0.1, 0, 0, "--depth-out", "out.mkv"))
    depths = list(DepthFrames("out.mkv").read(range(3), depth_scale=SCALE))
    views = [ibr.DepthImage(view.color, view.depth, recorded.base) for view in recorded.views()]
    for number, view in enumerate(views[1:], 1):
        frame = ibr.warp(view, recorded.base.moved(0.1, 0, 0))
        recorded.shows(frame, number)
        np.testing.assert_allclose(depths[number - 1], np.where(frame.valid, frame.depth, np.nan), atol=0.51 / SCALE)
    camera = ("--depth-camera", "camera.json", "--color-camera", "camera.json")
    succeeded(run("register", depth, *camera, "--take", "2:", scale=SCALE, output="out.mkv"))
    registered = ibr.register(views[3].depth, recorded.base, recorded.base)
    (found,) = DepthFrames("out.mkv").read([1], depth_scale=SCALE)
    np.testing.assert_allclose(found, registered, atol=0.51 / SCALE)


def test_a_path_becomes_a_video(recorded: Recorded):
    succeeded(recorded.run("rgb/0.png", "depth/0.png", "--orbit", 10, "--frames", 5, output="path.mp4"))
    made = Video("path.mp4")
    assert len(made) == 5 and made.fps == 30


def test_frames_keep_their_numbers(recorded: Recorded):
    """Outputs are numbered like the frames' files; with --skip-existing, existing outputs stay unchanged."""
    for kind, number in (("rgb", 3), ("depth", 3)):
        Path(f"{kind}/{number}.png").rename(f"{kind}/17.png")
    Path("pose").mkdir()
    for number in (0, 1, 2, 17):
        pose = np.full((4, 4), -np.inf) if number == 2 else np.eye(4)
        np.savetxt(f"pose/{number}.txt", pose)
    result = recorded.run("rgb", "depth", "--poses", "pose", "--take", "1:", "--move", 0, 0, 0)
    assert "2 views" in succeeded(result) and "1 picture of" in result.stderr and "no usable pose" in result.stderr
    assert sorted(path.name for path in Path().glob("new*")) == ["new_0001.png", "new_0017.png"]
    for number, color in ((1, recorded.colors[1]), (17, recorded.colors[3])):
        seen = recorded.new(number).any(axis=2)
        assert seen.mean() > 0.8
        np.testing.assert_array_equal(recorded.new(number)[seen], color[seen])
    Path("new_0001.png").write_bytes(b"mine")
    Path("new_0017.png").unlink()
    asked = ("--poses", "pose", "--move", 0, 0, 0, "--skip-existing")
    assert "2 views" in succeeded(recorded.run("rgb", "depth", *asked))
    assert Path("new_0001.png").read_bytes() == b"mine" and recorded.new(17).any()
    assert "all files exist already" in succeeded(recorded.run("rgb", "depth", *asked))


# ---- real recordings


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("name", "focal", "scale"),
    [("tum_rgbd_fr1_rpy", 525, 5000), ("7scenes_tsdf_fusion", 585, 1000), ("redwood_open3d", 525, 1000)],
)
def test_real_recordings(tmp_path: Path, name, focal, scale):
    folder = shared(f"formats/{name}")
    camera = {"width": 640, "height": 480, "fx": focal, "fy": focal, "cx": 319.5, "cy": 239.5}
    (tmp_path / "camera.json").write_text(json.dumps(camera))
    shown = ["warp", folder, "--camera", tmp_path / "camera.json", "--depth-scale", scale, "--together"]
    shown += ["--move", 0, 0, 0]
    out = succeeded(run(*shown, "-o", tmp_path / "new.png"))
    assert float(out.split("480, ")[1].split("%")[0]) > 60
    # The picture for the first camera is the first frame's, with other frames' colours in its holes.
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
    assert "new.png: 200x148" in succeeded(run(*shown))


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGTERM")
def test_a_film_that_is_ended_keeps_its_frames(recorded: Recorded):
    """SIGTERM ends a command as Ctrl-C does: the frames so far are a valid film, and no temporary files remain."""
    Path("temporary").mkdir()
    words = ["warp", "rgb/0.png", "depth/0.png", "--depth-scale", str(SCALE), "--camera", "camera.json"]
    words += ["--orbit", "10", "--frames", "100000", "-o", "long.mp4"]
    environment = with_path() | {"TMPDIR": str(Path("temporary").absolute())}
    command = subprocess.Popen([sys.executable, "-m", "pyibr", *words], env=environment)
    try:
        until(lambda: any(file.stat().st_size > 10_000 for file in Path().glob(".pyibr-*")))
        command.send_signal(signal.SIGTERM)
        assert command.wait(60) == 143
    finally:
        command.kill()
    assert len(Video("long.mp4")) > 10
    assert not [*Path().glob(".pyibr-*"), *Path("temporary").iterdir()]
