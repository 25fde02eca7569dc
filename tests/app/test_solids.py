"""`pyibr object` and `pyibr hull` make pictures, turntables and meshes of solids from folders of images."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import pyibr as ibr
from pyibr.capture import models, object_views
from tests.app.commands import assert_one_line, run, succeeded


@pytest.fixture(scope="module")
def views() -> list[ibr.DepthImage]:
    return object_views(models.donut(16), 41)


@pytest.fixture(scope="module")
def folder(views: list[ibr.DepthImage], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with pictures, depth, and a camera for each picture."""
    place = tmp_path_factory.mktemp("donut")
    for number, view in enumerate(views):
        ibr.write_color(place / f"{number}.color.png", view.color)
        ibr.write_depth(place / f"{number}.depth.npy", view.depth)
        view.camera.save(place / f"{number}.json")
    return place


def test_a_picture_is_that_of_the_object(folder: Path, views: list[ibr.DepthImage], tmp_path: Path):
    camera = ibr.Camera.look_at((1, 2, 4), (0, 0, 0), (0, 1, 0), (50, 40), fov_y=45)
    camera.save(tmp_path / "to.json")
    out = succeeded(run("object", folder, "--to", tmp_path / "to.json", "-o", tmp_path / "new.png"))
    expected = ibr.render(ibr.DepthObject(views), camera)
    np.testing.assert_array_equal(ibr.read_color(tmp_path / "new.png"), expected.color)
    assert f"new.png: 50x40, {expected.valid.mean():.1%} covered" in out


def test_a_turntable_turns_about_the_middle(folder: Path, views: list[ibr.DepthImage], tmp_path: Path):
    succeeded(run("object", folder, "--frames", 4, "-o", tmp_path / "turn.png"))
    thing = ibr.DepthObject(views)
    for number in range(4):
        camera = views[0].camera.orbited(90.0 * number, thing.box.center)
        found = ibr.read_color(tmp_path / f"turn_{number:04d}.png")
        np.testing.assert_array_equal(found, ibr.render(thing, camera).color)


@pytest.mark.parametrize("suffix", [".ply", ".glb", ".obj"])
def test_a_mesh_is_the_objects(folder: Path, views: list[ibr.DepthImage], tmp_path: Path, suffix: str):
    out = succeeded(run("object", folder, "--resolution", 12, "-o", tmp_path / f"donut{suffix}"))
    found, expected = ibr.Mesh.load(tmp_path / f"donut{suffix}"), ibr.DepthObject(views).to_mesh(12)
    assert len(found.faces) == len(expected.faces) and found.colors is not None
    assert f"{len(found.faces)} triangles, closed" in out


@pytest.mark.parametrize("up", ["y", "-y", "z", "-x"])
def test_a_glb_stands_upright(folder: Path, views: list[ibr.DepthImage], tmp_path: Path, up: str):
    """A rotation turns the up direction to glTF's y. Without --up, up is -y, as in cameras' axes."""
    succeeded(run("hull", folder, "--up", up, "--resolution", 12, "-o", tmp_path / "it.glb"))
    expected, found = ibr.VisualHull(views).to_mesh(12), ibr.Mesh.load(tmp_path / "it.glb", axes="gltf")
    sign = -1 if up[0] == "-" else 1
    np.testing.assert_array_equal(found.vertices[:, 1], sign * expected.vertices[:, "xyz".index(up[-1])])
    turned, *_ = np.linalg.lstsq(expected.vertices, found.vertices, rcond=None)
    assert np.linalg.det(turned) == pytest.approx(1, abs=1e-4)
    if up == "-y":
        assert run("hull", folder, "--resolution", 12, "-o", tmp_path / "plain.glb").exit_code == 0
        plain = ibr.Mesh.load(tmp_path / "plain.glb", axes="gltf")
        np.testing.assert_array_equal(plain.vertices, found.vertices)


@pytest.mark.parametrize("form", ["depth", "alpha", "masks"])
def test_a_hull_of_depth_of_alpha_or_of_masks(form: str, folder: Path, views: list[ibr.DepthImage], tmp_path: Path):
    pictures, masks = tmp_path / "pictures", tmp_path / "masks"
    pictures.mkdir()
    masks.mkdir()
    for number, view in enumerate(views):
        rgba = np.dstack([view.color, 255 * view.valid.astype(np.uint8)])
        Image.fromarray(rgba if form == "alpha" else view.color).save(pictures / f"{number}.png")
        ibr.write_mask(masks / f"{number}.png", view.valid)
    given = {"depth": [folder], "alpha": [pictures], "masks": [pictures, masks]}[form]
    words = [] if form == "depth" else ["--camera", folder]
    succeeded(run("hull", *given, *words, "--resolution", 12, "-o", tmp_path / "hull.ply"))
    expected = ibr.VisualHull(views).to_mesh(12)
    np.testing.assert_allclose(ibr.Mesh.load(tmp_path / "hull.ply").vertices, expected.vertices, atol=1e-6)


@pytest.mark.parametrize(("command", "solid"), [("object", ibr.DepthObject), ("hull", ibr.VisualHull)])
def test_options_of_depth_are_those_of_warp(views: list[ibr.DepthImage], tmp_path: Path, command: str, solid: type):
    """Options for the array in NPZ files, its unit and the far depth are tested here."""
    for number, view in enumerate(views):
        ibr.write_color(tmp_path / f"room/{number}.color.png", view.color)
        depth = np.where(view.valid, 1000 * view.depth, np.float32(99_000))
        np.savez(tmp_path / f"room/{number}.depth.npz", mine=depth, other=np.ones(3))
        view.camera.save(tmp_path / f"room/{number}.json")
    words = ["--depth-channel", "mine", "--depth-scale", 1000, "--far", 90, "--resolution", 12]
    succeeded(run(command, tmp_path / "room", *words, "-o", tmp_path / "it.ply"))
    expected = solid(views).to_mesh(12)
    np.testing.assert_allclose(ibr.Mesh.load(tmp_path / "it.ply").vertices, expected.vertices, atol=1e-4)


def test_mistakes_are_told_in_a_line(folder: Path, tmp_path: Path):
    mesh, picture = tmp_path / "a.ply", tmp_path / "a.png"
    assert_one_line(run("object", tmp_path / "none", "-o", mesh), "no such folder")
    assert_one_line(run("object", tmp_path, "-o", mesh), "neither frusta.json nor frames")
    assert_one_line(run("object", folder, "--frames", 3, "-o", mesh), "--frames", "a picture or a video")
    assert_one_line(run("object", folder, "--up", "y", "-o", mesh), "--up", "a .glb, which has an up direction")
    assert_one_line(run("object", folder, "--resolution", 0, "-o", mesh), "--resolution", "got int 0")
    assert_one_line(run("object", folder, "-o", tmp_path / "a.txt"), "a.txt")
    assert_one_line(run("hull", tmp_path, "-o", picture), "no picture in it")
    ibr.write_color(tmp_path / "pictures/0.png", np.full((3, 4, 3), 9, np.uint8))
    words = "pictures/0.png", "expected a picture with alpha, or masks beside it, got RGB"
    assert_one_line(run("hull", tmp_path / "pictures", "--camera", folder, "-o", picture), *words)
    assert_one_line(run("hull", folder, folder, "-o", folder / "0.color.png"), "0.color.png", "the same as VIEWS")
    assert not mesh.exists() and not picture.exists()
