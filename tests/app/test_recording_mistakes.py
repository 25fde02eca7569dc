"""Incomplete and damaged recordings: frames are left out, errors are named, and no input file is overwritten."""

from __future__ import annotations

import json
import re
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import pyibr as ibr
from tests.app.commands import assert_one_line, succeeded
from tests.app.recorded import COUNT, SCALE, SIZE, Recorded
from tests.io.test_cameras import model

assert_refused = partial(assert_one_line, progress="Warping")


def test_frames_without_depth_or_pose_of_their_time_are_left_out_and_told(recorded: Recorded):
    """TUM data sets have lists of pictures and depth with times, and a trajectory with other times."""
    listed = {"rgb": [f"{k}.00 rgb/{k}.png" for k in range(4)], "depth": [f"{k}.01 depth/{k}.png" for k in (0, 2, 3)]}
    for name, lines in listed.items():
        Path(f"{name}.txt").write_text("# a list\n" + "\n".join(lines))
    poses = [f"{k}.005 {0.02 * k} 0 0 0 0 0 1" for k in (1, 2, 3)]
    Path("groundtruth.txt").write_text("\n".join(poses))
    result = recorded.run(".", "--move", 0.1, 0, 0)
    assert "2 views" in succeeded(result)
    assert re.search("1 picture of .*rgb: no depth at this time; left out", result.stderr)
    assert re.search("1 picture of .*rgb: no pose at this time; left out", result.stderr)
    for number, view in enumerate(recorded.views()[2:], start=2):  # their numbers
        recorded.shows(ibr.warp(view, view.camera.moved(0.1, 0, 0)), number)


@pytest.mark.parametrize("words", [["--camera", "cameras"], ["--camera", "camera.json", "--poses", "poses.txt"]])
def test_lost_frames_are_left_out_and_told(recorded: Recorded, words):
    """The other frames still get the right cameras: by the pictures' names, or by poses in the order of all frames."""
    views = recorded.views()
    Path("depth/1.png").unlink()
    result = recorded.run("rgb", "depth", "--move", 0.1, 0, 0, *words, camera=None)
    assert "3 views" in succeeded(result)
    assert re.search("1 file of .*rgb and .*depth, 1.png: no partner of the same name .*; left out", result.stderr)
    for number, view in zip((0, 2, 3), (views[0], *views[2:]), strict=True):  # their numbers
        recorded.shows(ibr.warp(view, view.camera.moved(0.1, 0, 0)), number)


def test_frames_without_any_depth_are_black_and_told(recorded: Recorded):
    nothing = np.full(SIZE[::-1], np.nan, np.float32)
    for number in (0, 2):
        ibr.write_depth(f"depth/{number}.png", nothing, depth_scale=SCALE)
    asked = ("--clean", "--default-depth", "farthest", "--orbit", 3, "--fill", "background")
    result = recorded.run("rgb", "depth", *asked)
    succeeded(result)
    assert "2 of 4 views are empty" in result.stderr
    assert not recorded.new(0).any() and not recorded.new(2).any()
    assert recorded.new(1).any() and recorded.new(3).any()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("rgb", "--move", 0, 0, 0), ("rgb: found neither frusta.json nor frames", "files with color and depth")),
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
        (("rgb", "depth", "--together", "--orbit", 5), ("--together: expected frames with known poses",)),
    ],
)  # fmt: skip
def test_mistakes_are_told_in_one_line(recorded: Recorded, words, said):
    Path("torn.mp4").write_bytes(b"words " * 99)
    listed = [json.loads(Path(f"cameras/{number}.json").read_text()) for number in range(3)]
    Path("three.json").write_text(json.dumps(listed))
    lines = Path("poses.txt").read_text().splitlines()
    Path("three.txt").write_text("\n".join(lines[:3]))
    camera = None if "--camera" in words else "camera.json"
    assert_refused(recorded.run(*words, camera=camera), *said)
    assert not list(Path().glob("new*"))


def test_frames_that_lack_a_file_are_named(recorded: Recorded):
    move = ("--move", 0, 0, 0)
    assert_refused(recorded.run("rgb", "depth", *move, camera=None), "--camera: expected a file", "none for", "0.png")
    for number in (1, 2, 3):
        Path(f"depth/{number}.png").rename(f"depth/{number + 3}.png")
    assert_refused(recorded.run("rgb", "depth", *move), "1.png without depth")


@pytest.mark.parametrize("words", [("rgb", "depth"), ("rgb", "depth", "--together"), ("rgb", "depth", "--clean")])
def test_frames_that_cannot_be_read_are_left_out_and_told(recorded: Recorded, words):
    whole = Path("depth/1.png").read_bytes()
    Path("depth/1.png").write_bytes(whole[:90])
    result = recorded.run(*words, "--poses", "poses.txt", "--to", "cameras")
    succeeded(result)
    assert re.search("1 file cannot be used; left out: .*depth/1.png: not a readable image file", result.stderr)
    if words == ("rgb", "depth"):
        assert "3 views" in result.stdout and not Path("new_0001.png").exists()
        for number, view in zip((0, 2, 3), recorded.views(but=1), strict=True):
            recorded.shows(ibr.warp(view, view.camera), number)
    Path("rgb/3.png").write_bytes(b"torn")
    result = recorded.run(*words, "--poses", "poses.txt", "--move", 0, 0, 0)
    succeeded(result)
    assert "2 files cannot be used; left out: " in result.stderr


def test_of_several_recordings_those_that_can_be_read_are_shown(recorded: Recorded):
    ibr.write_depth("other/1.png", recorded.depths[1], depth_scale=SCALE)
    for number in (0, 2, 3):
        Path(f"other/{number}.png").write_bytes(b"torn")
    sources = ("rgb", "depth", "rgb", "other", "--camera", "cameras/0.json", "--camera", "cameras/3.json")
    succeeded(recorded.run(*sources, "--to", "cameras", camera=None))
    for number, view in enumerate(recorded.views()):
        views = [ibr.DepthImage(view.color, view.depth, recorded.cameras[0])]
        if number == 1:
            views.append(ibr.DepthImage(view.color, view.depth, recorded.cameras[3]))
        recorded.shows(ibr.warp(views if number == 1 else views[0], recorded.cameras[number]), number)


def test_a_recording_of_which_nothing_can_be_read(recorded: Recorded):
    for number in range(COUNT):
        Path(f"depth/{number}.png").write_bytes(b"torn")
    for words in (("--move", 0, 0, 0), ("--together", "--poses", "poses.txt", "--orbit", 5)):
        for output in ("n.mp4", "new.png"):
            if output == "new.png" or "--together" not in words:
                assert_refused(recorded.run("rgb", "depth", *words, output=output), "depth/0.png: not a readable")
                assert not Path(output).exists()


def test_a_frame_of_another_size_is_left_out_and_named(recorded: Recorded):
    ibr.write_color("rgb/2.png", recorded.colors[2][:20])
    for words in ((), ("--clean",)):
        result = recorded.run("rgb", "depth", "--move", 0, 0, 0, *words)
        assert "3 views" in succeeded(result) and not Path("new_0002.png").exists()
        assert re.search("1 file cannot be used; left out: .*rgb/2.png with .*color: expected", result.stderr)
    for number in range(COUNT):
        ibr.write_color(f"rgb/{number}.png", recorded.colors[number][:20])
    assert_refused(recorded.run("rgb", "depth", "--move", 0, 0, 0), "rgb/0.png with", "color: expected", "(38, 62, 3)")


def test_no_output_lies_within_a_recording(recorded: Recorded):
    whole = (".",)
    for words, output in ((("rgb", "depth"), "depth/n.png"), (whole, "rgb/n.png"), (whole, "o/n.png")):
        result = recorded.run(*words, "--move", 0, 0, 0, output=output)
        assert_refused(result, "--output: expected a path outside of the recording", output)
        assert not list(Path().rglob("n*.png"))


def test_a_video_of_another_length(recorded: Recorded):
    ibr.write_video("color.mkv", recorded.colors[:3], 12)
    result = recorded.run("color.mkv", "depth", "--move", 0, 0, 0)
    assert_refused(result, "depth: expected a depth for each of the 3 frames of colour, got 4 of depth")


def test_no_output_is_a_frame_that_is_read(recorded: Recorded):
    for number in range(COUNT):
        Path(f"rgb/{number}.png").rename(f"rgb/new_{number:04d}.png")
    before = Path("rgb/new_0002.png").read_bytes()
    assert_refused(recorded.run("rgb", "depth", "--move", 0, 0, 0, output="rgb/new.png"), "the same as COLOR")
    assert Path("rgb/new_0002.png").read_bytes() == before


@pytest.mark.parametrize("name", ["cameras.bin", "images.bin"])
def test_no_output_is_a_file_of_a_model_that_is_read(recorded: Recorded, name: str):
    """A COLMAP model is given by its folder, or found in a recording. Its files end in .bin, as COLMAP's depth does."""
    model(Path("one"), "binary", {"0.png": recorded.cameras[0]})
    model(Path("work/sparse/0"), "binary", {f"{number}.png": one for number, one in enumerate(recorded.cameras)})
    for number in range(COUNT):
        ibr.write_color(f"work/images/{number}.png", recorded.colors[number])
        ibr.write_depth(f"work/stereo/depth_maps/{number}.png.geometric.bin", recorded.depths[number])
    cases = [
        ("one", ("rgb/0.png", "depth/0.png", "--to", "one"), "camera.json", "the same as --to"),
        ("one", ("rgb/0.png", "depth/0.png", "--orbit", 5), "one", "the same as --camera"),
        ("work/sparse/0", ("work", "--together", "--orbit", 5), None, "the same as the recording"),
    ]
    for place, words, camera, said in cases:
        file = Path(place, name)
        before = file.read_bytes()
        for output in (file, Path("rgb/..", file)):
            result = recorded.run(*words, "--depth-out", output, camera=camera)
            assert_refused(result, "--depth-out: expected a file of its own, got", said)
        assert file.read_bytes() == before
        free = file.with_name("new.bin") if words[0] != "work" else "new.bin"
        succeeded(recorded.run(*words, "--depth-out", free, camera=camera))
