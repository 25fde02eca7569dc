"""The measures, against values worked out by hand."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from pyibr.core.errors import ArgumentError
from pyibr.images import metrics

DARK = np.zeros((2, 3, 3), np.uint8)


def test_psnr():
    bright = DARK.copy()
    bright[0, 0] = 51  # a fifth of the peak at one of six pixels: 10 log10(25 * 6)
    assert metrics.psnr(DARK, bright) == pytest.approx(10 * math.log10(150))
    assert metrics.psnr(DARK / 255.0, bright / 255.0) == pytest.approx(10 * math.log10(150))
    assert metrics.psnr(DARK, bright, valid=bright[..., 0] > 0) == pytest.approx(10 * math.log10(25))
    assert metrics.psnr(DARK, bright, valid=bright[..., 0] == 0) == math.inf


def test_bytes_do_not_wrap_around():
    assert metrics.psnr(np.full((1, 1), 1, np.uint8), np.full((1, 1), 255, np.uint8)) == pytest.approx(
        20 * math.log10(255 / 254)
    )
    assert metrics.median_color_error(np.full((1, 1), 1, np.uint8), np.full((1, 1), 255, np.uint8)) == 254


def test_median_color_error():
    a = np.arange(5, dtype=np.uint8)[None] ** 2
    b = np.zeros((1, 5), np.uint8)
    assert metrics.median_color_error(a, b) == 4  # of 0 1 4 9 16
    assert metrics.median_color_error(b, a, valid=np.array([[False, True, True, True, True]])) == 6.5


def test_depth_errors_count_what_both_know():
    nan, inf = np.nan, np.inf
    depth = np.array([[1.0, 2.0, 7.0, nan, 5.0, 5.0, inf]], np.float32)
    truth = np.array([[4.0, 6.0, 7.0, 1.0, nan, 0.0, 3.0]])
    assert metrics.depth_rmse(depth, truth) == pytest.approx(5 / math.sqrt(3))  # of 3 4 0
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
    left, right = x < 6, x >= 4  # 60 and 60 pixels, 20 of them in both
    assert metrics.silhouette_iou(left, right) == 0.2
    assert metrics.silhouette_iou(left, left) == 1
    assert metrics.silhouette_iou(left, x > 8) == 0
    assert metrics.silhouette_iou(y < 0, y == 0) == 0


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
