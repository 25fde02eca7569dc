"""Bad input raises an error that names the argument, the expected value and the given value."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import pyibr as ibr
from pyibr.app.cli import app
from pyibr.core.errors import ArgumentError

K = [[50, 0, 20], [0, 50, 15], [0, 0, 1]]
SIZE = (41, 31)
CAMERA = ibr.Camera(K, SIZE)
COLOR = np.full((31, 41, 3), 100, np.uint8)
DEPTH = np.full((31, 41), 2, np.float32)
VIEW = ibr.DepthImage(COLOR, DEPTH, CAMERA)
FLOATS = ibr.DepthImage((COLOR / np.float32(255)).astype(np.float32), DEPTH, CAMERA)
MIRROR = np.diag([-1.0, 1, 1, 1])
SHEAR = np.eye(4) + np.eye(4, k=1) * 0.1

Call = Callable[[], Any]


def warp(views: Any = VIEW, camera: Any = CAMERA, *rest: Any, **options: Any) -> ibr.Frame:
    return ibr.warp(views, camera, *rest, **options)


def image(color: Any = COLOR, depth: Any = DEPTH, camera: Any = CAMERA, **options: Any) -> ibr.DepthImage:
    return ibr.DepthImage(color, depth, camera, **options)


# The call, the argument that the error names, and the error's words for the expected and for the given value.
CASES: dict[str, tuple[Call, str, str, str]] = {
    "no view": (lambda: warp([]), "views", "at least one DepthImage", "an empty sequence"),
    "an array as view": (lambda: warp(COLOR), "views", "DepthImage", "(31, 41, 3)"),
    "None as view": (lambda: warp(None), "views", "DepthImage", "None"),
    "a frame among views": (lambda: warp([VIEW, "view"]), "views", "DepthImage", "'view'"),
    "two dtypes": (lambda: warp([VIEW, FLOATS]), "views", "one dtype", "uint8 and float32"),
    "a matrix as camera": (lambda: warp(VIEW, np.eye(4)), "camera", "pyibr.Camera", "(4, 4)"),
    "None as camera": (lambda: warp(VIEW, None), "camera", "pyibr.Camera", "None"),
    "nan everywhere": (lambda: warp(image(depth=DEPTH * np.nan)), "depth", "at least one sample", "none"),
    "zeros everywhere": (lambda: warp(image(depth=DEPTH * 0)), "depth", "at least one sample", "none"),
    "all background": (lambda: warp(image(far=2.0)), "depth", "nearer than `far`", "none"),
    "one view of two is empty": (
        lambda: warp([VIEW, image(depth=-DEPTH)]),
        "depth",
        "at least one sample",
        "none",
    ),
    "a column that is too long": (
        lambda: warp(image(np.zeros((1 << 21, 1, 3), np.uint8), np.ones((1 << 21, 1)), ibr.Camera(K, (1, 1 << 21)))),
        "views",
        "at most 1048576 pixels a side",
        "1 x 2097152",
    ),
    "gray": (lambda: image(COLOR[..., 0]), "color", "(31, 41, 3)", "gray"),
    "alpha": (lambda: image(np.dstack([COLOR, DEPTH.astype(np.uint8)])), "color", "(31, 41, 3)", "alpha"),
    "floats to 255": (lambda: image(COLOR / 1.0), "color", "[0, 1]", "divide them by 255"),
    "16-bit colour": (lambda: image(COLOR.astype(np.uint16)), "color", "uint8", "uint16"),
    "a list as colour": (lambda: image(COLOR.tolist()), "color", "uint8", "list"),
    "colour turned": (lambda: image(COLOR.transpose(1, 0, 2)), "color", "(31, 41, 3)", "(41, 31, 3)"),
    "integer depth": (lambda: image(depth=DEPTH.astype(np.uint16)), "depth", "float32", "depth_from_uint16"),
    "depth of other size": (lambda: image(depth=DEPTH[:-1]), "depth", "(31, 41)", "(30, 41)"),
    "depth with a channel": (lambda: image(depth=DEPTH[..., None]), "depth", "(31, 41)", "(31, 41, 1)"),
    "camera of other size": (
        lambda: image(camera=CAMERA.resized((40, 31))),
        "color",
        "(31, 40, 3)",
        "(31, 41, 3)",
    ),
    "no camera": (lambda: image(camera=None), "camera", "pyibr.Camera", "None"),
    "far of 0": (lambda: image(far=0.0), "far", "> 0", "0.0"),
    "far, nan": (lambda: image(far=math.nan), "far", "> 0", "nan"),
    "images of no pixel": (
        lambda: image(COLOR[:0], DEPTH[:0], ibr.Camera(K, (41, 0))),
        "size",
        "integers > 0",
        "(41, 0)",
    ),
    "singular K": (lambda: ibr.Camera(np.zeros((3, 3)), SIZE), "K", "fx, fy > 0", "0.0"),
    "K of focal length 0": (
        lambda: ibr.Camera([[0, 0, 1], [0, 5, 1], [0, 0, 1]], SIZE),
        "K",
        "fx, fy > 0",
        "0.0",
    ),
    "K, nan": (lambda: ibr.Camera(np.full((3, 3), np.nan), SIZE), "K", "finite", "not finite"),
    "K, 4x5": (lambda: ibr.Camera(np.eye(4, 5), SIZE), "K", "(3, 3)", "(4, 5)"),
    "size of floats": (lambda: ibr.Camera(K, (41.0, 31.0)), "size", "integers", "41.0"),
    "size, negative": (lambda: ibr.Camera(K, (-1, 31)), "size", "> 0", "(-1, 31)"),
    "mirrored pose": (lambda: ibr.Camera(K, SIZE, MIRROR), "world_from_camera", "rigid", "det R = -1"),
    "sheared pose": (lambda: ibr.Camera(K, SIZE, SHEAR), "world_from_camera", "rigid", "R^T R"),
    "scaled pose": (
        lambda: ibr.Camera(K, SIZE, 2 * np.eye(4)),
        "world_from_camera",
        "rigid",
        "[0.0, 0.0, 0.0, 2.0]",
    ),
    "pose, nan": (
        lambda: ibr.Camera(K, SIZE, np.eye(4) * np.nan),
        "world_from_camera",
        "finite",
        "not finite",
    ),
    "pose, 3x4": (lambda: ibr.Camera(K, SIZE, np.eye(4)[:3]), "world_from_camera", "(4, 4)", "(3, 4)"),
    "K, huge": (lambda: ibr.Camera([[50, 0, 1e30], [0, 50, 15], [0, 0, 1]], SIZE), "K", "up to 1e+18", "1e+30"),
    "K, tiny": (lambda: ibr.Camera([[1e-30, 0, 20], [0, 50, 15], [0, 0, 1]], SIZE), "K", "from 1e-18 on", "1e-30"),
    "pose, far": (lambda: CAMERA.moved(0, 1e30, 0), "world_from_camera", "up to 1e+18", "1e+30"),
    "far, an array": (lambda: image(far=DEPTH), "far", "> 0", "(31, 41)"),
    "a target of too many pixels": (
        lambda: warp(VIEW, ibr.Camera(K, (1 << 15, 1 << 15))),
        "camera",
        "pixels",
        "32768 x",
    ),
    "depths that are too large": (lambda: warp(image(depth=DEPTH * 1e20)), "depth", "1e+09", "2e+20"),
    "depths that are too small": (lambda: warp(image(depth=DEPTH * 1e-20)), "depth", "1e-08", "2e-20"),
    "projection": (lambda: ibr.Camera(K, SIZE, None, projection="fisheye"), "projection", '"orthographic"', "fisheye"),
}


# Options of `warp` and of `WarpedView`, the first of which the error names, and its words.
OPTIONS: list[tuple[dict[str, Any], str, str]] = [
    ({"method": "sweep"}, '"search"', "'sweep'"),
    ({"method": ["search"]}, '"search"', "['search']"),
    ({"interpolation": "cubic"}, '"linear", "nearest"', "'cubic'"),
    ({"interpolation": None}, '"linear", "nearest"', "None"),
    ({"edges": "torn"}, '"connect", "cut"', "'torn'"),
    ({"edges": None}, '"connect", "cut"', "None"),
    ({"edges": ["cut"]}, '"connect", "cut"', "['cut']"),
    ({"fill": "foreground"}, '"background", "smooth", "inpaint", "exemplar" or None', "'foreground'"),
    ({"fill": True}, '"background", "smooth", "inpaint", "exemplar" or None', "True"),
    ({"side": "left"}, '"front", "back", "both"', "'left'"),
    ({"side": True}, '"front", "back", "both"', "True"),
    ({"blend": "mean"}, '"quality", "nearest"', "'mean'"),
    ({"cut_ratio": 1.0}, "greater than 1", "1.0"),
    ({"cut_ratio": math.nan}, "greater than 1", "nan"),
    ({"cut_ratio": math.inf}, "greater than 1", "inf"),
    ({"cut_ratio": "2"}, "greater than 1", "'2'"),
    ({"splat": 0.5, "method": "forward"}, "1 to 64", "0.5"),
    ({"splat": 1e9, "method": "forward"}, "1 to 64", "1000000000.0"),
    ({"splat": math.nan, "method": "forward"}, "1 to 64", "nan"),
    *[({"thin": value}, "True or False", told) for value, told in ((1, "1"), ("yes", "'yes'"), (None, "None"))],
    ({"thin": np.zeros(2)}, "True or False", "(2,)"),
]
for name in ("thin", "origins", "classes"):
    CASES[f"{name}, forward"] = partial(warp, method="forward", **{name: True}), name, "False", "True"
for name in ("origins", "classes"):
    CASES[f"{name}, text"] = partial(warp, **{name: "yes"}), name, "True or False", "'yes'"
for options, *words in OPTIONS:
    CASES[f"warp, {options}"] = partial(warp, **options), next(iter(options)), *words
    CASES[f"WarpedView, {options}"] = partial(ibr.WarpedView, VIEW, **options), next(iter(options)), *words


@pytest.mark.parametrize(("call", "argument", "expected", "got"), CASES.values(), ids=CASES.keys())
def test_the_error_names_argument_expected_and_got(call, argument, expected, got):
    with pytest.raises(ArgumentError) as caught:
        call()
    text = str(caught.value)
    assert caught.value.argument == argument
    assert text.startswith(f"{argument}: expected ")
    middle, came = text.split(", got ", 1)
    assert expected in middle
    assert got in came
    assert "\n" not in text


@pytest.mark.parametrize("method", ["epipolar", "search", "forward"])
@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_a_target_that_sees_nothing_gets_a_warning_and_holes(method, projection):
    K_here = K if projection == "perspective" else [[10, 0, 20], [0, 10, 15], [0, 0, 1]]
    away = ibr.Camera(K_here, (33, 25), np.diag([-1.0, 1, -1, 1]), projection=projection).moved(0, 0, 1)
    aside = ibr.Camera(K_here, (33, 25), projection=projection).moved(100, 0, 0)
    ibr.warp(VIEW, VIEW.camera, method=method)
    for thread in threading.enumerate():  # a thread that builds programs ahead changes the warning filters
        if thread.name == "pyibr ahead":
            thread.join()
    for target in (away, aside):
        for fill in (None, "background", "smooth"):
            with pytest.warns(UserWarning, match="sees nothing") as caught:
                frame = ibr.warp(VIEW, target, method=method, fill=fill)
            assert caught[0].filename == __file__  # the caller's line, not a line of pyibr
            assert not frame.valid.any()
            assert np.isnan(frame.depth).all()
            assert (frame.color == 0).all()
            assert frame.color.shape == (25, 33, 3)


def test_a_tuple_of_views_is_a_sequence():
    np.testing.assert_array_equal(warp((VIEW, VIEW)).depth, warp(VIEW).depth)


@pytest.mark.parametrize("method", ["epipolar", "search", "forward"])
@pytest.mark.parametrize("extreme", [1e-30, 1e-12, 1e12, 1e30])
@pytest.mark.filterwarnings("ignore:warp. the target camera sees nothing")
def test_extreme_depths_do_no_harm(method, extreme):
    """One extreme sample may spoil its surroundings, and nothing else."""
    depth = DEPTH.copy()
    depth[15, 20] = extreme
    for target in (CAMERA.moved(0.2, 0.1, 0), CAMERA.moved(0, 0, 1.0), CAMERA.orbited(20, (0, 0, 2))):
        frame = ibr.warp(ibr.DepthImage(COLOR, depth, CAMERA), target, method=method, edges="cut")
        clean = ibr.warp(VIEW, target, method=method, edges="cut")
        np.testing.assert_array_equal(np.isfinite(frame.depth), frame.valid)
        same = frame.valid & clean.valid & np.isclose(frame.depth, clean.depth, rtol=1e-3)
        # 60: one sample spoils six triangles. With the pixels along their rims, they cover little more than 5 x 5.
        assert np.count_nonzero(clean.valid & ~same) <= 60


def test_the_command_line_says_it_in_one_line(tmp_path):
    CAMERA.save(tmp_path / "camera.json")
    ibr.write_color(tmp_path / "color.png", COLOR)
    np.save(tmp_path / "depth.npy", DEPTH)
    np.save(tmp_path / "none.npy", DEPTH * np.nan)
    np.save(tmp_path / "small.npy", DEPTH[:5])
    (tmp_path / "torn.png").write_bytes((tmp_path / "color.png").read_bytes()[:60])
    (tmp_path / "skew.json").write_text('{"width": 41, "height": 31, "K": [[0, 0, 20], [0, 50, 15], [0, 0, 1]]}')

    def told(color="color.png", depth="depth.npy", camera="camera.json", *rest: str) -> str:
        words = [
            tmp_path / color,
            tmp_path / depth,
            "--camera",
            tmp_path / camera,
            "-o",
            tmp_path / "out.png",
        ]
        result = CliRunner().invoke(app, ["warp", *map(str, words), *(rest or ("--move", "0.1", "0", "0"))])
        assert result.exit_code == 2, result.output
        assert not (tmp_path / "out.png").exists()
        (line,) = result.stderr.strip().splitlines()
        return line

    assert "depth: expected" in told(depth="none.npy")
    assert "expected 41x31 samples" in told(depth="small.npy")
    assert "torn.png" in told(color="torn.png")
    assert "skew.json: K: expected" in told(camera="skew.json")
    assert "missing.npy" in told(depth="missing.npy")
    flat = "--orbit", "5", "--cut-ratio", "0.5"
    assert "--cut-ratio: expected" in told("color.png", "depth.npy", "camera.json", *flat)
