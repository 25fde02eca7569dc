"""`pyibr relief` and `pyibr slices` draw the library's pictures; errors are one line."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pytest

import pyibr as ibr
from tests.app import commands

CAMERA = ibr.Camera.look_at((0.5, -0.6, 1.4), (0.5, 0.5, 0), (0, 0, 1), (41, 33), fov_y=50)


@pytest.fixture
def folder(folder: Path) -> Path:
    """A folder with a square with uv, a height map of two bumps, an image, and a camera."""
    corners, uv = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 0], [1, 0], [1, 1], [0, 1]]
    ibr.Mesh(corners, [[0, 1, 2], [0, 2, 3]], uv=uv).save("square.obj")
    ibr.Mesh(corners, [[0, 1, 2], [0, 2, 3]]).save("bare.ply")
    y, x = np.mgrid[:16, :32]
    bumps = (127 + 120 * np.sin(x / 3) * np.cos(y / 4)).astype(np.uint8)
    ibr.write_color("bumps.png", np.repeat(bumps[..., None], 3, axis=2))
    ibr.write_color("paint.png", np.dstack([8 * x, 12 * y, 0 * x + 90]).astype(np.uint8))
    CAMERA.save("camera.json")
    return folder


run = partial(commands.run, output="new.png")
SLICES = "slices", ibr.SlicedSurface, ("--slices", 40), {"slices": 40}


@pytest.mark.parametrize(
    ("command", "kind", "words", "how", "lit"),
    [
        ("relief", ibr.ReliefSurface, (), {}, True),
        (*SLICES, False),
        pytest.param(*SLICES, True, marks=pytest.mark.thorough),
    ],
)
def test_a_picture_is_the_librarys(folder: Path, command: str, kind, words, how, lit):
    """--light and --lamp are in the camera's axes; with --deep, black is high."""
    words = (*words, "--light", 1, 1, 2, "--ambient", 0.1) if lit else words
    maps = "--color", "paint.png", "--scale", 0.1, "--tiles", 2, 1, "--deep", "--anisotropy", 8
    out = commands.succeeded(run(command, "square.obj", "bumps.png", *maps, *words, "--to", "camera.json"))
    bumps, paint = ibr.read_color("bumps.png")[..., 0], ibr.read_color("paint.png")
    surface = kind(ibr.Mesh.load("square.obj"), 255 - bumps, paint, 0.1, tiles=(2, 1), **how)
    light = ibr.Light(direction=CAMERA.world_from_camera[:3, :3] @ (1, 1, 2), ambient=0.1, shadow_size=2048)
    expected = ibr.render(surface, CAMERA, light if lit else None, anisotropy=8)
    np.testing.assert_array_equal(ibr.read_color("new.png"), expected.color)
    assert f"new.png: 41x33, {expected.valid.mean():.1%} covered" in out


@pytest.mark.thorough
@pytest.mark.parametrize(("command", "kind"), [("relief", ibr.ReliefSurface), ("slices", ibr.SlicedSurface)])
@pytest.mark.parametrize(
    ("words", "height", "color"),
    [
        (("--tiles", 4, 2), (4, 2), (1, 1)),
        (("--tiles", 4, 2, "--color-tiles", 6, 1), (4, 2), (6, 1)),
        (("--color-tiles", 2, 3), (1, 1), (2, 3)),
        (("--color", "paint.png", "--tiles", 4, 2, "--color-tiles", 2, 2), (4, 2), (2, 2)),
        (("--color", "paint.png", "--tiles", 3, 2), (3, 2), (3, 2)),
    ],
)
def test_height_and_colours_are_repeated_apart(folder: Path, command: str, kind, words, height, color):
    """The mesh's own texture stays as it is, unless --color-tiles repeats it; the maps equal repeated images."""
    bare, paint = ibr.Mesh.load("square.obj"), ibr.read_color("paint.png")
    bare.replaced(texture=paint).save("painted.obj")
    result = run(command, "painted.obj", "bumps.png", "--scale", 0.1, *words, "--to", "camera.json")
    assert result.exit_code == 0, result.output
    bumps = ibr.read_color("bumps.png")[..., 0]
    surface = kind(bare, np.tile(bumps, height[::-1]), np.tile(paint, (*color[::-1], 1)), 0.1)
    expected = ibr.render(surface, CAMERA, anisotropy=8).color.astype(int)
    found = ibr.read_color("new.png").astype(int)
    assert np.abs(found - expected).mean() < 0.5 and (np.abs(found - expected) > 8).mean() < 0.02


def test_a_turntable_shows_all_of_it_from_all_round(folder: Path):
    """The camera turns about the up axis; the light turns with it, so that all sides are lit."""
    asked = "--scale", 0.1, "--up", "z", "--frames", 4, "--size", 60, 40, "--light", 0, 0, 1, "--lamp", 0, 0, 0
    result = run("relief", "square.obj", "bumps.png", *asked)
    assert result.exit_code == 0 and "4 views, 60x40" in result.stdout, result.output
    pictures = [ibr.read_color(f"new_{number:04d}.png") for number in range(4)]
    for picture in pictures:
        lit = picture.sum(axis=2) > 0
        assert 0.05 < lit.mean() < 0.9 and not (lit[0].any() or lit[-1].any() or lit[:, 0].any() or lit[:, -1].any())
    means = [picture[picture.any(axis=2)].mean() for picture in pictures]
    assert max(means) < 1.5 * min(means)  # bumps differ a little from side to side


@pytest.mark.parametrize("command", ["relief", "slices"])
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("square.obj", "bumps.png"), "--scale: expected the displacement of height 1 in scene units (the mesh is 1 "),
        (("square.obj", "bumps.png", "--scale", "0"), "--scale: expected"),
        (("square.obj", "bumps.png", "--scale", "nan"), "--scale: expected"),
        (("gone.obj", "bumps.png", "--scale", "1"), "gone.obj"),
        (("square.obj", "gone.png", "--scale", "1"), "gone.png"),
        (("square.obj", "bumps.png", "--scale", "1", "--color", "gone.png"), "gone.png"),
        (("bare.ply", "bumps.png", "--scale", "1"), "a mesh with uv"),
        (("bumps.png", "square.obj", "--scale", "1"), "bumps.png: a mesh file ends in one of"),
        (("square.obj", "camera.json", "--scale", "1"), "camera.json"),
        (("square.obj", "bumps.png", "--scale", "1", "--tiles", "0", "1"), "--tiles"),
        (("square.obj", "bumps.png", "--scale", "1", "--color-tiles", "0", "1"), "--color-tiles: expected two whole"),
        (("square.obj", "bumps.png", "--scale", "1", "--wrap", "mirror"), "--wrap"),
        (("square.obj", "bumps.png", "--scale", "1", "--wrap", "clamp", "--tiles", "2", "2"), "--tiles"),
        (("square.obj", "bumps.png", "--scale", "1", "--light", "0", "0", "0"), "--light"),
        (("square.obj", "bumps.png", "--scale", "1", "--light", "0", "0", "1", "--ambient", "2"), "--ambient"),
        (("square.obj", "bumps.png", "--scale", "1", "--anisotropy", "0"), "--anisotropy"),
        (("square.obj", "bumps.png", "--scale", "1", "--samples", "3"), "--samples"),
        (("square.obj", "bumps.png", "--scale", "1", "--to", "gone.json"), "gone.json"),
        (("square.obj", "bumps.png", "--scale", "1", "--size", "0", "9"), "size"),
        (("square.obj", "bumps.png", "--scale", "1", "--fps", "9"), "--fps: expected a video"),
        (("square.obj", "bumps.png", "--scale", "1", "--up", "w"), "--up"),
    ],
)
def test_mistakes_are_told(folder: Path, command: str, words, said: str):
    commands.assert_refused(run(command, *words), said)
    assert not list(folder.glob("new*"))


def test_what_is_out_of_view_is_told_by_the_status(folder: Path):
    CAMERA.moved(0, 0, 9).save("camera.json")
    result = run("slices", "square.obj", "bumps.png", "--scale", 0.1, "--slices", 40, "--to", "camera.json")
    assert result.exit_code == 3 and "new.png is empty: the thing is out of view" in result.stderr
    refused = run("slices", "square.obj", "bumps.png", "--scale", 0.1, "--slices", "many")
    commands.assert_refused(refused, "--slices: expected a whole number, or view, got many")
