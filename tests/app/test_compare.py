"""`pyibr compare` prints the library's figures for pictures, folders, videos and depth; errors are one line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pyibr as ibr
from pyibr.images import metrics
from tests.app.commands import assert_one_line, run, succeeded

COUNT, HEIGHT, WIDTH = 3, 24, 32


class Pairs:
    """Files of pictures and depth, and of the same with errors."""

    def __init__(self) -> None:
        rng = np.random.default_rng(0)
        self.colors = rng.integers(30, 220, (COUNT, HEIGHT, WIDTH, 3)).astype(np.uint8)
        self.others = (self.colors + rng.integers(-25, 26, self.colors.shape)).astype(np.uint8)
        self.depths = np.full((COUNT, HEIGHT, WIDTH), 2, np.float32)
        self.depths[:, :3] = np.nan
        self.wrong = self.depths + np.float32(0.02)
        self.wrong[:, -6:] = np.nan
        for number in range(COUNT):
            ibr.write_color(f"a/{number}.png", self.colors[number])
            ibr.write_color(f"b/{number}.png", self.others[number])
            ibr.write_depth(f"depth/{number}.png", self.depths[number], depth_scale=1000)
        np.save("wrong.npy", self.wrong)
        mask = np.zeros((HEIGHT, WIDTH), bool)
        mask[:, 16:] = True
        ibr.write_mask("mask.png", mask)
        self.mask = mask

    def run(self, *words: object):
        return run("compare", *words)

    def figures(self, *words: object) -> dict[str, Any]:
        return json.loads(succeeded(self.run(*words, "--json")))


DEPTHS = ("--depth", "--depth-scale", 1000, "--depth-scale-b", 1)


@pytest.fixture
def pairs(folder: Path) -> Pairs:
    return Pairs()


def test_two_pictures(pairs: Pairs):
    pytest.importorskip("skimage", reason="needs scikit-image, of the extra metrics")
    pytest.importorskip("flip_evaluator", reason="needs flip-evaluator, of the extra metrics")
    a, b = pairs.colors[0], pairs.others[0]
    found = pairs.figures("a/0.png", "b/0.png")
    assert found["frames"] == 1 and found["size"] == "32x24"
    assert found["mean"] == {name: getattr(metrics, name)(a, b) for name in ("psnr", "ssim", "flip", "iv_psnr")}
    masked = pairs.figures("a/0.png", "b/0.png", "--mask", "mask.png", "--metrics", "psnr,ws-psnr")["mean"]
    assert masked == {"psnr": metrics.psnr(a, b, valid=pairs.mask), "ws_psnr": metrics.ws_psnr(a, b, valid=pairs.mask)}
    said = pairs.run("a/0.png", "b/0.png", "--metrics", "iv-psnr").stdout.splitlines()
    assert said[0].endswith("b/0.png: 32x24") and said[1] == f"  iv-psnr        {metrics.iv_psnr(a, b):.6g} dB"


def test_folders_and_videos(pairs: Pairs):
    ibr.write_video("b.mkv", pairs.others, 30)
    each = [metrics.psnr(a, b) for a, b in zip(pairs.colors, pairs.others, strict=True)]
    for other in ("b", "b.mkv"):
        found = pairs.figures("a", other, "--metrics", "psnr")
        assert found["mean"]["psnr"] == pytest.approx(np.mean(each))
        assert [one["psnr"] for one in found["each"]] == each
    Path("b/1.png").rename("b/7.png")  # files are paired by name
    found = pairs.figures("a", "b", "--metrics", "psnr")
    assert [(one["name"], one["psnr"]) for one in found["each"]] == [("0", each[0]), ("2", each[2])]
    assert "2 files without a partner are left out" in pairs.run("a", "b", "--metrics", "psnr").stderr
    said = pairs.run("a", "b.mkv", "--metrics", "psnr").stdout
    assert f"the worst {min(each):.6g} dB, {each.index(min(each))}" in said


def test_what_is_equal_is_null_in_json(pairs: Pairs):
    assert pairs.figures("a", "a", "--metrics", "psnr")["mean"] == {"psnr": None}
    assert "inf dB" in pairs.run("a", "a", "--metrics", "psnr").stdout


@pytest.mark.parametrize("truth", ["depth", "depth.mkv"])
def test_depth(pairs: Pairs, truth: str):
    counts = [ibr.uint16_from_depth(depth, 1000) for depth in pairs.depths]
    ibr.write_video("depth.mkv", counts, 30, bits=16)
    words = (truth, "wrong.npy", *DEPTHS)
    found = pairs.figures(*words)["mean"]
    covered = {"covered_a": 7 / 8, "covered_b": 5 / 8, "covered_both": 5 / 8}
    expected = {"rmse": 0.02, "median_error": 0.02, "relative_error": 0.01, **covered}
    assert found == pytest.approx(expected, rel=1e-4)
    masked = pairs.figures(*words, "--mask", "mask.png")["mean"]
    assert masked == pytest.approx(expected, rel=1e-4)


def test_depth_that_nothing_has_in_common(pairs: Pairs):
    np.save("none.npy", np.full_like(pairs.depths, np.nan))
    result = pairs.run("depth", "none.npy", *DEPTHS, "--json")
    assert result.exit_code == 3
    found = json.loads(result.stdout)["mean"]
    assert found["rmse"] is None and found["covered_b"] == 0 and found["covered_a"] == pytest.approx(7 / 8)


def test_pictures_of_errors(pairs: Pairs):
    a, b = "black.png", "other.png"
    image = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    ibr.write_color(a, image)
    image[:, 8:16], image[:, 16:] = 64, 21  # white means errors of a quarter of the peak, red a third of white's
    ibr.write_color(b, image)
    succeeded(pairs.run(a, b, "--metrics", "psnr", "-o", "errors.png", "--mask", "mask.png"))
    errors = ibr.read_color("errors.png")
    assert (errors[:, :16] == (30, 30, 60)).all() and (errors[:, 16:] == (252, 0, 0)).all()
    pairs.run(a, b, "--metrics", "psnr", "-o", "errors.png")
    assert (ibr.read_color("errors.png")[:, 8:16] == 255).all()


def test_pictures_of_errors_of_depth(pairs: Pairs):
    assert pairs.run("depth", "wrong.npy", *DEPTHS, "-o", "errors.mkv").exit_code == 0
    for errors in ibr.Video("errors.mkv"):
        assert (errors[:3] == (30, 30, 60)).all() and (errors[-6:] == (60, 60, 160)).all()
        assert (errors[3:-6] == (153, 0, 0)).all()  # errors of 1 % are red here; 5 % would be white


def test_figures_in_a_file(pairs: Pairs):
    assert pairs.run("a", "b", "--metrics", "psnr", "-o", "out/figures.json").exit_code == 0
    told = json.loads(Path("out/figures.json").read_text())
    assert told["mean"] == pairs.figures("a", "b", "--metrics", "psnr")["mean"]


def test_what_is_not_installed_is_left_out_and_told(pairs: Pairs, monkeypatch: pytest.MonkeyPatch):
    def missing(name: str) -> None:
        raise ModuleNotFoundError(name=name.partition(".")[0])

    monkeypatch.setattr("pyibr.core.optional.import_module", missing)
    result = pairs.run("a/0.png", "b/0.png")
    assert result.exit_code == 0 and "flip is left out: FLIP needs flip-evaluator: pip install" in result.stderr
    assert [line.split()[0] for line in result.stdout.splitlines()[1:]] == ["psnr", "iv-psnr"]
    assert pairs.run("a/0.png", "b/0.png", "--metrics", "flip").exit_code == 2


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("a", "nothing"), "nothing: no such file or folder"),
        (("a", "black.png"), "expected 3 frames, or files of the same names, got 1"),
        (("a/0.png", "small.png"), "small.png: expected 32x24 pixels, as A has, got 4x3"),
        (("a", "b", "--metrics", "psnr,lpips"), "--metrics: expected some of psnr, ssim, flip, iv-psnr, ws-psnr"),
        (("a", "b", "--depth", "--metrics", "psnr"), "--metrics: expected none with --depth"),
        (("a", "b", "--depth-scale-b", "2"), "--depth-scale-b: expected --depth with it"),
        (("depth", "depth", "--depth"), "--depth-scale: expected stored units"),
        (("a/0.png", "b/0.png", "-o", "a/0.png"), "--output: expected a file of its own"),
        (("a/0.png", "b/0.png", "-o", "e.mp4"), "--output: expected several views for a video"),
        (("a/0.png", "b/0.png", "--fps", "30"), "expected a video for --output"),
        (("a/0.png", "b/0.png", "--mask", "black.png", "--metrics", "psnr"), "--mask: expected a pixel that counts"),
        (("a/0.png", "b/0.png", "--mask", "small.png", "--metrics", "psnr"), "--mask: expected bool of shape (24, 32)"),
    ],
)
def test_mistakes_are_told_in_one_line(pairs: Pairs, words, said):
    ibr.write_color("small.png", np.zeros((3, 4, 3), np.uint8))
    ibr.write_color("black.png", np.zeros((HEIGHT, WIDTH, 3), np.uint8))
    assert_one_line(pairs.run(*words), said, progress="Comparing")
