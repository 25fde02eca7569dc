"""All examples in `--help` and on the manual's page of commands run, on files with the names that they use."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import numpy as np
import pytest

import pyibr as ibr
from pyibr.app import cli
from pyibr.app.batch.work import COMMANDS
from pyibr.capture import models, object_views
from pyibr.capture.frusta import Frustum, save_frusta, save_set
from tests.app.commands import run, succeeded
from tests.gaussians.clouds import cloud
from tests.test_docs import BLOCK, ROOT

SIZE = (46, 34)
PAGES = ("view", "place")  # commands that stay open
OTHERS = ("batch", "doctor")  # whose examples other tests run
QUICK = ("compare", "convert")
HELP = [
    f"{command} {use}"
    for command, uses in cli._EXAMPLES.items()  # pyright: ignore[reportPrivateUsage]
    for use in uses
]
MANUAL = [
    " ".join(line.removeprefix("pyibr ").split())
    for kind, source in BLOCK.findall((ROOT / "docs/cli.md").read_text(encoding="utf-8"))
    for line in source.replace("\\\n", " ").splitlines()
    if kind == "sh"
]
EXAMPLES = [use for use in HELP if use.split()[0] not in PAGES + OTHERS] + [use for use in MANUAL if use not in HELP]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Files of all names in the examples: a box before a wall, seen by two cameras, and a ring."""
    place = tmp_path_factory.mktemp("examples")
    camera = ibr.Camera([[50, 0, 23], [0, 50, 17], [0, 0, 1]], SIZE)
    depth = np.full(SIZE[::-1], 2, np.float32)
    depth[10:20, 15:30] = 1
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    color = np.dstack([5 * x, 7 * y, 0 * x + 90]).astype(np.uint8)
    for name in ("camera", "a", "b", "depth", "color", "new"):
        camera.moved(0.01, 0, 0).save(place / f"{name}.json")
    for name in ("a", "b", "rgb/0", "rgb/1"):
        ibr.write_color(place / f"{name}.png", color)
    for name in ("depth.png", "a_depth.npy", "b_depth.png", "b_depth.npy", "a_depth.png", "depth/0.png", "depth/1.png"):
        ibr.write_depth(place / name, depth, depth_scale=1000 if name.endswith("png") else None)
    for name, shown in (("color", color), ("truth", color), ("new", color[:, ::-1])):
        ibr.write_color(place / f"{name}.png", shown)
        ibr.write_video(place / f"{name}.mp4", [shown, shown], fps=12)
    for name, values in (("depth", depth), ("new_depth", depth[:, ::-1])):
        ibr.write_video(place / f"{name}.mkv", [ibr.uint16_from_depth(values, 1000)] * 2, fps=12, bits=16)
    size, matrix = f"image_width: {SIZE[0]}\nimage_height: {SIZE[1]}\n", camera.K.ravel().tolist()
    (place / "calibration.yaml").write_text(f"{size}camera_matrix: {{rows: 3, cols: 3, data: {matrix}}}\n")
    tum = place / "rgbd_dataset_freiburg1_desk"
    for number in range(2):
        ibr.write_color(tum / f"rgb/{number + 0.5}.png", np.zeros((480, 640, 3), np.uint8) + np.uint8(90))
        ibr.write_depth(tum / f"depth/{number + 0.5}.png", np.full((480, 640), 2, np.float32), depth_scale=5000)
    (tum / "groundtruth.txt").write_text("".join(f"{number + 0.5} 0.0{number} 0 0 0 0 0 1\n" for number in range(2)))
    for kind in ("rgb", "depth"):
        (tum / f"{kind}.txt").write_text("".join(f"{n + 0.5} {kind}/{n + 0.5}.png\n" for n in range(2)))
    ring = models.donut(12)
    views = object_views(ring, 24)
    ibr.Mesh(ring.vertices, ring.faces).save(place / "dragon.ply")
    ring.save(place / "ball.glb")
    cloud(300, middle=1.0).save(place / "gaussians.ply")
    ibr.write_color(place / "bumps.png", color[..., :1].repeat(3, axis=2))
    ibr.write_color(place / "bricks.png", color)
    for number, view in enumerate(views):
        ibr.write_color(place / f"room/{number}.color.png", view.color)
        ibr.write_depth(place / f"room/{number}.depth.png", view.depth, depth_scale=1000)
        view.camera.save(place / f"room/{number}.json")
        ibr.write_color(place / f"pictures/{number}.png", view.color)
        ibr.write_mask(place / f"masks/{number}.png", view.valid)

    frusta = [Frustum.look_at((0, 0, sign * 4), (0, 0, 0), (0, 1, 0), 24) for sign in (-1, 1)]
    save_frusta(place / "frusta.json", frusta)
    save_set(place / "dragon", frusta, [one.capture(ring) for one in frusta])
    cameras = [view.camera.to_json() for view in views]

    (place / "cameras.json").write_text(json.dumps(cameras))
    return place


def test_each_command_that_writes_files_runs_in_batches():
    names = set(cli._EXAMPLES)  # pyright: ignore[reportPrivateUsage]
    assert names - {"batch", "doctor", *PAGES} == set(COMMANDS)


@pytest.mark.parametrize(
    "example", [pytest.param(use, marks=[pytest.mark.thorough] * (use.split()[0] not in QUICK)) for use in EXAMPLES]
)
def test_an_example_runs(folder: Path, monkeypatch: pytest.MonkeyPatch, example: str):
    if ".exr" in example:
        pytest.importorskip("OpenEXR", reason="needs OpenEXR, of the extra exr")
    monkeypatch.chdir(folder)
    succeeded(run(*shlex.split(example)))
