"""Commands convert OpenEXR's linear colours to sRGB, and find its depth channel by name."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pyibr as ibr
from tests.app import commands

exr = pytest.importorskip("OpenEXR")

SIZE = (13, 7)
LIGHT = np.zeros((7, 13, 3), np.float32)
LIGHT[1], LIGHT[2], LIGHT[3] = 0.5, 0.002, 1  # in sRGB: level 188; in the linear part of its curve; white
LIGHT[4, 5] = 4  # a highlight: one of 91 pixels


@pytest.fixture
def run(folder: Path):
    channels = {f"V.Combined.{name}": np.ascontiguousarray(LIGHT[..., k]) for k, name in enumerate("RGB")}
    channels |= {"near.Z": np.full((7, 13), 1, np.float32), "far.Z": np.full((7, 13), 2, np.float32)}
    exr.File({"compression": exr.ZIP_COMPRESSION}, channels).write("v.exr")
    ibr.Camera([[9, 0, 6], [0, 9, 3], [0, 0, 1]], SIZE).save("c.json")

    def ran(output: str, *words: str, command: tuple[str, ...] = ("warp", "--move", "0", "0", "0")):
        name, *options = command
        return commands.run(name, "v.exr", "v.exr", *options, *words, camera="c.json", output=output), Path(output)

    return ran


@pytest.mark.parametrize(("stops", "half", "clipped"), [("0", 188, True), ("-2", 99, False)])
def test_pictures_show_light_as_srgb_and_tell_what_is_clipped(run, stops, half, clipped):
    done, new = run("n.png", "--depth-channel", "far.Z", "--exposure", stops)
    assert done.exit_code == 0, done.output
    shown = ibr.read_color(new)
    assert shown[1, 3].tolist() == [half] * 3 and shown[4, 5].tolist() == [255] * 3
    assert ("1.10% of all pixels are brighter than 1 and clipped" in done.stderr) == clipped


def test_loaded_recordings_show_light_as_srgb_too(tmp_path: Path):
    ibr.Camera([[9, 0, 6], [0, 9, 3], [0, 0, 1]], SIZE).save(tmp_path / "camera.json")
    ibr.write_color(tmp_path / "color/0.exr", LIGHT)
    ibr.write_depth(tmp_path / "depth/0.exr", np.ones((7, 13), np.float32))
    (view,) = ibr.load(tmp_path)
    np.testing.assert_allclose(view.color[1] * 255, 188, atol=0.5)
    np.testing.assert_allclose(view.color[4, 5], 1, rtol=1e-6)  # float32


def test_exr_from_exr_is_light_again(run):
    done, new = run("n.exr", "--depth-channel", "far.Z", "--depth-out", "d.npy")
    assert done.exit_code == 0, done.output
    np.testing.assert_allclose(ibr.read_color(new), np.minimum(LIGHT, 1), atol=1e-6)  # float32 rounds twice
    assert (ibr.read_depth(new.with_name("d.npy")) == 2).all()


def test_depth_channels_are_asked_for(run):
    done, _ = run("n.png")
    assert done.exit_code == 2 and "no channel called depth or Z" not in done.stderr
    assert "several layers with depth: far, near; name one" in " ".join(done.stderr.split())
    done, _ = run("m.glb", "--depth-channel", "nearer.Z", command=("mesh", "--max-error", "0.1"))
    assert "no channel 'nearer.Z' among" in " ".join(done.stderr.split())
    done, mesh = run("m.glb", "--depth-channel", "0:near.Z", command=("mesh", "--max-error", "0.1"))
    assert done.exit_code == 0, done.output
    assert ibr.Mesh.load(mesh).bounds[1][2] == 1
