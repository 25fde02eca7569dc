"""`pyibr mesh` writes the triangles of a depth image; errors are one line."""

from __future__ import annotations

import numpy as np
import pytest

import pyibr as ibr
from tests.app.commands import assert_one_line
from tests.app.plane import Scene


@pytest.mark.parametrize("kind", ["glb", "obj", "ply"])
def test_a_plane_becomes_few_triangles(scene: Scene, kind):
    file = scene.folder / f"plane.{kind}"
    result = scene.run("--max-error", "0.001", "-o", file, command="mesh")
    assert result.exit_code == 0, result.output
    made = ibr.Mesh.load(file)
    assert f"plane.{kind}: {len(made.faces)} triangles" in result.stdout
    assert len(made.faces) == 2
    low, high = scene.camera.unproject([[-0.5, -0.5], [60.5, 36.5]], [2, 2])  # to the pixels' outer edges
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
    assert made[0] > 36 and made[1] <= 9 and made[2] <= 9  # the quadtree has many at the step


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
