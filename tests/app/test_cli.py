"""The command line: what it writes, and how it says what is wrong."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

import pyibr as ibr
from pyibr.app.cli import app
from tests.processes import run_within

SIZE = (61, 37)
runner = CliRunner()


class Scene:
    """A plane at depth 2, in files."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.camera = ibr.Camera([[50, 0, 30], [0, 50, 18], [0, 0, 1]], SIZE)
        rng = np.random.default_rng(0)
        self.color = rng.integers(0, 256, (SIZE[1], SIZE[0], 3), dtype=np.uint8)
        self.depth = np.full((SIZE[1], SIZE[0]), 2, np.float32)
        self.camera.save(folder / "camera.json")
        ibr.write_color(folder / "color.png", self.color)
        ibr.write_depth(folder / "depth.png", self.depth, depth_scale=1000)
        ibr.write_depth(folder / "depth.npy", self.depth)

    def run(self, *arguments: object, depth="depth.png", scale="1000", camera="camera.json", command="warp"):
        words = [command, self.folder / "color.png", self.folder / depth, "--camera", self.folder / camera]
        words += ["--depth-scale", scale] if scale else []
        return runner.invoke(app, [str(word) for word in (*words, *arguments)])


@pytest.fixture
def scene(tmp_path: Path) -> Scene:
    return Scene(tmp_path)


def assert_one_line(result, *words: str) -> None:
    assert result.exit_code == 2, result.output
    lines = result.stderr.strip().splitlines()
    assert len(lines) == 1, result.stderr
    assert "Traceback" not in result.stderr
    assert lines[0].startswith("pyibr: ")
    for word in words:
        assert word in lines[0]


# ---- pictures


@pytest.mark.thorough
@pytest.mark.parametrize("clean", [(), ("--clean",)])
def test_depth_of_another_size_wants_its_own_camera(scene: Scene, clean: tuple[str, ...]):
    """As phones deliver it: depth of fewer samples than the picture has pixels, of the same view."""
    ibr.write_depth(scene.folder / "small.npy", np.full((19, 31), 2, np.float32))
    words = ("--move", "0.2", "0", "0", "-o", scene.folder / "new.png", *clean)
    result = scene.run(*words, depth="small.npy", scale=None)
    assert_one_line(result, "depth: expected 61x37 samples", "--depth-camera with its own camera", "got 31x19")
    scene.camera.resized((31, 19)).save(scene.folder / "small.json")
    result = scene.run(*words, "--depth-camera", scene.folder / "small.json", depth="small.npy", scale=None)
    assert result.exit_code == 0, result.output
    new = ibr.read_color(scene.folder / "new.png").astype(int)
    # The plane is known 30 and 18 of the small depth's pixels wide and high: of its picture, all but the margins.
    assert (np.abs(new[2:-2, 2:-8] - scene.color[2:-2, 7:-3]) <= 1).all()


@pytest.mark.parametrize("kind", ["distance", "inverse"])
def test_depth_may_be_stored_in_other_kinds(scene: Scene, kind: str):
    """The same picture, and depth out as it came in."""
    move, new, out = ("--move", "0.2", "0", "0.1"), scene.folder / "new.png", scene.folder / "out.npy"
    assert scene.run(*move, "-o", new, "--depth-out", out).exit_code == 0
    expected, depth = ibr.read_color(new), ibr.read_depth(out, depth_scale=1000)
    target = scene.camera.moved(0.2, 0, 0.1)
    ibr.write_depth(scene.folder / "other.npy", scene.depth, depth_scale=1000, depth_kind=kind, camera=scene.camera)
    result = scene.run(*move, "-o", new, "--depth-out", out, "--depth-kind", kind, depth="other.npy")
    assert result.exit_code == 0, result.output
    assert (np.abs(ibr.read_color(new).astype(int) - expected) <= 1).all()
    np.testing.assert_allclose(ibr.read_depth(out, depth_scale=1000, depth_kind=kind, camera=target), depth, rtol=1e-5)
    mesh = scene.folder / "new.ply"
    words = ("--max-error", "0.001", "-o", mesh, "--depth-kind", kind)
    assert scene.run(*words, depth="other.npy", command="mesh").exit_code == 0
    np.testing.assert_allclose(ibr.Mesh.load(mesh).vertices[:, 2], 2, rtol=1e-5)
    words = ("--depth-camera", scene.folder / "camera.json", "--color-camera", scene.folder / "camera.json", "-o", out)
    words = ("register", scene.folder / "other.npy", "--depth-scale", 1000, "--depth-kind", kind, *words)
    assert runner.invoke(app, [str(word) for word in words]).exit_code == 0
    np.testing.assert_allclose(ibr.read_depth(out), ibr.read_depth(scene.folder / "other.npy"), rtol=1e-5)


def test_cameras_of_files_have_their_lenses(scene: Scene):
    lens = ibr.Lens("brown_conrady", [-0.2, 0.05, 0, 0])
    ibr.Camera(scene.camera.K, SIZE, lens=lens).save(scene.folder / "bent.json")
    new, depth = scene.folder / "new.png", scene.folder / "depth_new.npy"
    result = scene.run("--move", "0.2", "0", "0.1", "-o", new, "--depth-out", depth, camera="bent.json")
    assert result.exit_code == 0, result.output
    view = ibr.DepthImage(scene.color, scene.depth, ibr.Camera.load(scene.folder / "bent.json"))
    frame = ibr.warp(view, view.camera.moved(0.2, 0, 0.1))
    np.testing.assert_array_equal(ibr.read_color(new), frame.color)
    np.testing.assert_allclose(ibr.read_depth(depth, depth_scale=1000)[frame.valid], 1.9, rtol=1e-6)
    result = scene.run("--to", scene.folder / "camera.json", "-o", new, camera="bent.json")
    assert result.exit_code == 0, result.output
    result = scene.run("--max-error", "0.01", "-o", scene.folder / "new.ply", camera="bent.json", command="mesh")
    assert result.exit_code == 0, result.output


def shifted_by_five(scene: Scene) -> None:
    """Picture of a plane at 2 after a move of 0.2 to the right, with a focal length of 50: 5 pixels of shift."""
    np.testing.assert_array_equal(ibr.read_color(scene.folder / "new.png")[:, :-6], scene.color[:, 5:-1])


def test_move_along_a_plane_shifts_it(scene: Scene):
    result = scene.run("--move", "0.2", "0", "0", "-o", scene.folder / "new.png")
    assert result.exit_code == 0, result.output
    assert re.search(r"new.png: 61x37, 9\d\.\d% covered", result.stdout)
    shifted_by_five(scene)


def test_to_another_camera_with_depth_and_mask(scene: Scene):
    scene.camera.moved(0.2, 0, -1).save(scene.folder / "to.json")
    result = scene.run(
        "--to", scene.folder / "to.json", "-o", scene.folder / "out" / "new.png",
        "--depth-out", scene.folder / "out" / "new.exr", "--valid-out", scene.folder / "out" / "valid.png",
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    depth = ibr.read_depth(scene.folder / "out" / "new.exr", depth_scale=1000)
    valid = ibr.read_color(scene.folder / "out" / "valid.png")[..., 0] == 255
    np.testing.assert_array_equal(np.isfinite(depth), valid)
    np.testing.assert_allclose(depth[valid], 3, rtol=1e-5)
    assert 0.3 < valid.mean() < 0.6  # the plane fills two thirds of either side


def test_orbit_keeps_the_point_at_the_median_depth_in_its_place(scene: Scene):
    result = scene.run("--orbit", "-20", "-o", scene.folder / "new.png", "--depth-out", scene.folder / "new.npy")
    assert result.exit_code == 0, result.output
    assert ibr.read_depth(scene.folder / "new.npy", depth_scale=1000)[18, 30] == pytest.approx(2, rel=1e-3)


def test_frames_go_from_the_source_to_the_end(scene: Scene):
    result = scene.run(
        "--move", "0.2", "0", "0", "--frames", "3", "-o", scene.folder / "f.png",
        "--depth-out", scene.folder / "d.png",
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    names = sorted(file.name for file in scene.folder.glob("[fd]_*.png"))
    assert names == [f"{kind}_{i:04d}.png" for kind in "df" for i in range(3)]
    np.testing.assert_array_equal(ibr.read_color(scene.folder / "f_0000.png"), scene.color)
    (scene.folder / "f_0002.png").rename(scene.folder / "new.png")
    shifted_by_five(scene)


def test_an_empty_view_is_not_silent(scene: Scene):
    result = scene.run("--move", "0", "0", "5", "-o", scene.folder / "new.png", "--json")
    assert result.exit_code == 3, result.output
    assert "is empty: its camera sees nothing of" in result.stderr
    assert json.loads(result.stdout)["covered"] == 0


def test_what_is_written_is_told_to_programs(scene: Scene):
    asked = "--move", 0.2, 0, 0, "--frames", 2, "-o", scene.folder / "new.png", "--json"
    told = json.loads(scene.run(*asked).stdout)
    assert [Path(file).name for file in told["written"]] == ["new_0000.png", "new_0001.png"]
    assert 0.9 < told["covered"] < 1 and told["seconds"] > 0
    assert (told["frames"], told["size"], told["triangles"]) == (2, [61, 37], None)
    told = json.loads(scene.run("--count", 2, "-o", scene.folder / "new.ply", "--json", command="mesh").stdout)
    assert (told["frames"], told["covered"], told["triangles"]) == (None, None, 2)
    assert [Path(file).name for file in told["written"]] == ["new.ply"]


def test_every_choice_reaches_the_warp(scene: Scene, monkeypatch: pytest.MonkeyPatch):
    seen = {}

    def fake(views, cameras, **options):
        (view,), (camera,) = views, cameras
        seen.update(options, far=view.far)
        return [ibr.Frame(view.color, view.depth, view.valid, camera)]

    monkeypatch.setattr(ibr, "warp", fake)
    result = scene.run(
        "--orbit", "5", "-o", scene.folder / "new.png", "--method", "search", "--interpolation", "nearest",
        "--edges", "cut", "--cut-ratio", "1.5", "--fill", "background", "--side", "both", "--far", "9",
        "--blend", "nearest", "--samples", "9", "--thin",
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    assert seen == {
        "method": "search",
        "interpolation": "nearest",
        "edges": "cut",
        "cut_ratio": 1.5,
        "fill": "background",
        "side": "both",
        "blend": "nearest",
        "samples": 9,
        "thin": True,
        "far": 9.0,
    }


def test_a_backdrop_is_a_number_or_the_farthest(scene: Scene):
    asked = "--move", "0", "0", "0", "--far", "1", "--default-depth", "4", "--depth-out", scene.folder / "new.npy"
    result = scene.run(*asked, "-o", scene.folder / "new.png")
    assert result.exit_code == 0, result.output
    np.testing.assert_allclose(np.load(scene.folder / "new.npy"), 4 * 1000, rtol=1e-5)
    result = scene.run("--orbit", "5", "-o", scene.folder / "new.png", "--default-depth", "sky")
    assert result.exit_code == 2
    assert "pyibr: --default-depth: expected a depth > 0, farthest or none, got sky" in result.stderr


def test_depth_edges_are_cut_unless_asked_otherwise(scene: Scene):
    depth = np.where(np.arange(SIZE[0]) < 30, np.float32(1), np.float32(2)) * np.ones((SIZE[1], 1), np.float32)
    np.save(scene.folder / "step.npy", depth)
    view, target = ibr.DepthImage(scene.color, depth, scene.camera), scene.camera.moved(0.2, 0, 0)
    pictures = []
    for asked, edges in (((), "cut"), (("--edges", "cut"), "cut"), (("--edges", "connect"), "connect")):
        made = scene.run("--move", "0.2", "0", "0", *asked, "-o", scene.folder / "new.png", depth="step.npy", scale="")
        assert made.exit_code == 0, made.output
        pictures.append(ibr.read_color(scene.folder / "new.png"))
        np.testing.assert_array_equal(pictures[-1], ibr.warp(view, target, edges=edges).color)
    assert (pictures[0] != pictures[2]).any()


# ---- errors


# ---- meshes


@pytest.mark.parametrize("kind", ["glb", "obj", "ply"])
def test_a_plane_becomes_few_triangles(scene: Scene, kind):
    file = scene.folder / f"plane.{kind}"
    result = scene.run("--max-error", "0.001", "-o", file, command="mesh")
    assert result.exit_code == 0, result.output
    made = ibr.Mesh.load(file)
    assert f"plane.{kind}: {len(made.faces)} triangles" in result.stdout
    assert len(made.faces) == 2
    low, high = scene.camera.unproject([[-0.5, -0.5], [60.5, 36.5]], [2, 2])  # a sample covers its pixel
    np.testing.assert_allclose(made.bounds, [low, high], atol=1e-6)
    assert (made.texture is None) == (kind == "ply")
    assert (made.colors is None) == (kind != "ply")


def test_a_step_becomes_a_number_of_triangles(scene: Scene):
    depth = np.where(np.arange(61) < 30, 1.0, 2.0) * np.ones((37, 1))
    np.save(scene.folder / "step.npy", depth.astype(np.float32))
    made = []
    for words in (("--max-error", "0.1"), ("--count", "9"), ("--count", "9", "--max-error", "0.1")):
        file = scene.folder / "step.ply"
        result = scene.run(*words, "-o", file, command="mesh", depth="step.npy", scale="")
        assert result.exit_code == 0, result.output
        made.append(len(ibr.Mesh.load(file).faces))
    assert made[0] > 36 and made[1] <= 9 and made[2] <= 9  # the quadtree's along the step; merged ones


def test_bad_meshes(scene: Scene):
    assert_one_line(scene.run("-o", scene.folder / "a.glb", command="mesh"), "--max-error", "count")
    assert_one_line(scene.run("--count", "0", "-o", scene.folder / "a.glb", command="mesh"), "--count", "0")
    assert_one_line(scene.run("--max-error", "-1", "-o", scene.folder / "a.glb", command="mesh"), "--max-error", ">= 0")
    result = scene.run("--max-error", "1", "-o", scene.folder / "a.stl", command="mesh")
    assert_one_line(result, "--output", "a.stl")
    result = scene.run("--max-error", "1", "-o", scene.folder / "a.glb", command="mesh", scale="")
    assert_one_line(result, "--depth-scale")
    result = scene.run("--max-error", "1", "-o", scene.folder / "a.glb", "--far", "1e-9", command="mesh")
    assert_one_line(result, "DEPTH", "valid depth")


@pytest.mark.parametrize(
    ("choice", "got"),
    [
        ((), "got none"),
        (("--orbit", "5", "--move", "1", "0", "0"), "got --move and --orbit"),
        (("--to", "x.json", "--orbit", "5"), "got --to and --orbit"),
    ],
)
def test_exactly_one_new_camera(scene: Scene, choice, got):
    result = scene.run(*choice, "-o", scene.folder / "new.png")
    assert_one_line(result, "one of --to, --move, --orbit", got)


def test_integer_depth_asks_for_its_scale(scene: Scene):
    result = scene.run("--orbit", "5", "-o", scene.folder / "new.png", scale=None)
    assert_one_line(result, "--depth-scale", "depth.png")
    floats = scene.run("--orbit", "5", "-o", scene.folder / "new.png", depth="depth.npy", scale=None)
    assert floats.exit_code == 0, floats.output


def test_bad_files(scene: Scene):
    out = ("--orbit", "5", "-o", scene.folder / "new.png")
    assert_one_line(scene.run(*out, depth="none.png"), "none.png", "no such file")
    for words in (["nowhere"], ["nowhere", scene.folder], [scene.folder / "color.png", "nowhere"]):
        made = runner.invoke(
            app, ["warp", *map(str, words), *map(str, out), "--camera", str(scene.folder / "camera.json")]
        )
        assert_one_line(made, "nowhere: no such file or folder")
    assert_one_line(runner.invoke(app, ["view", "nowhere", "--port", "0"]), "nowhere: no such file or folder")
    assert_one_line(scene.run(*out, camera="color.png"), "color.png", "not a readable camera file")
    (scene.folder / "half.png").write_bytes((scene.folder / "depth.png").read_bytes()[:60])
    assert_one_line(scene.run(*out, depth="half.png"), "half.png", "truncated")
    assert_one_line(scene.run("--to", scene.folder / "none.json", *out[2:]), "none.json")
    assert_one_line(scene.run(*out[:3], scene.folder / "new.xyz"), "new.xyz", "no image format")
    assert not (scene.folder / "new.png").exists()


def test_sizes_that_do_not_match(scene: Scene):
    scene.camera.resized((37, 61)).save(scene.folder / "other.json")
    result = scene.run("--orbit", "5", "-o", scene.folder / "new.png", camera="other.json")
    assert_one_line(result, "--camera: expected that of 61x37 pixels", "got one of 37x61")


def test_no_valid_depth(scene: Scene):
    ibr.write_depth(scene.folder / "holes.npy", np.full_like(scene.depth, np.nan))
    result = scene.run("--orbit", "5", "-o", scene.folder / "new.png", depth="holes.npy")
    assert_one_line(result, "depth: expected at least one valid sample")


def test_frames_need_a_path(scene: Scene):
    result = scene.run("--to", scene.folder / "camera.json", "--frames", "3", "-o", scene.folder / "new.png")
    assert_one_line(result, "--frames")


@pytest.mark.parametrize("frames", [0, 10**9])
def test_frames_out_of_range(scene: Scene, frames: int):
    """Before any work: names of so many files alone would take minutes."""
    result = scene.run("--orbit", "5", "--frames", frames, "-o", scene.folder / "new.png")
    assert result.exit_code == 2
    assert "--frames" in result.output


def test_unknown_device(scene: Scene):
    result = scene.run("--orbit", "5", "-o", scene.folder / "new.png", "--device", "abacus")
    assert_one_line(result, "abacus")


# ---- help


@pytest.mark.parametrize(
    "command", ["warp", "stereo", "quilt", "orbit", "mesh", "object", "hull", "compare", "convert", "doctor"]
)
def test_help_shows_an_example(command):
    result = runner.invoke(app, [command, "--help"], env={"COLUMNS": "200", "TERM": "dumb"})
    assert result.exit_code == 0
    assert f"Example: pyibr {command}" in result.stdout


def test_version():
    assert runner.invoke(app, ["--version"]).stdout == f"pyibr {ibr.__version__}\n"


@pytest.mark.parametrize(("works", "code"), [(True, 0), (False, 1)])
def test_doctor_exits_with_1_if_no_device_works(monkeypatch: pytest.MonkeyPatch, works, code):
    monkeypatch.setattr("pyibr.app.commands.doctor.print_report", lambda: works)
    assert runner.invoke(app, ["doctor"]).exit_code == code


def test_importing_brings_nothing_heavy():
    heavy = "{'pyopencl', 'cv2', 'PIL', 'OpenEXR', 'open3d', 'matplotlib'}"
    code = f"import pyibr.app.cli, sys; print(sorted({heavy} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def test_warp_is_the_function_whatever_was_imported_before():
    code = (
        "import pyibr.warp.warp, pyibr as ibr, importlib; importlib.import_module('pyibr.warp.warp'); print(ibr.warp)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.startswith("<function warp")


def test_errors_name_options_and_come_before_any_output(scene: Scene):
    new = scene.folder / "new.png"
    move = ("--move", 0.1, 0, 0, "-o", new)
    assert_one_line(scene.run(*move, scale="0"), "--depth-scale: expected")
    assert_one_line(scene.run(*move, "--edges", "cut", "--cut-ratio", 0.5), "--cut-ratio: expected", "0.5")
    (scene.folder / "folder").mkdir()
    assert_one_line(scene.run(*move, depth="folder"), "folder: expected a file, got a folder")
    unwritable = scene.run(*move, "--depth-out", scene.folder / "z.png", depth="depth.npy", scale=None)
    assert_one_line(unwritable, "--depth-scale", "z.png")
    assert not new.exists()


# ---- files that must not be lost


def is_refused_before_the_work(scene: Scene, monkeypatch: pytest.MonkeyPatch, *arguments: object, **options) -> str:
    """Run `warp` or `mesh`; return its one line. It must not have come to the work, nor have written anything."""

    def work(*_: object, **__: object) -> None:
        raise AssertionError("at work")

    for name in ("warp", "DepthMesh", "read_color"):
        monkeypatch.setattr(ibr, name, work)
    before = {path: path.read_bytes() for path in scene.folder.rglob("*") if path.is_file()}
    result = scene.run(*arguments, **options)
    assert_one_line(result)
    assert before == {path: path.read_bytes() for path in scene.folder.rglob("*") if path.is_file()}
    return result.stderr.strip()


@pytest.mark.parametrize("name", ["color.png", "depth.png", "link.png", "hard.png", "folder/../color.png"])
@pytest.mark.parametrize("option", ["-o", "--depth-out", "--valid-out"])
def test_no_output_is_an_input(scene: Scene, monkeypatch: pytest.MonkeyPatch, option, name):
    (scene.folder / "folder").mkdir()
    (scene.folder / "link.png").symlink_to("depth.png")
    (scene.folder / "hard.png").hardlink_to(scene.folder / "color.png")
    others = () if option == "-o" else ("-o", scene.folder / "new.png")
    line = is_refused_before_the_work(scene, monkeypatch, "--orbit", 5, *others, option, scene.folder / name)
    assert "expected a file of its own, got " in line
    assert ("COLOR" in line) == (name in ("color.png", "hard.png", "folder/../color.png"))


def test_no_numbered_output_and_no_mesh_is_an_input(scene: Scene, monkeypatch: pytest.MonkeyPatch):
    (scene.folder / "color.png").rename(scene.folder / "f_0002.png")
    (scene.folder / "color.png").symlink_to("f_0002.png")
    path = ("--orbit", 5, "--frames", 4)
    line = is_refused_before_the_work(scene, monkeypatch, *path, "-o", scene.folder / "f.png")
    assert "f_0002.png, which is COLOR's too" in line
    (scene.folder / "d_0001.npy").symlink_to("depth.npy")
    arguments = ("-o", scene.folder / "g.png", "--depth-out", scene.folder / "d.npy")
    assert "DEPTH" in is_refused_before_the_work(scene, monkeypatch, *path, *arguments, depth="depth.npy")
    (scene.folder / "m.obj").symlink_to("camera.json")
    arguments = ("--max-error", 1, "-o", scene.folder / "m.obj")
    assert "--camera's too" in is_refused_before_the_work(scene, monkeypatch, *arguments, command="mesh")


def test_no_two_outputs_are_one(scene: Scene, monkeypatch: pytest.MonkeyPatch):
    (scene.folder / "other.png").symlink_to("new.png")  # which is not there yet
    for second in ("new.png", "other.png", "folder/../new.png"):
        arguments = ("--orbit", 5, "-o", scene.folder / "new.png", "--valid-out", scene.folder / second)
        assert "--output's too" in is_refused_before_the_work(scene, monkeypatch, *arguments)
        arguments = ("--orbit", 5, "--frames", 2, *arguments[2:])
        if second != "other.png":
            assert "--output's too" in is_refused_before_the_work(scene, monkeypatch, *arguments)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("-o", "a.xyz"), "no image format .xyz"),
        (("-o", "a.mp4"), "--output: expected several views for a video, by --frames or of a recording, got one"),
        (("-o", "a"), "without a suffix"),
        (("-o", "a.png", "--depth-out", "b.jpg"), "no depth format .jpg"),
        (("-o", "a.png", "--valid-out", "b.pfm"), "no image format .pfm"),
        (("-o", "camera.json/a.png"), "camera.json is not a folder"),
        (("-o", "folder.png"), "expected a file, got a folder"),
        (("-o", "x" * 300 + ".png"), "File name too long"),
        (("-o", "a.exr"), "pyibr-opencl[exr]"),
    ],
)
def test_what_cannot_be_written_is_told_before_the_work(
    scene: Scene, monkeypatch: pytest.MonkeyPatch, arguments, words
):
    (scene.folder / "folder.png").mkdir()
    monkeypatch.setitem(sys.modules, "OpenEXR", None)
    places = [word if word.startswith("-") else scene.folder / word for word in arguments]
    assert words in is_refused_before_the_work(scene, monkeypatch, "--orbit", 5, *places)


@pytest.mark.parametrize("name", ["a.xyz", "a.stl", "folder.glb", "camera.json/a.glb"])
def test_a_mesh_that_cannot_be_written_is_told_before_the_work(scene: Scene, monkeypatch: pytest.MonkeyPatch, name):
    (scene.folder / "folder.glb").mkdir()
    is_refused_before_the_work(scene, monkeypatch, "--max-error", 1, "-o", scene.folder / name, command="mesh")


@pytest.mark.parametrize(
    ("error", "line", "status"),
    [
        (KeyboardInterrupt(), "pyibr: interrupted", 130),
        (OSError(28, "No space left on device"), "pyibr: [Errno 28] No space left on device", 2),
        (MemoryError(), "pyibr: that does not fit into the memory", 2),
    ],
)
def test_what_ends_the_work_is_one_line(scene: Scene, monkeypatch: pytest.MonkeyPatch, error, line, status):
    def fail(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr(ibr, "warp", fail)
    result = scene.run("--orbit", 5, "-o", scene.folder / "new.png")
    assert (result.exit_code, result.stderr.strip()) == (status, line)


def test_names_that_are_no_text(scene: Scene):
    name = scene.folder / "\udcff.png"
    (scene.folder / "color.png").rename(scene.folder / "\udcfe.png")
    words = [sys.executable, "-c", "from pyibr.app.cli import app; app()", "warp", scene.folder / "\udcfe.png"]
    words += [scene.folder / "depth.npy", "--camera", scene.folder / "camera.json", "--orbit", "5", "-o", name]
    done = subprocess.run(words, capture_output=True, text=True)
    # On a busy machine even kernels that PoCL has kept take long enough to be told of.
    assert (done.returncode, re.sub("pyibr: kernels are being built .*\n", "", done.stderr)) == (0, "")
    assert "\ufffd.png: 61x37" in done.stdout
    assert name.exists()


def test_names_do_not_steer_the_terminal(scene: Scene):
    """Whoever makes a file may choose its name; a line is a line."""
    name = scene.folder / "a\n\x1b[2J\x9b\u00e9.png"
    result = scene.run("--orbit", 5, "-o", name)
    assert result.exit_code == 0 and name.exists()
    assert f"{scene.folder}/a\\n\\x1b[2J\\x9b\u00e9.png: 61x37" in result.stdout
    name.rename(scene.folder / "color.png")
    assert_one_line(scene.run("--orbit", 5, "-o", f"{name}.xyz"), "a\\n\\x1b[2J\\x9b\u00e9.png.xyz: no image format")


def test_what_devices_lack_is_told_in_lines(scene: Scene, monkeypatch: pytest.MonkeyPatch):
    def fail(*_: object, **__: object) -> None:
        raise ibr.DeviceError("no OpenCL device works.\n  to get one\x1b")

    monkeypatch.setattr(ibr, "warp", fail)
    result = scene.run("--orbit", 5, "-o", scene.folder / "new.png")
    assert (result.exit_code, result.stderr) == (2, "pyibr: no OpenCL device works.\n  to get one\\x1b\n")


def test_the_package_runs_as_a_command():
    done = subprocess.run([sys.executable, "-m", "pyibr", "--version"], capture_output=True, text=True)
    assert done.stdout == f"pyibr {ibr.__version__}\n", done.stderr


# ---- a camera for every photo, relative depth, scale


def test_a_photo_without_a_camera_gets_one_that_is_told(scene, tmp_path):
    words = ["warp", scene.folder / "color.png", scene.folder / "depth.npy", "--move", 0.2, 0, 0, "-o"]
    photo = tmp_path / "photo.jpg"
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0xA405] = 26
    Image.fromarray(scene.color).save(photo, exif=exif)
    of_plane = tmp_path / "plane.jpg"
    exif = Image.Exif()  # 4 mm on a sensor of 100 pixels a millimetre, of which a half was left
    exif.get_ifd(0x8769).update({0x920A: 4.0, 0xA20E: 1000.0, 0xA210: 3, 0xA002: 2 * SIZE[0]})
    Image.fromarray(scene.color).save(of_plane, exif=exif)
    cases = (
        ([], ibr.Camera.from_fov(SIZE, fov_x=60), "taken to be 60 degrees across; --camera, --fov or --focal-35mm"),
        (["--fov", 90], ibr.Camera.from_fov(SIZE, fov_x=90), ""),
        (["--focal-35mm", 50], ibr.Camera.from_fov(SIZE, focal_35mm=50), ""),
        ([photo], ibr.Camera.from_fov(SIZE, focal_35mm=26), "its EXIF data tell of a lens of 26 mm"),
        ([of_plane], ibr.Camera([[200, 0, 30], [0, 200, 18], [0, 0, 1]], SIZE), "its EXIF data tell of a lens of"),
    )
    for given, camera, told in cases:
        pictures = [word for word in given if isinstance(word, Path)]
        options = [word for word in given if not isinstance(word, Path)]
        new = tmp_path / "new.npy"
        line = [words[0], *(pictures or words[1:2]), *words[2:], tmp_path / "new.png", "--depth-out", new, *options]
        result = runner.invoke(app, [str(word) for word in line])
        assert result.exit_code == 0, result.output
        assert told in result.stderr and (told or not result.stderr)
        expected = ibr.warp(ibr.DepthImage(None, scene.depth, camera), camera.moved(0.2, 0, 0)).depth
        np.testing.assert_allclose(ibr.read_depth(new), expected, rtol=1e-5)  # float32's rounding of the focal length
    result = scene.run("--fov", 50, "--move", 0, 0, 0, "-o", tmp_path / "new.png")
    assert_one_line(result, "--fov: expected none beside --camera")


def test_relative_depth_is_sharpened_and_lies_between_near_and_far(scene, tmp_path):
    x = np.arange(SIZE[0])
    level = np.tile(np.interp(x, [27, 33], [200, 20]), (SIZE[1], 1))
    new = tmp_path / "new.npy"
    for values, suffix in ((level.astype(np.uint8), "png"), ((257 * level).astype(np.uint16), "png"), (level, "npy")):
        file = tmp_path / f"level.{suffix}"
        np.save(file, values) if suffix == "npy" else Image.fromarray(values).save(file)
        line = ["--depth-is", "relative", "--near", 2, "--move", 0, 0, 0, "-o", tmp_path / "n.png", "--depth-out", new]
        result = scene.run(*line, "--far", 8, depth=file, scale=None)
        assert result.exit_code == 0, result.output
        assert "depth from 2 to 8" in result.stdout
        depth = ibr.read_depth(new)
        assert set(np.unique(depth.round(3))) == {2, 8}  # no ramp is left
        result = scene.run(*line, "--no-sharpen", depth=file, scale=None)
        assert "depth from 2 to 10" in result.stdout and len(np.unique(ibr.read_depth(new).round(3))) > 4


def test_what_is_out_of_scale_is_told(scene, tmp_path):
    for move, is_told in ((1e-3, True), (0.1, False), (21, True)):
        result = scene.run("--move", move, 0, 0, "-o", tmp_path / "n.png")
        assert (result.exit_code == 0 and "depth from 2 to 2" in result.stdout) or move > 20
        assert ("--move: by" in result.stderr) == is_told
    scene.camera.resized((122, 74)).save(tmp_path / "large.json")
    result = scene.run("--move", 0.1, 0, 0, "-o", tmp_path / "n.png", camera="large.json")
    assert_one_line(result, "--camera: expected that of 61x37 pixels", "Camera.resized", "one of 122x74")


def test_warnings_are_told_in_a_line(scene, tmp_path):
    (tmp_path / "K.txt").write_text("30 0 50\n0 18 50\n0 0 1\n")
    result = scene.run("--move", 0.1, 0, 0, "-o", tmp_path / "n.png", camera="K.txt")
    assert "pyibr: K: fx, fy = 30, 18 and cx, cy = 50, 50 look exchanged" in result.stderr
    assert "Warning" not in result.stderr


def test_a_camera_of_a_file_is_named_behind_it(scene, tmp_path):
    data = {"left": scene.camera.to_json(), "right": scene.camera.moved(0.1, 0, 0).to_json()}
    (tmp_path / "rig.json").write_text(json.dumps(data))
    for name in ("left", "right"):
        result = scene.run("--move", 0.1, 0, 0, "-o", tmp_path / f"{name}.png", camera=f"rig.json#{name}")
        assert result.exit_code == 0, result.output
    result = scene.run("--move", 0.1, 0, 0, "-o", tmp_path / "n.png", camera="rig.json")
    assert_one_line(result, "expected one camera, as ", "rig.json#NAME; got left, right")


@pytest.mark.parametrize("module", ["pyibr", "numpy", "typer.rich_utils"])
def test_an_interrupt_while_the_command_is_loaded_is_quiet(module: str):
    code = f"""
import signal, sys
class Interrupting:
    def find_spec(self, name, path=None, target=None):
        if name == {module!r}:
            signal.raise_signal(signal.SIGINT)
from pyibr_command import main
sys.meta_path.insert(0, Interrupting())
main()
"""
    done = run_within(60, [sys.executable, "-c", code, "--help"])
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "")
