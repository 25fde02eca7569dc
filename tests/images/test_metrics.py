"""The metrics, compared with values computed by hand, by their authors, or by other packages."""

from __future__ import annotations

import functools
import lzma
import math
from typing import Any

import numpy as np
import pytest

from pyibr.core.errors import ArgumentError, MissingPackageError
from pyibr.images import metrics
from tests.data import shared

DARK = np.zeros((2, 3, 3), np.uint8)


def test_psnr():
    bright = DARK.copy()
    bright[0, 0] = 51  # off by a fifth of the peak at one of six pixels
    assert metrics.psnr(DARK, bright) == pytest.approx(10 * math.log10(150))
    assert metrics.psnr(DARK / 255.0, bright / 255.0) == pytest.approx(10 * math.log10(150))
    assert metrics.psnr(DARK, bright, valid=bright[..., 0] > 0) == pytest.approx(10 * math.log10(25))
    assert metrics.psnr(DARK, bright, valid=bright[..., 0] == 0) == math.inf


def test_bytes_do_not_wrap_around():
    one, most = np.full((1, 1), 1, np.uint8), np.full((1, 1), 255, np.uint8)
    assert metrics.psnr(one, most) == pytest.approx(20 * math.log10(255 / 254))
    assert metrics.median_color_error(one, most) == 254


def test_median_color_error():
    a = np.arange(5, dtype=np.uint8)[None] ** 2
    b = np.zeros((1, 5), np.uint8)
    assert metrics.median_color_error(a, b) == 4  # median of 0, 1, 4, 9 and 16
    assert metrics.median_color_error(b, a, valid=np.array([[False, True, True, True, True]])) == 6.5


def test_depth_errors_count_what_both_know():
    nan, inf = np.nan, np.inf
    depth = np.array([[1.0, 2.0, 7.0, nan, 5.0, 5.0, inf]], np.float32)
    truth = np.array([[4.0, 6.0, 7.0, 1.0, nan, 0.0, 3.0]])
    assert metrics.depth_rmse(depth, truth) == pytest.approx(5 / math.sqrt(3))  # differences are 3, 4 and 0
    assert metrics.median_depth_error(depth, truth) == 3
    two = np.array([[True, True, False, True, True, True, True]])
    assert metrics.depth_rmse(depth, truth, valid=two) == pytest.approx(5 / math.sqrt(2))
    assert metrics.median_depth_error(depth, truth, valid=two) == 3.5


def test_hole_ratio():
    valid = np.array([[True, True, False, False]])
    assert metrics.hole_ratio(valid) == 0.5
    assert metrics.hole_ratio(valid, expected=np.array([[True, False, False, False]])) == 0
    assert metrics.hole_ratio(valid, expected=np.array([[True, True, True, False]])) == pytest.approx(1 / 3)


def test_silhouette_iou():
    y, x = np.mgrid[:10, :10]
    left, right = x < 6, x >= 4  # 60 pixels each, 20 of them in both
    assert metrics.silhouette_iou(left, right) == 0.2 and metrics.silhouette_iou(left, left) == 1
    assert metrics.silhouette_iou(left, x > 8) == 0 and metrics.silhouette_iou(y < 0, y == 0) == 0


YES, NO = np.ones((2, 3), bool), np.zeros((2, 3), bool)
PLANE: Any = np.ones((2, 3))


@pytest.mark.parametrize(
    ("call", "argument"),
    [
        (lambda: metrics.psnr(DARK, DARK[:1]), "b"),
        (lambda: metrics.psnr(DARK, DARK / 255.0), "b"),
        (lambda: metrics.psnr(DARK.astype(np.uint16), DARK.astype(np.uint16)), "b"),
        (lambda: metrics.psnr(DARK, DARK, valid=NO), "valid"),
        (lambda: metrics.psnr(DARK, DARK, valid=YES[:1]), "valid"),
        (lambda: metrics.median_color_error(DARK, DARK, valid=(PLANE > 0).astype(np.uint8)), "valid"),
        (lambda: metrics.depth_rmse(PLANE, PLANE[:1]), "truth"),
        (lambda: metrics.depth_rmse(PLANE, np.nan * PLANE), "valid"),
        (lambda: metrics.median_depth_error(PLANE, PLANE, valid=YES[:, :1]), "valid"),
        (lambda: metrics.ws_psnr(DARK, DARK, latitudes=0), "latitudes"),
        (lambda: metrics.ws_psnr(DARK, DARK, valid=NO), "valid"),
        (lambda: metrics.iv_psnr(DARK, DARK[:1]), "b"),
        (lambda: metrics.iv_psnr(DARK[..., 0], DARK[..., 0]), "a"),
        (lambda: metrics.iv_psnr(DARK, DARK, valid=NO), "valid"),
        (lambda: metrics.iv_psnr(DARK, DARK, space="lab"), "space"),
        (lambda: metrics.iv_psnr(DARK, DARK, bits=7), "bits"),
        (lambda: metrics.iv_psnr(DARK, DARK, reach=-1), "reach"),
        (lambda: metrics.ssim(DARK, DARK), "a"),
        (lambda: metrics.flip(DARK, DARK[:1]), "b"),
        (lambda: metrics.flip(DARK[..., 0], DARK[..., 0]), "a"),
        (lambda: metrics.hole_ratio(PLANE), "valid"),
        (lambda: metrics.hole_ratio(YES, expected=NO), "expected"),
        (lambda: metrics.hole_ratio(YES, expected=YES[:1]), "expected"),
        (lambda: metrics.silhouette_iou(YES, YES[:1]), "b"),
        (lambda: metrics.silhouette_iou(PLANE, YES), "a"),
        (lambda: metrics.silhouette_iou(NO, NO), "a"),
    ],
)
def test_bad_arguments_are_named(call, argument):
    with pytest.raises(ArgumentError) as caught:
        call()
    assert caught.value.argument == argument


# ---- weighted and tolerant metrics: values computed by hand


def test_rows_of_a_panorama_weigh_as_much_as_the_sphere_that_they_show():
    sphere = np.zeros((4, 6, 3))
    middle, pole = sphere.copy(), sphere.copy()
    middle[1], pole[0] = 0.5, 0.5
    weights = np.cos(np.radians([-67.5, -22.5, 22.5, 67.5]))
    half = np.cos(np.radians([-33.75, -11.25, 11.25, 33.75]))
    below = np.arange(4)[:, None] > np.zeros(6)
    for picture, how, ratio in (
        (pole, {}, weights.sum() / weights[0]),
        (middle, {}, weights.sum() / weights[1]),
        (pole, {"latitudes": 90}, half.sum() / half[0]),
        (middle, {"valid": below}, weights[1:].sum() / weights[1]),
    ):
        assert metrics.ws_psnr(sphere, picture, **how) == pytest.approx(10 * math.log10(4 * ratio))
    assert metrics.ws_psnr(sphere, pole, valid=below) == math.inf


def in_decibels(*differences: float) -> float:
    """IV-PSNR, for 8 bits, by the root mean squared differences of luma and of the two chroma channels."""
    luma, blue, red = (20 * math.log10(255 / one) for one in differences)
    return (4 * luma + blue + red) / 6


GRAY = np.full((12, 15, 3), (100, 110, 120), np.uint8)


def test_iv_psnr_forgives_a_hundredth_of_the_range():
    assert metrics.iv_psnr(GRAY, GRAY + np.uint8(3), space="ycbcr") == math.inf
    brighter = GRAY + np.array([10, 5, 4], np.uint8)  # 3 are tolerated
    assert metrics.iv_psnr(GRAY, brighter, space="ycbcr") == pytest.approx(in_decibels(7, 2, 1))
    assert metrics.iv_psnr(brighter, GRAY, space="ycbcr") == pytest.approx(in_decibels(7, 2, 1))
    deep = [4 * one.astype(np.uint16) for one in (GRAY, brighter)]
    expected = [20 * math.log10(1023 / (4 * by - 10)) for by in (10, 5, 4)]  # a hundredth of 1023 is 10
    found = metrics.iv_psnr(*deep, space="ycbcr", bits=10)
    assert found == pytest.approx((4 * expected[0] + expected[1] + expected[2]) / 6)


@pytest.mark.parametrize(("by", "found"), [((2, 2), True), ((-2, 1), True), ((3, 0), False), ((0, -3), False)])
def test_iv_psnr_finds_what_lies_two_pixels_aside(by, found):
    still, moved = GRAY.copy(), GRAY.copy()
    still[6, 7] = moved[6 + by[0], 7 + by[1]] = (150, 150, 150)  # one of 180 pixels is off by 50, 40, 30
    expected = math.inf if found else in_decibels(*(one / math.sqrt(180) for one in (50, 40, 30)))
    assert metrics.iv_psnr(still, moved, space="ycbcr") == pytest.approx(expected)
    right = np.arange(15)[None] >= np.full((12, 1), 11)
    assert metrics.iv_psnr(still, moved, space="ycbcr", valid=right) == math.inf
    assert metrics.iv_psnr(still, moved, space="ycbcr", reach=3) == math.inf


def test_rgb_becomes_what_videos_hold():
    red, gray = (np.full((3, 4, 3), color, np.uint8) for color in ((255, 0, 0), (100, 100, 100)))
    stored = [np.full((3, 4, 3), color, np.uint8) for color in ((63, 102, 240), (102, 128, 128))]  # by BT.709
    expected = metrics.iv_psnr(*stored, space="ycbcr")
    assert metrics.iv_psnr(red, gray) == metrics.iv_psnr(red / 255.0, gray / 255.0) == expected
    assert expected == pytest.approx(in_decibels(36, 23, 109))


def fencing(name: str) -> np.ndarray:
    """(H, W, 3) YCbCr of a published frame, with chroma enlarged to the resolution of luma."""
    path = shared("metrics_ivpsnr") / f"Fencing_v8_{name}_1920x1080_yuv420p.yuv.xz"
    planes = np.frombuffer(lzma.decompress(path.read_bytes()), np.uint8)
    luma, chroma = planes[: 1080 * 1920].reshape(1080, 1920), planes[1080 * 1920 :].reshape(2, 540, 960)
    return np.dstack([luma, *chroma.repeat(2, 1).repeat(2, 2)])


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("name", "masked", "psnr", "iv_psnr", "ws_psnr"),
    [
        ("origJpgCompressed", False, 34.3362, 39.1335, 33.7760),
        ("synthesized", False, 34.0128, 44.3555, 33.9599),
        ("synthesized", True, 39.5414, 50.7716, None),
    ],
)
def test_published_figures(name, masked, psnr, iv_psnr, ws_psnr):
    """All published digits of the authors' example agree; WS-PSNR is compared with the output of their program."""
    truth, image = fencing("original"), fencing(name)
    valid = fencing("objectsMask")[..., 0] > 0 if masked else None
    assert round(metrics.psnr(truth[..., 0], image[..., 0], valid=valid), 4) == psnr
    assert round(metrics.iv_psnr(truth, image, space="ycbcr", valid=valid), 4) == iv_psnr
    if ws_psnr is not None:
        assert round(metrics.ws_psnr(truth[..., 0], image[..., 0]), 4) == ws_psnr


# ---- metrics of other packages


def noisy() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(1)
    image = rng.integers(0, 256, (23, 31, 3)).astype(np.uint8)
    return image, np.clip(image + rng.normal(0, 20, image.shape), 0, 255).astype(np.uint8)


def test_ssim_is_that_of_wang():
    pytest.importorskip("skimage", reason="needs scikit-image, of the extra metrics")
    a, b = noisy()
    window = np.exp(-np.square(np.arange(-5, 6)) / (2 * 1.5**2))
    window = np.outer(window, window) / window.sum() ** 2

    def mean(image: np.ndarray) -> np.ndarray:
        return (np.lib.stride_tricks.sliding_window_view(image, (11, 11)) * window).sum((-2, -1))

    maps = []
    for x, y in zip(np.moveaxis(a.astype(float), -1, 0), np.moveaxis(b.astype(float), -1, 0), strict=True):
        mx, my, c1, c2 = mean(x), mean(y), 2.55**2, 7.65**2
        xx, yy, xy = mean(x * x) - mx**2, mean(y * y) - my**2, mean(x * y) - mx * my
        maps.append((2 * mx * my + c1) * (2 * xy + c2) / ((mx**2 + my**2 + c1) * (xx + yy + c2)))
    assert metrics.ssim(a, b) == pytest.approx(np.mean(maps), abs=1e-12)
    assert metrics.ssim(a / 255.0, b / 255.0) == pytest.approx(np.mean(maps), abs=1e-12)
    assert metrics.ssim(a[..., 1], b[..., 1]) == pytest.approx(np.mean(maps[1]), abs=1e-12)
    left = np.arange(31)[None] < np.full((23, 1), 12)
    assert metrics.ssim(a, b, valid=left) == pytest.approx(np.mean([one[:, :7] for one in maps]), abs=1e-12)


def test_flip_is_the_mean_of_its_authors_map():
    flip = pytest.importorskip("flip_evaluator", reason="needs flip-evaluator, of the extra metrics")
    a, b = noisy()
    shown = [one / np.float32(255) for one in (a, b)]
    found, mean, _ = flip.evaluate(*shown, "LDR", applyMagma=False)
    assert metrics.flip(a, b) == metrics.flip(*shown) == pytest.approx(mean, rel=1e-5)  # they sum 713 values in float32
    left = np.arange(31)[None] < np.full((23, 1), 12)
    assert metrics.flip(a, b, valid=left) == pytest.approx(found[:, :12].mean(), rel=1e-6)
    nearer = flip.evaluate(*shown, "LDR", applyMagma=False, parameters={"ppd": 20.0})[1]
    assert metrics.flip(a, b, pixels_per_degree=20) == pytest.approx(nearer, rel=1e-5)


def missing(package: str, name: str) -> None:
    raise ModuleNotFoundError(name=package)


@pytest.mark.parametrize(("measure", "package"), [(metrics.ssim, "skimage"), (metrics.flip, "flip_evaluator")])
def test_what_is_not_installed_is_named(measure, package, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("pyibr.core.optional.import_module", functools.partial(missing, package))
    with pytest.raises(MissingPackageError, match=r"pip install 'pyibr-opencl\[metrics\]'"):
        measure(*noisy())
