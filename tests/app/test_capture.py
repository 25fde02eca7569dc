"""`pyibr capture` writes a mesh's depth images into a folder that other commands read; errors are one line."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import pyibr as ibr
from pyibr.app.commands.things import direction_of
from pyibr.capture import models, object_views
from pyibr.capture.frusta import Frustum, Stroke, save_frusta
from pyibr.capture.raycast import MeshScene
from pyibr.capture.standpoint import standpoint
from tests.app import commands
from tests.app.commands import succeeded

run = partial(commands.run, "capture")


@pytest.fixture
def mesh(folder: Path) -> str:
    ring = models.donut(16)
    ibr.Mesh(ring.vertices, ring.faces, normals=ring.normals).save("donut.ply")
    return "donut.ply"


def assert_same(found: list[ibr.DepthImage], expected: list[ibr.DepthImage]) -> None:
    assert len(found) == len(expected)
    for one, other in zip(found, expected, strict=True):
        assert one.camera == other.camera
        np.testing.assert_array_equal(one.depth, other.depth)
        np.testing.assert_array_equal(one.color, other.color)


def test_from_all_round(mesh: str):
    out = succeeded(run(mesh, "--size", 40, "--projection", "perspective", "-o", "set", "--json"))
    expected = object_views(ibr.Mesh.load(mesh), 40, projection="perspective")
    for one, other in zip(ibr.load("set"), expected, strict=True):
        np.testing.assert_allclose(one.camera.center, other.camera.center)
        np.testing.assert_allclose(one.camera.forward, other.camera.forward)
    told = json.loads(out)
    assert told["written"] == ["set"] and (told["frames"], told["size"]) == (6, [40, 40])
    assert told["covered"] == pytest.approx(np.mean([view.valid.mean() for view in expected]))


def test_from_cameras_of_a_file_or_of_a_set(mesh: str):
    """A camera that does not see the mesh is left out and reported."""
    cameras = [ibr.Camera.look_at((0, y, 4), (0, y, 0), (0, 1, 0), (31, 23), fov_y=45) for y in (0.5, 50)]
    Path("list.json").write_text(json.dumps([camera.to_json() for camera in cameras]))
    result = run(mesh, "--camera", "list.json", "--layer", "last", "-o", "set")
    assert result.exit_code == 0 and "camera 1 does not see the scene; left out" in result.stderr
    scene = MeshScene.from_mesh(ibr.Mesh.load(mesh))
    scene.up = 0, 1, 0
    assert_same(ibr.load("set"), [scene.capture(cameras[0], layer="last")])
    succeeded(run(mesh, "--camera", "set", "-o", "again"))
    assert_same(ibr.load("again"), [scene.capture(cameras[0])])


@pytest.mark.parametrize(("words", "up"), [((), "y"), (("--up", "z"), "z"), (("--up", "-x"), "-x")])
def test_up_is_up_in_the_images_and_lit(mesh: str, words, up):
    """The camera's vertical axis is the mesh's, in the four side views; the view from above is the lightest."""
    assert run(mesh, *words, "--size", 40, "-o", "set").exit_code == 0
    views, upward = ibr.load("set"), np.array(direction_of(up))
    aside = [view for view in views if abs(view.camera.forward @ upward) < 0.5]
    assert len(aside) == 4
    for view in aside:
        np.testing.assert_allclose(-view.camera.world_from_camera[:3, 1], upward, atol=1e-12)
    np.testing.assert_allclose(standpoint(views, None, None).up, upward, atol=1e-12)  # of `view` and `orbit`
    light = {round(float(view.camera.forward @ upward)): view.color[view.valid].mean() for view in views}
    assert light[-1] > light[1] + 30


def test_from_frusta(mesh: str):
    """Images have the frusta's far planes and painted masks."""
    frustum = Frustum.look_at((0, 1, 3), (0, 0, 0), (0, 1, 0), 30, far=3.2).painted(Stroke(((0.5, 0.5),), 0.2))
    save_frusta("frusta.json", [frustum])
    succeeded(run(mesh, "--frusta", "frusta.json", "--size", 44, "-o", "set"))
    (found,) = ibr.load("set")
    expected = frustum.resized(44).capture(ibr.Mesh.load(mesh))
    assert found.far == 3.2 and found.camera.size == (44, 44)
    np.testing.assert_array_equal(found.depth, expected.depth)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("gone.ply",), ("gone.ply", "no such file")),
        (("donut.ply", "--camera", "gone.json"), ("gone.json",)),
        (("donut.ply", "--frusta", "gone.json"), ("gone.json",)),
        (("donut.ply", "--frusta", "donut.ply"), ("donut.ply",)),
        (("donut.ply", "--camera", "away.json", "--frusta", "away.json"), ("--frusta: expected none together with",)),
        (
            ("donut.ply", "--camera", "away.json"),
            ("--camera: expected cameras that see the scene", "got 1 that do"),
        ),
        (("donut.ply", "--camera", "away.json", "--size", "9"), ("--size: expected none with --camera, which sets",)),
        (("donut.ply", "--camera", "away.json", "--projection", "perspective"), ("--projection: expected none",)),
        (("donut.ply", "--layer", "last"), ("--layer: expected --camera with it",)),
        (("point.ply",), ("mesh: expected a mesh of some extent",)),
        (("away.json",), ("away.json: a mesh file ends in one of",)),
        (("donut.ply", "--size", "1"), ("--size",)),
        (("donut.ply", "--projection", "fisheye"), ("--projection",)),
    ],
)
def test_mistakes_are_told(mesh: str, words, said):
    ibr.Camera.look_at((0, 50, 4), (0, 50, 0), (0, 1, 0), (31, 23), fov_y=45).save("away.json")
    ibr.Mesh(np.ones((3, 3)), [[0, 1, 2]]).save("point.ply")
    commands.assert_refused(run(*words, "-o", "set"), *said)
    assert not Path("set").exists()
