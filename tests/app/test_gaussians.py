"""Commands draw, convert and capture files of 3D Gaussians."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import pyibr as ibr
from tests.app.commands import run, succeeded
from tests.gaussians.clouds import cloud


def test_a_turntable_of_a_file(folder: Path):
    """The header tells Gaussians from a mesh; without --up, -y is up."""
    cloud(200).save("scene.ply")
    mesh = ibr.Mesh([[-1, -1, 6], [1, -1, 6], [-1, 1, 6]], [[0, 2, 1]], colors=np.full((3, 3), 200, np.uint8))
    mesh.save("mesh.glb")
    succeeded(run("orbit", "scene.ply", "mesh.glb", "--frames", 2, output="turn.png"))
    for number, frame in enumerate(ibr.turntable([ibr.Gaussians.load("scene.ply"), ibr.Mesh.load("mesh.glb")], 2)):
        np.testing.assert_array_equal(ibr.read_color(f"turn_{number:04d}.png"), frame.color)
