"""A ramp between two surfaces becomes an edge at its steepest point; all other samples keep their bits."""

from __future__ import annotations

import numpy as np
import pytest

import pyibr as ibr
from tests.data import shared
from tests.one_lane import both_forms

cv2 = pytest.importorskip("cv2", reason="blurs")

SIZE = (43, 61)
Y, X = np.mgrid[: SIZE[0], : SIZE[1]]
FAR, NEAR = 0.2 + 0.0005 * X + 0.0003 * Y, 0.4 - 0.001 * X + 0.0004 * Y  # nearness of two slanted planes


def blurred(nearness: np.ndarray, sigma: float) -> np.ndarray:
    return (1 / cv2.GaussianBlur(nearness, (0, 0), sigma)).astype(np.float32)


@pytest.mark.parametrize("sigma", [1, 2, 3])
@pytest.mark.parametrize("side", [X < 30.4, Y > 20.6, X + Y < 50.5, X - Y > 8.5, 3 * X + Y > 110.5])
def test_a_blurred_step_is_an_edge_where_it_was(sigma, side):
    inside = np.s_[9:-9, 9:-9]  # at the image's border, the blur is different
    truth = np.where(side, NEAR, FAR)
    found = 1 / ibr.sharpen_depth(blurred(truth, sigma))
    off = np.abs(found - truth)[inside] / np.abs(NEAR - FAR)[inside]
    # Both surfaces are extrapolated by lines that start beyond the ramp's ends, by a third of its length: 1.5 to 2.6
    # sigma from the edge. There the blur still changes depth by 7 to 0.5 % of the step, which extrapolation doubles.
    assert np.median(off) < 0.02 and off.max() < 0.15  # no sample is on the wrong side


def test_what_is_no_ramp_keeps_its_bits():
    rng = np.random.default_rng(0)
    stairs = np.round(255 * FAR) / 255  # a slope in an 8-bit depth map
    for nearness in (FAR, NEAR, 0.3 + 0.002 * X + 0.002 * Y, np.where(X < 30, NEAR, FAR), stairs):
        depth = (1 / nearness).astype(np.float32)
        depth[rng.random(SIZE) < 0.03] = np.nan
        found = ibr.sharpen_depth(depth)
        np.testing.assert_array_equal(found, depth)
    none = ibr.sharpen_depth(np.full(SIZE, -1, np.float32))
    assert np.isnan(none).all()


@pytest.mark.parametrize("sigma", [1, 2, 4, 6])
def test_no_depth_is_invented(sigma):
    """All depths lie between the least and the greatest depth within 12 pixels, on curved and slanted surfaces, too."""
    rng = np.random.default_rng(sigma)
    centres, heights = rng.uniform(0, 60, (12, 2)), rng.uniform(0.1, 1, 12)
    bumps = [
        h * (np.hypot(X - x, Y - y) < 9) * (1 + 0.02 * (X - x)) for (x, y), h in zip(centres, heights, strict=True)
    ]
    soft = blurred(0.05 + np.max(bumps, axis=0), sigma)
    found, around = ibr.sharpen_depth(soft), np.ones((25, 25))
    assert (found != soft).any()
    assert (found <= cv2.dilate(soft, around) * (1 + 1e-6)).all()
    assert (found >= cv2.erode(soft, around) * (1 - 1e-6)).all()


def test_surfaces_end_at_holes_and_at_the_border():
    truth = np.where(X < 30.4, NEAR, FAR)
    soft = blurred(truth, 1.5)
    soft[:, 37:] = np.nan
    off = np.abs(1 / ibr.sharpen_depth(soft[:, 23:]) - truth[:, 23:]) / np.abs(NEAR - FAR)[:, 23:]
    assert np.isnan(off[:, 14:]).all()
    # The last sample before the hole is 6.6 pixels from the edge, over 4 sigma, so that blur does not reach it.
    assert off[9:-9, :14].max() < 0.1


def test_lanes_change_no_bit():
    rng = np.random.default_rng(1)
    soft = blurred(rng.uniform(0.2, 1, SIZE), 2)
    soft[rng.random(SIZE) < 0.05] = np.nan
    wide, one = both_forms(lambda: ibr.sharpen_depth(soft))
    assert (wide != soft).mean() > 0.1
    np.testing.assert_array_equal(one, wide)


def middlebury(name: str) -> tuple[np.ndarray, np.ndarray]:
    """The left image and its disparity, in which each gap in a row has the disparity of its farther end."""
    folder = shared(f"stereo_middlebury/{name}")
    if name == "motorcycle":
        color, disparity = folder / "motorcycle_left.png", np.load(folder / "motorcycle_disp.npz")["arr_0"]
    else:
        color = folder / ("tsukuba3.png" if name == "tsukuba" else "im2.png")
        stored = "disp_for_tsukuba3_scale16.png" if name == "tsukuba" else "disp2.png"
        disparity = ibr.read_color(folder / stored)[..., 0] / (16.0 if name == "tsukuba" else 4.0)
    known = np.isfinite(disparity) & (disparity > 0)
    column = np.arange(known.shape[1])
    left = np.maximum.accumulate(np.where(known, column, -1), axis=1)
    right = np.minimum.accumulate(np.where(known, column, known.shape[1])[:, ::-1], axis=1)[:, ::-1]
    padded = np.pad(np.where(known, disparity, np.inf), ((0, 0), (1, 1)), constant_values=np.inf)
    ends = [np.take_along_axis(padded, 1 + place, axis=1) for place in (left, right)]
    return ibr.read_color(color), np.minimum(*ends)


@pytest.mark.thorough
def test_soft_edges_of_photographs_cost_less_in_a_new_view():
    """Within 4 pixels of depth edges, colours are compared with those of a new view made from unblurred depth."""
    saved: list[float] = []
    for name in ("cones", "teddy", "motorcycle", "tsukuba"):
        color, disparity = middlebury(name)
        camera = ibr.Camera.from_fov(disparity.shape[::-1], fov_x=50)
        focal = camera.K[0, 0]

        def seen(depth: np.ndarray, color=color, camera=camera) -> ibr.Frame:
            return ibr.warp(ibr.DepthImage(color, depth, camera), camera.moved(0.1, 0, 0), fill="background")

        truth = seen(ibr.depth_from_disparity(disparity, focal, 0.1))
        steps = np.hypot(*np.gradient(np.nan_to_num(0.1 * focal / truth.depth))) > 1
        beside = cv2.dilate(steps.astype(np.uint8), np.ones((9, 9))) > 0
        for sigma in (2, 4):
            soft = ibr.depth_from_disparity(cv2.GaussianBlur(disparity, (0, 0), sigma), focal, 0.1)
            errors = [
                np.abs(seen(depth).color.astype(int) - truth.color)[beside].mean()
                for depth in (soft, ibr.sharpen_depth(soft))
            ]
            saved.append(1 - errors[1] / errors[0])
    assert np.mean(saved) > 0.4 and min(saved) > 0.25, np.round(saved, 3)
