"""Commands draw, convert and capture files of 3D Gaussians."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import pyibr as ibr
from pyibr.app.batch.work import run_command
from pyibr.app.commands import progress
from pyibr.app.commands.progress import waiting
from pyibr.capture import capture
from tests.app.commands import assert_one_line, run, succeeded
from tests.gaussians.clouds import camera, cloud


def test_a_turntable_of_a_file(folder: Path):
    """The header tells Gaussians from a mesh; without --up, -y is up."""
    cloud(200).save("scene.ply")
    mesh = ibr.Mesh([[-1, -1, 6], [1, -1, 6], [-1, 1, 6]], [[0, 2, 1]], colors=np.full((3, 3), 200, np.uint8))
    mesh.save("mesh.glb")
    succeeded(run("orbit", "scene.ply", "mesh.glb", "--frames", 2, output="turn.png"))
    for number, frame in enumerate(ibr.turntable([ibr.Gaussians.load("scene.ply"), ibr.Mesh.load("mesh.glb")], 2)):
        np.testing.assert_array_equal(ibr.read_color(f"turn_{number:04d}.png"), frame.color)


def test_pictures_from_cameras_with_depth(folder: Path):
    cloud(200).save("scene.ply")
    thing, views = ibr.Gaussians.load("scene.ply"), [camera((61, 47)), camera((61, 47)).moved(0.2, 0, 0)]
    views[0].save("one.json")
    Path("two.json").write_text(json.dumps([json.loads(Path("one.json").read_text()), views[1].to_json()]))
    words = ("orbit", "scene.ply", "--depth-out", "d.npy", "--to")
    succeeded(run(*words, "one.json", output="a.png"))
    succeeded(run(*words, "two.json", output="b.png"))
    for name, number, one in (("", 0, views[0]), ("_0000", 0, views[0]), ("_0001", 1, views[1])):
        frame = ibr.render(thing, views[number])
        np.testing.assert_array_equal(ibr.read_color(f"{'b' if name else 'a'}{name}.png"), frame.color)
        np.testing.assert_array_equal(ibr.read_depth(f"d{name}.npy"), frame.depth)
        assert one.size == (61, 47) and frame.valid.any()
    for more, option in ((("--frames", 2), "--frames"), (("--swing", 5), "--to"), (("--start", "one.json"), "--start")):
        assert_one_line(run(*words, "one.json", *more, output="c.png"), f"{option}: expected none together with")


def test_depth_images_of_a_file(folder: Path):
    thing = cloud(3000)
    thing.save("scene.compressed.ply")
    camera((61, 47)).save("one.json")
    succeeded(run("capture", "scene.compressed.ply", "--camera", "one.json", output="one"))
    expected = capture(ibr.Gaussians.load("scene.compressed.ply"), camera((61, 47)))
    (found,) = ibr.load("one")
    np.testing.assert_array_equal(found.depth, expected.depth)
    succeeded(run("capture", "scene.compressed.ply", "--size", 40, output="six"))
    views = ibr.load("six")
    assert len(views) == 6  # those from aside have -y up
    assert all(abs(view.camera.world_from_camera[1, 1]) in (0, 1) for view in views)
    succeeded(run("object", "six", "--size", 40, 40, output="object.png"))
    assert_one_line(
        run("capture", "scene.compressed.ply", "--camera", "one.json", "--layer", "last", output="last"), "--layer: ex"
    )


def test_formats_are_converted(folder: Path):
    cloud(300, 3).save("scene.ply")
    told = succeeded(run("convert", "scene.ply", output="scene.compressed.ply"))
    assert told == "scene.compressed.ply: 300 Gaussians\n"
    run_command(["convert", "scene.compressed.ply", "-o", "again.ksplat"])  # as batches do
    assert repr(ibr.Gaussians.load("again.ksplat")) == "<Gaussians 300, degree 3>"
    for words, said in (
        (("scene.ply", "-o", "scene.glb"), "--output: expected a file that ends in one of .compressed.ply, .ply"),
        (("scene.ply", "-o", "new.ply", "--up", "z"), "--up: expected none for 3D Gaussians, got z"),
        (("scene.ply", "-o", "scene.ply"), "the same as SOURCE"),
    ):
        assert_one_line(run("convert", *words), said)
    Path("cut.spz").write_bytes(b"NGSP cut")
    pytest.importorskip("gaussforge", reason="needs the extra gaussians")
    assert_one_line(run("convert", "cut.spz", output="new.ply"), "cut.spz: not a readable SPZ (3D Gaussians) file")


@pytest.mark.parametrize(
    "words",
    ["warp G depth.npy --fov 60 --orbit 3", "relief G height.png", "slices G height.png", "place G", "object G"],
)
def test_commands_for_other_things_name_those_for_gaussians(folder: Path, words: str):
    cloud(9).save("scene.ply")
    ibr.write_depth("depth.npy", np.ones((5, 7), np.float32))
    command, *rest = words.replace("G", "scene.ply").split()
    result = run(command, *rest, **({} if command == "place" else {"output": "new.png"}))
    assert_one_line(result, "scene.ply: expected", "got 3D Gaussians", "`pyibr orbit` draws them")


def test_slow_loading_shows_progress(folder: Path, monkeypatch: pytest.MonkeyPatch):
    cloud(9).save("scene.ply")
    assert "Loading" not in run("convert", "scene.ply", output="new.ply").stderr
    monkeypatch.setattr(progress, "_PATIENCE", 0)
    monkeypatch.setenv("FORCE_COLOR", "1")
    assert "Loading scene.ply" in run("convert", "scene.ply", output="new.ply").stderr


def test_waiting_writes_nothing_into_files(capsys):
    with waiting("Loading"):
        pass
    assert not "".join(capsys.readouterr())
