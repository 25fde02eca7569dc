"""The warp's use of OpenCL: a second process uses the first one's cache, and the kernels' form for GPUs works."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import pyibr as ibr
from pyibr.core.camera import Projection
from tests import scenes
from tests.one_lane import both_forms, unlike
from tools.processes import with_path

FIRST_FRAME = """
import numpy as np, pyibr as ibr
from pyibr.opencl.program import keeping_binaries
camera = ibr.Camera([[30, 0, 20], [0, 30, 15], [0, 0, 1]], (41, 31))
view = ibr.DepthImage(np.full((31, 41, 3), 9, np.uint8), np.full((31, 41), 2, np.float32), camera)
with keeping_binaries():
    frame = ibr.warp(view, camera.moved(0.1, 0.05, 0.2), fill="background")
print(int(frame.valid.sum()))
"""


def run(*command: str, timeout: float = 120, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, env=with_path(**environment), capture_output=True, text=True, timeout=timeout)


def test_the_second_process_builds_nothing(tmp_path: Path):
    cache = str(tmp_path / "cache")
    first = run(sys.executable, "-c", FIRST_FRAME, PYIBR_CACHE=cache)
    assert first.returncode == 0, first.stderr
    binaries = {path: path.stat().st_mtime_ns for path in (Path(cache) / "programs").iterdir()}
    assert len(binaries) >= 4  # nearness, epipolar, resolve, fill
    # To forbid builds, making a program from source raises.
    forbid = "import pyopencl as cl; make = cl.Program.__init__\n" + (
        "def refuse(self, context, *rest):\n"
        "    assert len(rest) == 2, 'built from source'\n"
        "    make(self, context, *rest)\n"
        "cl.Program.__init__ = refuse\n"
    )
    second = run(sys.executable, "-c", forbid + FIRST_FRAME, PYIBR_CACHE=cache)
    assert (second.returncode, second.stdout) == (0, first.stdout), second.stderr
    assert {path: path.stat().st_mtime_ns for path in (Path(cache) / "programs").iterdir()} == binaries


def frames(place: str, source: Projection) -> list[ibr.Frame]:
    kept = scenes.holed((96, 64), source)
    view = ibr.DepthImage(kept.color, kept.depth, kept.camera, far=kept.far)
    poses = scenes.special_cameras(view) if place == "special" else scenes.target_cameras(view, place)
    options: tuple[dict[str, Any], ...] = (
        {},
        {"edges": "connect"},
        {"interpolation": "nearest", "side": "both", "edges": "connect"},
        {"method": "search"},
        {"method": "forward"},
    )
    made = [ibr.warp(view, pose.camera, **some) for pose in poses for some in options]
    first = poses[0].camera
    return [*made, ibr.warp([view, scenes.smooth((61, 37), source)], first, fill="background")]


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("place", "source"),
    [("E", "perspective"), ("A", "orthographic"), ("special", "perspective"), ("special", "orthographic")],
)
def test_one_lane_is_as_good_as_sixteen(place, source):
    for number, (other, one) in enumerate(zip(*both_forms(lambda: frames(place, source)), strict=True)):
        # Compilers fuse different products and sums in the two forms: last bits differ, and so may silhouettes.
        outlines, depths, colors = unlike(one, other, rtol=1e-5)
        assert max(outlines, depths, colors) <= 0.001, number
