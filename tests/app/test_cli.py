"""The command line: its files and its error messages."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest

import pyibr as ibr
from tests.app.commands import assert_one_line, run, succeeded
from tests.app.plane import SIZE, Scene
from tools.processes import run_python, run_within


def shifted_by_five(scene: Scene) -> None:
    """Assert that the picture is shifted by 5 pixels: a focal length of 50, times a move of 0.2, by a depth of 2."""
    np.testing.assert_array_equal(ibr.read_color("new.png")[:, :-6], scene.color[:, 5:-1])


def test_move_along_a_plane_shifts_it(scene: Scene):
    out = succeeded(scene.run("--move", "0.2", "0", "0", "-o", "new.png"))
    assert re.search(r"new.png: 61x37, 9\d\.\d% covered", out)
    shifted_by_five(scene)


def test_to_another_camera_with_depth_and_mask(scene: Scene):
    scene.camera.moved(0.2, 0, -1).save("to.json")
    outputs = ("-o", "out/new.png", "--depth-out", "out/new.exr", "--valid-out", "out/valid.png")
    succeeded(scene.run("--to", "to.json", *outputs))
    depth = ibr.read_depth("out/new.exr", depth_scale=1000)
    valid = ibr.read_color("out/valid.png")[..., 0] == 255
    np.testing.assert_array_equal(np.isfinite(depth), valid)
    np.testing.assert_allclose(depth[valid], 3, rtol=1e-5)
    assert 0.3 < valid.mean() < 0.6  # the plane fills two thirds of the width, and of the height


def test_orbit_keeps_the_point_at_the_median_depth_in_its_place(scene: Scene):
    succeeded(scene.run("--orbit", "-20", "-o", "new.png", "--depth-out", "new.npy"))
    assert ibr.read_depth("new.npy", depth_scale=1000)[18, 30] == pytest.approx(2, rel=1e-3)


def test_frames_go_from_the_source_to_the_end(scene: Scene):
    succeeded(scene.run("--move", "0.2", "0", "0", "--frames", "3", "-o", "f.png", "--depth-out", "d.png"))
    names = sorted(file.name for file in Path().glob("[fd]_*.png"))
    assert names == [f"{kind}_{i:04d}.png" for kind in "df" for i in range(3)]
    np.testing.assert_array_equal(ibr.read_color("f_0000.png"), scene.color)
    Path("f_0002.png").rename("new.png")
    shifted_by_five(scene)


def test_an_empty_view_is_not_silent(scene: Scene):
    result = scene.run("--move", "0", "0", "5", "-o", "new.png", "--json")
    assert result.exit_code == 3, result.output
    assert "is out of view" in result.stderr and json.loads(result.stdout)["covered"] == 0


def test_what_is_written_is_told_to_programs(scene: Scene):
    asked = "--move", 0.2, 0, 0, "--frames", 2, "-o", "new.png", "--json"
    told = json.loads(scene.run(*asked).stdout)
    assert [Path(file).name for file in told["written"]] == ["new_0000.png", "new_0001.png"]
    assert 0.9 < told["covered"] < 1 and told["seconds"] > 0
    assert (told["frames"], told["size"], told["triangles"]) == (2, [61, 37], None)
    told = json.loads(scene.run("--count", 2, "-o", "new.ply", "--json", command="mesh").stdout)
    assert (told["frames"], told["covered"], told["triangles"]) == (None, None, 2)
    assert [Path(file).name for file in told["written"]] == ["new.ply"]


def test_every_choice_reaches_the_warp(scene: Scene, monkeypatch: pytest.MonkeyPatch):
    seen = {}

    def fake(views, cameras, **options):
        (view,), (camera,) = views, cameras
        seen.update(options, far=view.far)
        return [ibr.Frame(view.color, view.depth, view.valid, camera)]

    monkeypatch.setattr(ibr, "warp", fake)
    succeeded(scene.run(
        "--orbit", "5", "-o", "new.png", "--method", "search", "--interpolation", "nearest",
        "--edges", "cut", "--cut-ratio", "1.5", "--fill", "background", "--side", "both", "--far", "9",
        "--blend", "nearest", "--samples", "9", "--thin",
    ))  # fmt: skip
    expected = {"method": "search", "interpolation": "nearest", "edges": "cut", "cut_ratio": 1.5, "fill": "background"}
    assert seen == expected | {"side": "both", "blend": "nearest", "samples": 9, "thin": True, "far": 9.0}


def test_a_backdrop_is_a_number_or_the_farthest(scene: Scene):
    asked = "--move", "0", "0", "0", "--far", "1", "--default-depth", "4", "--depth-out", "new.npy"
    succeeded(scene.run(*asked, "-o", "new.png"))
    np.testing.assert_allclose(np.load("new.npy"), 4 * 1000, rtol=1e-5)
    result = scene.run("--orbit", "5", "-o", "new.png", "--default-depth", "sky")
    assert_one_line(result, "--default-depth: expected a depth > 0, farthest or none, got sky")


def test_depth_edges_are_cut_unless_asked_otherwise(scene: Scene):
    depth = np.where(np.arange(SIZE[0]) < 30, np.float32(1), np.float32(2)) * np.ones((SIZE[1], 1), np.float32)
    np.save("step.npy", depth)
    view, target = ibr.DepthImage(scene.color, depth, scene.camera), scene.camera.moved(0.2, 0, 0)
    pictures = []
    for asked, edges in (((), "cut"), (("--edges", "cut"), "cut"), (("--edges", "connect"), "connect")):
        words = ("--move", "0.2", "0", "0", *asked, "-o", "new.png")
        succeeded(scene.run(*words, depth="step.npy", scale=""))
        pictures.append(ibr.read_color("new.png"))
        np.testing.assert_array_equal(pictures[-1], ibr.warp(view, target, edges=edges).color)
    assert (pictures[0] != pictures[2]).any()


@pytest.mark.parametrize(
    ("choice", "got"),
    [
        ((), "got none"),
        (("--orbit", "5", "--move", "1", "0", "0"), "got --move and --orbit"),
        (("--to", "x.json", "--orbit", "5"), "got --to and --orbit"),
    ],
)
def test_exactly_one_new_camera(scene: Scene, choice, got):
    result = scene.run(*choice, "-o", "new.png")
    assert_one_line(result, "one of --to, --move, --orbit", got)


def test_integer_depth_asks_for_its_scale(scene: Scene):
    result = scene.run("--orbit", "5", "-o", "new.png", scale=None)
    assert_one_line(result, "--depth-scale", "depth.png")
    succeeded(scene.run("--orbit", "5", "-o", "new.png", depth="depth.npy", scale=None))


def test_bad_files_and_options(scene: Scene):
    out = ("--orbit", "5", "-o", "new.png")
    assert_one_line(scene.run(*out, depth="none.png"), "none.png", "no such file")
    for words in (["nowhere"], ["nowhere", "."], ["color.png", "nowhere"]):
        made = run("warp", *words, *out, "--camera", "camera.json")
        assert_one_line(made, "nowhere: no such file or folder")
    assert_one_line(run("view", "nowhere", "--port", 0), "nowhere: no such file or folder")
    assert_one_line(scene.run(*out, camera="color.png"), "color.png", "not a readable camera file")
    Path("half.png").write_bytes(Path("depth.png").read_bytes()[:60])
    assert_one_line(scene.run(*out, depth="half.png"), "half.png", "truncated")
    assert_one_line(scene.run("--to", "none.json", *out[2:]), "none.json")
    assert_one_line(scene.run(*out[:3], "new.xyz"), "new.xyz", "no image format")
    ibr.write_depth("holes.npy", np.full_like(scene.depth, np.nan))
    assert_one_line(scene.run(*out, depth="holes.npy"), "depth: expected at least one valid sample")
    assert_one_line(scene.run("--to", "camera.json", "--frames", "3", *out[2:]), "--frames")
    assert_one_line(scene.run(*out, "--device", "abacus"), "abacus")
    assert not Path("new.png").exists()


@pytest.mark.parametrize("frames", [0, 10**9])
def test_frames_out_of_range(scene: Scene, frames: int):
    """The numbers are refused at once; listing so many names of files would take minutes."""
    result = scene.run("--orbit", "5", "--frames", frames, "-o", "new.png")
    assert result.exit_code == 2 and "--frames" in result.output


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--move", 1, 0, "-o", "x.png"), "'--move': expected 3 values, got 1 0"),
        (("-o", "x.png", "--move", 1, 0), "'--move': expected 3 values, got 1 0"),
        (("--orbit", "-o", "x.png"), "'--orbit': expected 1 values, got none"),
        (("--move", 1, 0, "far", "-o", "x.png"), ", got 1 0 far"),
        (("--samples", "many", "--orbit", 1, "-o", "x.png"), ", got many"),
    ],
)
def test_values_that_an_option_lacks_or_cannot_take_are_named(scene: Scene, words, said):
    result = scene.run(*words)
    assert result.exit_code == 2 and said in " ".join(result.stderr.replace("\u2502", " ").split()), result.stderr


def test_a_negative_number_is_a_value(scene: Scene):
    result = scene.run("--move", "-0.1", "-.1", "-1e-2", "-o", "x.png")
    assert result.exit_code == 0, result.output


@pytest.mark.parametrize(("command", "way"), [("warp", "--orbit"), ("orbit", "--swing")])
def test_a_folder_is_no_picture(scene: Scene, command, way):
    assert_one_line(scene.run(way, 1, "-o", "new/", command=command), "such as new/new.png, got new without")


def test_help_shows_an_example():
    for command in ("warp", "stereo", "quilt", "orbit", "mesh", "object", "hull", "compare", "convert", "doctor"):
        shown = succeeded(run(command, "--help", env={"COLUMNS": "200", "TERM": "dumb"}))
        assert f"Example: pyibr {command}" in shown


@pytest.mark.parametrize(("works", "code"), [(True, 0), (False, 1)])
def test_doctor_exits_with_1_if_no_device_works(monkeypatch: pytest.MonkeyPatch, works, code):
    monkeypatch.setattr("pyibr.app.commands.doctor.print_report", lambda: works)
    assert run("doctor").exit_code == code


IMPORTS = """
import sys, pyibr
print(sorted(name for name in sys.modules if name.startswith(("viser", "pyibr.app"))))
import pyibr.app.cli
print(sorted({"pyopencl", "cv2", "PIL", "OpenEXR", "open3d", "matplotlib"} & set(sys.modules)))
import pyibr.warp.warp, pyibr.app.view.page
print([one.__name__ for one in (pyibr.warp, pyibr.view, pyibr.place, pyibr.load)])
"""


def test_imports_bring_nothing_heavy_and_hide_no_function():
    """The library loads no page, and modules named like functions do not replace them."""
    done = run_python("-c", IMPORTS)
    assert done.stdout == "[]\n[]\n['warp', 'view', 'place', 'load']\n", done.stderr


def test_errors_name_options_and_come_before_any_output(scene: Scene):
    move = ("--move", 0.1, 0, 0, "-o", "new.png")
    assert_one_line(scene.run(*move, scale="0"), "--depth-scale: expected")
    assert_one_line(scene.run(*move, "--edges", "cut", "--cut-ratio", 0.5), "--cut-ratio: expected", "0.5")
    Path("folder").mkdir()
    assert_one_line(scene.run(*move, depth="folder"), "folder: expected a file, got a folder")
    unwritable = scene.run(*move, "--depth-out", "z.png", depth="depth.npy", scale=None)
    assert_one_line(unwritable, "--depth-scale", "z.png")
    assert not Path("new.png").exists()


def test_the_package_runs_as_a_command():
    done = run_python("-m", "pyibr", "--version")
    assert done.stdout == f"pyibr {ibr.__version__}\n", done.stderr


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


# ---- pyibr mesh


@pytest.mark.parametrize("kind", ["glb", "obj", "ply"])
def test_a_plane_becomes_few_triangles(scene: Scene, kind):
    file = f"plane.{kind}"
    out = succeeded(scene.run("--max-error", "0.001", "-o", file, command="mesh"))
    made = ibr.Mesh.load(file)
    assert f"plane.{kind}: {len(made.faces)} triangles" in out and len(made.faces) == 2
    low, high = scene.camera.unproject([[-0.5, -0.5], [60.5, 36.5]], [2, 2])  # to the pixels' outer edges
    np.testing.assert_allclose(made.bounds, [low, high], atol=1e-6)
    assert (made.texture is None) == (kind == "ply") and (made.colors is None) == (kind != "ply")


def test_a_step_becomes_a_number_of_triangles(scene: Scene):
    depth = np.where(np.arange(61) < 30, 1.0, 2.0) * np.ones((37, 1))
    np.save("step.npy", depth.astype(np.float32))
    made = []
    for words in (("--max-error", "0.1"), ("--count", "9"), ("--count", "9", "--max-error", "0.1")):
        succeeded(scene.run(*words, "-o", "step.ply", command="mesh", depth="step.npy", scale=""))
        made.append(len(ibr.Mesh.load("step.ply").faces))
    assert made[0] > 36 and made[1] <= 9 and made[2] <= 9  # the quadtree has many at the step


def test_up_turns_a_glb_alone(scene: Scene):
    """Without --up, the world's y is down; other formats store the world's numbers and say so."""
    made = {}
    for name, words in {"a.glb": (), "z.glb": ("--up", "z"), "a.ply": ()}.items():
        result = scene.run("--max-error", "0.001", *words, "-o", name, command="mesh")
        made[name] = ibr.Mesh.load(name, axes="gltf").vertices
        assert ("in other commands, --up -y shows it upright" in result.stdout) == (name == "a.ply"), result.output
    np.testing.assert_array_equal(made["a.glb"], made["a.ply"] * (1, -1, -1))
    np.testing.assert_array_equal(made["z.glb"], np.roll(made["a.ply"], -1, axis=1))
    result = scene.run("--max-error", "1", "--up", "z", "-o", "a.ply", command="mesh")
    assert_one_line(result, "--up", "a .glb", "a.ply")


def test_bad_meshes(scene: Scene):
    for words, name, scale, said in (
        ((), "a.glb", "1000", ("--max-error", "count")),
        (("--count", "0"), "a.glb", "1000", ("--count", "0")),
        (("--max-error", "-1"), "a.glb", "1000", ("--max-error", ">= 0")),
        (("--max-error", "1"), "a.xyz", "1000", ("--output", "a.xyz")),
        (("--max-error", "1"), "a.glb", "", ("--depth-scale",)),
        (("--max-error", "1", "--far", "1e-9"), "a.glb", "1000", ("DEPTH", "valid depth")),
    ):
        assert_one_line(scene.run(*words, "-o", name, command="mesh", scale=scale), *said)
