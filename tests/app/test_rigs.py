"""`pyibr stereo`, `quilt` and `orbit` draw what the library does, and name files so that displays recognise them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import pyibr as ibr
from pyibr.app.batch.work import run_command
from pyibr.app.view.paths import CameraPath
from pyibr.capture.rigs import framed
from pyibr.capture.stereo import depth_range_of
from tests.app.commands import assert_one_line, run, succeeded
from tests.app.plane import Scene
from tests.app.recorded import COUNT, SCALE, Recorded
from tests.app.recorded import SIZE as RECORDED


def test_a_picture_is_that_of_the_library(scene: Scene):
    depth = np.where(np.arange(61) > 30, np.float32(2), np.float32(4)) * np.ones((37, 1), np.float32)
    ibr.write_depth("depth.npy", depth)
    view = ibr.DepthImage(scene.color, depth, scene.camera)
    succeeded(scene.run("-o", "new.png", "--divergence", 5, depth="depth.npy", scale=None, command="stereo"))
    np.testing.assert_array_equal(ibr.read_color("new.png"), ibr.stereo(view, divergence=5))
    words = ("--grid", 3, 2, "--size", 20, 30, "-o", ".")
    succeeded(scene.run(*words, depth="depth.npy", scale=None, command="quilt"))
    found = ibr.read_color("color_qs3x2a0.6667.png")
    np.testing.assert_array_equal(found, ibr.quilt(view, grid=(3, 2), size=(20, 30)))


@pytest.mark.parametrize(
    ("layout", "name", "size"),
    [("full-sbs", "LRF_Full_SBS", (122, 37)), ("half-tb", "TB", (61, 36)), ("gray", "redcyan", (61, 37))],
)
def test_names_tell_players_the_layout(scene: Scene, layout: str, name: str, size: tuple[int, int]):
    succeeded(scene.run("--layout", layout, "-o", ".", command="stereo"))
    assert ibr.read_color(f"color_{name}.png").shape[1::-1] == size


def test_a_film_has_one_range_of_depth(recorded: Recorded):
    """The first frame with depth gives the range. Frames without depth become black, and are reported."""
    ibr.write_depth("depth/0.png", np.full(RECORDED[::-1], np.nan, np.float32), depth_scale=SCALE)
    words = ("rgb", "depth", "--layout", "full-tb")
    result = run("stereo", *words, camera="cameras", scale=SCALE, output="new.mkv")
    assert result.exit_code == 0, result.output
    assert "1 of 4 pictures are empty" in result.stderr
    frames, views = list(ibr.Video("new.mkv")), recorded.views()[1:]
    ends = depth_range_of(views[0].depth[views[0].valid])
    assert len(frames) == COUNT and not frames[0].any()
    for frame, view in zip(frames[1:], views, strict=True):
        np.testing.assert_array_equal(frame, ibr.stereo(view, layout="full-tb", depth_range=ends))


def test_batches_draw_them_too(scene: Scene):
    files = "color.png", "depth.npy", "--camera", "camera.json"
    run_command(["stereo", *files, "-o", "a.png"])
    run_command(["quilt", *files, "--grid", "2", "1", "-o", "b.png"])
    assert ibr.read_color("a.png").shape == ibr.read_color("b.png").shape


def test_mistakes_are_told_in_a_line(scene: Scene):
    for command, words, name, *said in (
        ("stereo", ("--convergence", 2), "new.png", "convergence", "got"),
        ("stereo", ("--depth-range", 3, 2), "new.png", "--depth-range", "3 and 2"),
        ("quilt", ("--grid", 0, 2), "new.png", "grid", "two integers > 0"),
        ("stereo", (), "color.png", "a file of its own"),
        ("orbit", ("--orbit", 9, "--swing", 9), "new.png", "--swing", "none together with --orbit"),
        ("orbit", ("--frames", 1), "color.png", "of its own"),
    ):
        result = scene.run(*words, "-o", name, command=command, depth="depth.npy", scale=None)
        assert_one_line(result, *said)
    assert not Path("new.png").exists()


def test_a_turntable_is_that_of_the_library(scene: Scene):
    view = ibr.DepthImage(scene.color, scene.depth, scene.camera)
    succeeded(scene.run("--swing", 9, "--frames", 3, "-o", "turn.png", command="orbit"))
    for number, frame in enumerate(ibr.turntable(view, 3, swing=9)):
        np.testing.assert_array_equal(ibr.read_color(f"turn_{number:04d}.png"), frame.color)


def test_the_size_of_a_film_and_its_depth_are_reported(scene: Scene):
    """Most films have even sizes; the report and the file agree. A mesh has no range of depth to report."""
    pytest.importorskip("av")
    for name, size in (("a.mp4", "60x36"), ("a.mkv", "61x37"), ("a.gif", "61x37"), ("a.png", "61x37")):
        result = scene.run("--swing", 2, "--frames", 2, "-o", name, command="orbit")
        assert f"2 pictures, {size}, " in result.stdout and "; depth from 2 to 2\n" in result.stdout, result.output
    told = scene.run("--move", 0, 0, 0, "--frames", 2, "--json", "-o", "b.webm").stdout
    assert json.loads(told)["size"] == [60, 36]
    ibr.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]).save("a.ply")
    result = run("orbit", "a.ply", "--frames", 1, "--size", 20, 20, "-o", "c.png")
    assert result.exit_code == 0 and "depth" not in result.stdout


@pytest.mark.parametrize("command", ["stereo", "quilt"])
def test_a_folder_that_is_missing_is_made(scene: Scene, command: str):
    """A path without a suffix is a folder, with or without a slash behind it."""
    for name in ("new/", "other"):
        how = ("--grid", 2, 2) if command == "quilt" else ()
        result = scene.run(*how, "-o", name, command=command)
        assert result.exit_code == 0 and len(list(Path(name).glob("color_*.png"))) == 1, result.output


def test_meshes_with_different_up_directions_are_reported(folder: Path):
    for name in ("a.ply", "b.glb"):
        ibr.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]).save(name)
    words = "--frames", 1, "--size", 20, 20, "-o", "c.png"
    said = "THINGS: y is up in OBJ, PLY, OFF and STL meshes, -y in GLB and Gaussians: convert meshes to GLB"
    assert said in run("orbit", "a.ply", "b.glb", *words).stderr
    assert said not in run("orbit", "a.ply", *words).stderr


def test_a_path_goes_through_its_cameras(scene: Scene):
    """`--path` takes a camera path as `pyibr view` saves it, or a list of cameras."""
    ends = [scene.camera, scene.camera.moved(0, 0, -2)]
    Path("path.json").write_text(json.dumps(CameraPath(ends).to_json()))
    words = ("--path", "path.json", "--frames", 2, "--fill", "none", "--size", 30, 18)
    succeeded(scene.run(*words, "-o", "a.png", command="orbit"))
    view = ibr.DepthImage(scene.color, scene.depth, scene.camera)
    for number, camera in enumerate(ends):
        expected = ibr.warp(view, framed(camera, (30, 18))).color
        np.testing.assert_array_equal(ibr.read_color(f"a_{number:04d}.png"), expected)


def test_a_mesh_without_colours_is_lit(folder: Path):
    """The light moves with the camera, so either side of a roof is brighter than if it faced away from the light."""
    ridge = [[-1, 1, -1], [1, 1, -1], [-1, -1, 0], [1, -1, 0], [-1, 1, 1], [1, 1, 1]]
    ibr.Mesh(ridge, [[0, 1, 2], [3, 2, 1], [2, 3, 4], [5, 4, 3]]).save("roof.ply")
    words = ("roof.ply", "--frames", 2, "--size", 40, 30, "--up", "-y")
    assert run("orbit", *words, output="a.png").exit_code == 0
    for number in range(2):
        assert ibr.read_color(f"a_{number:04d}.png")[..., 0].max() > 2 * 0.3 * 200
