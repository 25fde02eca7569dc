"""Segmentation: triangles that bridge two surfaces (rubber sheets) are removed, and hardly any others."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import pyibr as ibr
from pyibr.depthmesh import Segmentation
from tests import scenes
from tests.depthmesh.layers import PLATES, bridging, layered
from tests.depthmesh.views import PROJECTIONS, cells_of, rough
from tests.warp.test_real_data import room

TESTS = ("orthogonality", "connectedness", "disparity")
SIZE = (320, 240)


@pytest.mark.parametrize("test", TESTS)
@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("name", list(PLATES))
def test_a_plate_before_a_wall(name, projection, test):
    view, plate = layered(name, SIZE, projection)
    drawn, rubber = cells_of(ibr.DepthMesh(view, segmentation=Segmentation(test))), bridging(plate)
    assert rubber.sum() > 1000
    assert (~drawn)[rubber].mean() >= 0.99
    assert (~drawn)[~rubber].mean() < 0.005


@pytest.mark.parametrize("test", [*TESTS, "none"])
def test_one_surface_stays_whole(test):
    for projection in PROJECTIONS:
        for size in ((2, 2), (7, 13), (61, 37), (128, 96)):
            assert cells_of(ibr.DepthMesh(scenes.flat(size, projection), segmentation=Segmentation(test))).all()
        view = scenes.smooth(SIZE, projection)
        assert cells_of(ibr.DepthMesh(view, segmentation=Segmentation(test))).all()


def test_none_takes_out_nothing_but_what_has_no_depth():
    view = scenes.holed((61, 37))
    drawn = cells_of(ibr.DepthMesh(view, segmentation=Segmentation("none")))
    valid = view.valid
    corners = np.stack([valid[:-1, :-1], valid[:-1, 1:], valid[1:, :-1], valid[1:, 1:]])
    np.testing.assert_array_equal(drawn.all(axis=-1), corners.all(axis=0))
    assert not drawn[corners.sum(axis=0) < 3].any()


@pytest.mark.parametrize("test", TESTS)
def test_how_a_camera_lies_in_the_world_changes_nothing(test):
    view, plate = layered("flat", SIZE, "orthographic")
    turned = ibr.DepthImage(view.color, view.depth, view.camera.orbited(50, (1, 2, 3), axis=(1, -2, 0.5)))
    step, (low, high) = 4.8 - 3.2, view.bounds
    for limit, whole in ((0.95, False), (1.05, True)):  # limits, as fractions of the step
        part = limit * step / (high - low).max()
        rule = Segmentation(test, depth_range=part, gap=part)
        drawn, same = (cells_of(ibr.DepthMesh(v, segmentation=rule)) for v in (view, turned))
        np.testing.assert_array_equal(drawn, same)
        assert drawn[bridging(plate)].all() == whole


@pytest.mark.parametrize("skew", [-9.0, 0.0, 9.0])
@pytest.mark.parametrize("span", [0.1, 50.0])
def test_the_extent_is_that_of_the_valid_samples(skew, span):
    width, height = 40, 31
    camera = ibr.Camera([[10, skew, 20], [0, 12, 15], [0, 0, 1]], (width, height), projection="orthographic")
    y, x = np.mgrid[:height, :width]
    for shown in (abs(x - y - 4) < 3, abs(x + y - 30) < 3, (x > 9) & (x < 14), (y > 20) & (x == 7), x + y >= 0):
        depth = np.where(shown, 3 + span * (x + y) / (x + y)[shown].max(), np.nan).astype(np.float32)
        view = ibr.DepthImage(np.zeros((height, width, 3), np.uint8), depth, camera)
        apart = np.nanmax(depth) - np.nanmin(depth)
        expected = np.ptp(view.points, axis=0).max()  # the camera's frame is the world's
        assert Segmentation().record(view, float(apart))["extent"] == pytest.approx(expected, rel=1e-6)


def test_the_angle_and_the_range_both_decide():
    """A step counts as seen edge-on if its height exceeds the width of a sample divided by tan(angle)."""
    camera = ibr.Camera([[100, 0, 20], [0, 100, 15], [0, 0, 1]], (40, 30))
    for step in (0.05, 0.2, 0.5, 2.0):
        depth = np.full((30, 40), 4, np.float32)
        depth[:, 20:] += step
        view = ibr.DepthImage(np.zeros((30, 40, 3), np.uint8), depth, camera)
        for angle in (2, 5, 10, 20):
            for depth_range in (0.01, 0.06, 0.3):
                drawn = cells_of(ibr.DepthMesh(view, segmentation=Segmentation("orthogonality", angle, depth_range)))
                # The sample at the step is between 4 / 100 and (4 + step) / 100 wide. Cases near a limit are left out.
                slopes, range_of = (4 / 100 / step, (4 + step) / 100 / step), step / (4 + step / 2)
                if max(slopes) < 0.8 * np.tan(np.radians(angle)) and range_of > 1.2 * depth_range:
                    assert not drawn[:, 19].any()
                elif min(slopes) > 1.2 * np.tan(np.radians(angle)) or range_of < 0.8 * depth_range:
                    assert drawn.all()
                assert drawn[:, :19].all() and drawn[:, 20:].all()


@pytest.mark.parametrize("test", TESTS)
def test_stricter_thresholds_take_out_more(test):
    view = rough(np.random.default_rng(0), (61, 37), "perspective", 0.3)
    kept = []
    for k in (1, 2, 4):
        rule = Segmentation(test, angle=8 * k, depth_range=0.08 / k, gap=0.08 / k, deviations=0)
        kept.append(cells_of(ibr.DepthMesh(view, segmentation=rule)))
    assert kept[0].sum() > kept[1].sum() > kept[2].sum() > 0
    assert not (kept[1] & ~kept[0]).any() and not (kept[2] & ~kept[1]).any()


@pytest.mark.parametrize("test", TESTS)
@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("name", ["tilted", "curved"])
def test_noise_is_no_step(name, projection, test):
    """Differences within the noise are no steps, even if they exceed a threshold; true steps are found."""
    clean, plate = layered(name, SIZE, projection)
    noise = np.random.default_rng(4).normal(0, 0.06, clean.depth.shape).astype(np.float32)
    view, rubber = ibr.DepthImage(clean.color, clean.depth + noise, clean.camera), bridging(plate)
    rules = [Segmentation(test, deviations=0), Segmentation(test)]
    unaware, aware = (cells_of(ibr.DepthMesh(view, segmentation=rule)) for rule in rules)
    # Three noisy samples span over 4 standard deviations in one of 75 cases; as the estimated noise is 6 % too small,
    # in one of 47.
    assert (~aware)[~rubber].mean() < min(1 / 47, 0.7 * (~unaware)[~rubber].mean())
    assert (~aware)[rubber].mean() >= 0.99  # the steps are at least 20 deviations high


def test_clean_depth_is_segmented_as_if_there_were_no_noise():
    view = room(0)
    np.testing.assert_array_equal(
        *(cells_of(ibr.DepthMesh(view, segmentation=Segmentation(deviations=d))) for d in (0, 4))
    )


# --- a room --------------------------------------------------------------------------------------------


def triangle_points(view: ibr.DepthImage, every: int) -> tuple[np.ndarray, np.ndarray]:
    """Four world points (4, n, 3) of each of some triangles of the grid: its centre, and the middles of its sides.

    The triangles are (n, 3): y and x of the cell, and side, 0 for the upper triangle and 1 for the lower one.
    """
    height, width = view.depth.shape
    y, x, side = np.meshgrid(np.arange(0, height - 1, every), np.arange(0, width - 1), (0, 1), indexing="ij")
    y, x, side = y.ravel(), x.ravel(), side.ravel()
    main = (x + y) % 2 == 0
    # Offsets of a triangle's corners in its cell: both ends of the diagonal, then the third corner.
    dx = np.stack([np.where(main, 0, 1), np.where(main, 1, 0), np.where(main == (side == 0), 1, 0)])
    dy = np.stack([np.zeros_like(x), np.ones_like(x), side])
    known = view.valid[y + dy, x + dx].all(axis=0)
    y, x, side, dx, dy = y[known], x[known], side[known], dx[:, known], dy[:, known]
    pixels = np.stack([x + dx, y + dy], -1).reshape(-1, 2)
    corner = view.camera.unproject(pixels, view.depth[y + dy, x + dx].ravel()).reshape(3, -1, 3)
    shares = np.array([[1, 1, 1], [1, 1, 0], [1, 0, 1], [0, 1, 1]]) / [[3], [2], [2], [2]]
    return np.einsum("kc,cni->kni", shares, corner), np.stack([y, x, side], -1)


@cache
def labelled(number: int, others: tuple[int, ...], every: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """Triangles (n, 3) of a frame through which other frames looked, and triangles that they saw as surface.

    A frame looked through a triangle if it saw something over 1 % farther than the triangle's centre or the middle of a
    side. Triangles are surface if each of these four points is within 0.5 % of the depth that some frame saw. Depth is
    in whole millimetres.
    """
    points, triangles = triangle_points(room(number), every)
    through = np.zeros(len(triangles), bool)
    met = np.zeros((4, len(triangles)), bool)
    for other in map(room, others):
        pixel, z = other.camera.project(points.reshape(-1, 3))
        good = np.isfinite(pixel).all(axis=1) & (z > 0) & ((pixel >= 0) & (pixel < (639, 479))).all(axis=1)
        u, v = np.floor(np.where(good[:, None], pixel, 0)).astype(int).T
        around = np.stack([other.depth[v + dy, u + dx] for dy in (0, 1) for dx in (0, 1)])
        good &= (around > 0).all(axis=0)
        through |= (good & (around.min(axis=0) > 1.01 * z)).reshape(4, -1).any(axis=0)
        met |= (good & (np.abs(around - z) <= 0.005 * z).all(axis=0)).reshape(4, -1)
    return triangles[through], triangles[~through & met.all(axis=0)]


@pytest.mark.thorough
@pytest.mark.parametrize("test", TESTS)
def test_the_defaults_hold_on_a_room(test):
    for number, others in ((0, (1, 2, 3, 4, 50)), (4, (0, 1, 50))):
        rubber, surface = labelled(number, others)
        assert len(rubber) > 1000 and len(surface) > 150_000
        drawn = cells_of(ibr.DepthMesh(room(number), segmentation=Segmentation(test)))
        assert (~drawn)[tuple(rubber.T)].mean() >= 0.99
        assert (~drawn)[tuple(surface.T)].mean() < 0.005


@pytest.mark.parametrize("test", TESTS)
def test_what_is_left_in_a_room_is_below_the_thresholds(test):
    """Frame 50 has many steps of 1 to 2 % of the depth. Triangles below the threshold, in equation 4 lambda, stay."""
    view, rule = room(50), Segmentation(test)
    rubber, surface = labelled(50, (0, 1, 2, 3, 4), every=9)
    drawn = cells_of(ibr.DepthMesh(view, segmentation=rule))
    y, x, side = rubber.T
    main = (x + y) % 2 == 0
    four = np.stack([view.depth[y + dy, x + dx] for dy in (0, 1) for dx in (0, 1)])
    apart = np.where(side == 0, np.where(main, 2, 3), np.where(main, 1, 0))  # the cell's corner outside of the triangle
    three = np.where(np.arange(4)[:, None] == apart, np.nan, four)
    spans = (np.nanmax(three, axis=0) - np.nanmin(three, axis=0)) / np.nanmean(three, axis=0)
    large = rubber[spans > (rule.depth_range if test == "orthogonality" else rule.gap)]
    assert len(large) > 660 and len(surface) > 33_000
    assert (~drawn)[tuple(large.T)].mean() >= 0.99
    assert (~drawn)[tuple(surface.T)].mean() < 0.005


@pytest.mark.parametrize("turned", [0.0, 0.1, 0.3])
@pytest.mark.parametrize("height", [0.3, 1.5])
def test_floors_that_recede_are_whole_and_small_steps_are_none(height, turned):
    camera = ibr.Camera([[525, 0, 319.5], [0, 525, 239.5], [0, 0, 1]], (640, 480))
    below = np.arange(480)[:, None] - 239.5 + turned * (np.arange(640) - 320)
    depth = np.where(below > 0, height * 525 / np.maximum(below, 1e-9), np.inf)
    view = ibr.DepthImage(None, np.where(depth < 200, depth, np.nan).astype(np.float32), camera)
    frame = ibr.render(ibr.DepthMesh(view), camera.moved(0.1, 0, 0.3))
    inside = depth < 100
    inside[:, :60] = inside[:, -60:] = inside[-60:] = False
    assert (~frame.valid)[inside].mean() < 1e-3
    depth = np.minimum(depth, 10.0)
    depth[60:200, 240:400] = 9.7  # a box 0.3 in front of a wall
    there = camera.moved(2, 0, 0)  # the box moves by 3 pixels relative to the wall
    frame = ibr.render(ibr.DepthMesh(ibr.DepthImage(None, depth.astype(np.float32), camera)), there)
    assert ((~frame.valid[80:180, :400]).sum(axis=1) >= 3).all()
