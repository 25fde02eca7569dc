"""Filled holes, compared with a plain float64 reference, for many shapes of holes and directions of epipolar lines."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from functools import cache

import numpy as np
import pytest

import pyibr as ibr
from pyibr.capture import capture, models, object_views
from pyibr.core.camera import Camera
from pyibr.opencl.device import current
from pyibr.opencl.memory import copy, upload
from pyibr.picture.target import Target
from pyibr.warp.filling import find_behind, inpaint, push_and_pull
from tests import scenes
from tests.one_lane import one_lane
from tests.reference.fill import HALO, behind_reference, edges_of, fill_reference

Epipole = tuple[float, float, float]

SIZES: tuple[scenes.Size, ...] = ((1, 1), (7, 13), (61, 37), (1, 60), (60, 1), (97, 75))
MASKS = ("dots", "patches", "few valid", "half", "no hole", "all holes")
DTYPES = (np.uint8, np.float32)
STRAIGHT: dict[str, Epipole] = {
    "right": (300.0, 0.0, 0.0),
    "left": (-300.0, 0.0, 0.0),
    "down": (0.0, 1.0, 0.0),
    "up": (0.0, -7.0, 0.0),
    "down right": (40.0, 40.0, 0.0),
    "up right": (3.0, -3.0, 0.0),
    "none": (0.0, 0.0, 0.0),
}
OTHER: dict[str, Epipole] = {
    "slanted": (1.0, 0.3717, 0.0),
    "nearly a row": (-1.0, 0.00213, 0.0),
    "nearly a column": (0.0213, 1.0, 1e-5),
    "inside": (31.4, 22.7, 1.0),
    "on a pixel": (6.0, 6.0, 1.0),
    "beside": (-403.3, 51.9, 1.0),
    "antipode": (-22.2, -18.9, -1.0),
}


@pytest.fixture(params=[16, pytest.param(1, marks=pytest.mark.thorough)], ids=["wide", "one lane"])
def lanes(request: pytest.FixtureRequest) -> Iterator[int]:
    with one_lane() if request.param == 1 else nullcontext():
        if current().profile.lanes != request.param:
            pytest.skip("the device is no CPU")
        yield request.param


@cache
def images(size: scenes.Size, mask: str, dtype: type) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Colour, depth and valid. Neighbours differ in depth by less, by more, and by about as much as one surface may."""
    width, height = size
    rng = np.random.default_rng([width, height, MASKS.index(mask)])
    y, x = np.mgrid[:height, :width]
    noise = rng.random((height, width))
    waves = np.sin(0.31 * x + 1.0) + np.sin(0.23 * y + 0.07 * x + 2.0)
    valid = {
        "dots": noise > 0.1,
        "patches": waves + 0.2 * noise > -0.3,
        "few valid": noise < 0.004,
        "half": x + 0.3 * y + 3 * noise < 0.6 * width,
        "no hole": noise >= 0,
        "all holes": noise < 0,
    }[mask]
    depth = np.where(valid, 2.0 + (waves > 0.5) + 0.1 * rng.random((height, width)), np.nan).astype(np.float32)
    color = rng.random((height, width, 3)) * valid[..., None]
    return (color * 255).astype(np.uint8) if dtype is np.uint8 else color.astype(np.float32), depth, valid


def target_of(color: np.ndarray, depth: np.ndarray, valid: np.ndarray, projection: str = "perspective") -> Target:
    """A drawn picture that holds these arrays."""
    camera = Camera([[50, 0, 0], [0, 50, 0], [0, 0, 1]], valid.shape[::-1], projection=projection)
    target = Target(camera, color.dtype, channels=color.shape[2])
    given = color, depth, valid.astype(np.uint8)
    for array, into in zip(given, (target.color, target.depth, target.valid), strict=True):
        copy(upload(array), into)
    return target


def told(target: Target, epipole: Epipole, noise: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    """(2, H, W): the depth behind each hole pixel, and its falloff, from the kernels; undefined outside of holes."""
    width, height = target.camera.size
    behind = find_behind(target, np.array(epipole), noise).to_host()
    return behind[:, HALO : height + HALO, HALO : width + HALO].copy()


def filled(target: Target, epipole: Epipole | None) -> tuple[np.ndarray, np.ndarray]:
    """Colour and depth from the kernels."""
    push_and_pull(target, None if epipole is None else find_behind(target, np.array(epipole)))
    frame = target.frame()
    return frame.color.copy(), frame.depth.copy()


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
@pytest.mark.parametrize("place", [*STRAIGHT, *OTHER])
@pytest.mark.parametrize("mask", MASKS)
def test_the_farther_end_of_a_line_is_what_lies_behind(place, mask, projection, lanes):
    epipole, noise = (STRAIGHT | OTHER)[place], (2e-3, 1e-3, 3e-3)
    for size in SIZES:
        given = images(size, mask, np.uint8)
        a, b, c = (3 * 2**0.5 * each for each in noise)  # three deviations of the difference of two noisy depths
        relative, absolute = (0.015, 0) if projection == "perspective" else (0, 0.015 * max(size) / 50)
        same = a, b + relative, c + absolute  # max(size) / 50: width seen at distance 1
        expected = behind_reference(*given[1:], epipole, projection == "perspective", same)
        assert expected.decided.mean() >= (0.5 if place in OTHER else 1.0)
        sure = edges_of(given[2]) & expected.decided
        depth, falloff = told(target_of(*given, projection), epipole, noise)
        np.testing.assert_array_equal(depth[sure], expected.depth[sure])
        # Falloff is computed from depth differences of 0.05 or more. Depths of about 3 in float32 give errors of 1e-5.
        np.testing.assert_allclose(falloff[sure], expected.falloff[sure], rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
@pytest.mark.parametrize("way", ["background", "smooth"])
@pytest.mark.parametrize("mask", MASKS)
def test_holes_are_filled_by_push_and_pull(way, mask, projection, lanes):
    epipole = (1.0, 0.3717, 0.0) if way == "background" else None
    for size in SIZES:
        for dtype in DTYPES:
            color, depth, valid = given = images(size, mask, dtype)
            target = target_of(*given, projection)
            behind = None if epipole is None else told(target, epipole)
            with np.errstate(invalid="ignore", divide="ignore"):
                expected = fill_reference(color, depth, valid, behind, projection == "perspective")
            made_color, made_depth = filled(target, epipole)
            np.testing.assert_array_equal(made_color[valid], color[valid])
            np.testing.assert_array_equal(made_depth[valid], depth[valid])
            np.testing.assert_allclose(made_depth, expected[..., 3], rtol=2e-5)
            if valid.any():
                limit = 0.502 if dtype is np.uint8 else 2e-5
                assert np.abs(made_color - expected[..., :3]).max() <= limit, (size, dtype)
            else:
                assert not made_color.any()


@pytest.mark.parametrize("place", STRAIGHT)
def test_shared_lines_give_what_each_hole_finds_for_itself(place, lanes):
    """Lines to an epipole at infinity are shared by holes; with a very far epipole, each hole follows its own line.

    The far epipole's direction rounds to that of the epipole at infinity, so that both give the same bits.
    """
    x, y, _ = STRAIGHT[place] if any(STRAIGHT[place]) else (-1.0, 0.0, 0.0)
    far = x, y, 1e-20
    for size in SIZES:
        for mask in MASKS:
            given = images(size, mask, np.uint8)
            shared, own = filled(target_of(*given), STRAIGHT[place]), filled(target_of(*given), far)
            for one, other in zip(shared, own, strict=True):
                np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("way", ["background", "smooth"])
def test_depth_is_filled_alike_without_colours(way, lanes):
    epipole = (1.0, 0.3717, 0.0) if way == "background" else None
    color, depth, valid = images((61, 37), "patches", np.uint8)
    alone = filled(target_of(np.empty((37, 61, 0), np.uint8), depth, valid), epipole)[1]
    np.testing.assert_array_equal(alone, filled(target_of(color, depth, valid), epipole)[1])


@pytest.mark.parametrize("width", [160, 960])
def test_the_foreground_leaves_no_trace_at_any_resolution(width):
    height = width * 3 // 4
    camera = Camera([[0.8 * width, 0, width / 2], [0, 0.8 * width, height / 2], [0, 0, 1]], (width, height))
    depth = np.full((height, width), 3.0, np.float32)
    depth[height // 4 : 3 * height // 4, width // 3 : 2 * width // 3] = 2.0  # a box in front of a wall
    color = np.where(depth[..., None] < 2.5, np.uint8([250, 0, 0]), np.uint8([50, 100, 150]))
    frame = ibr.warp(
        ibr.DepthImage(color, depth, camera), camera.moved(0.2, 0.05, 0.0), fill="background", classes=True
    )
    hidden = frame.classes == ibr.PixelClass.HIDDEN
    assert hidden.sum() > 0.01 * width * height
    near = frame.valid & (frame.depth < 2.5)
    rim = np.zeros_like(near)
    for shift, axis in ((1, 0), (-1, 0), (1, 1), (-1, 1)):
        rim |= hidden & np.roll(near, shift, axis)
    # The box has the weight (2/3)^12, the wall 1. So the box gives less than a hundredth even with twice the pixels.
    assert np.abs(frame.color[hidden & ~rim] - [50.0, 100.0, 150.0]).mean() <= 0.01 * 200
    assert np.abs(frame.depth[hidden] / 3.0 - 1.0).mean() <= 0.01
    assert rim.any()
    assert (np.abs(frame.color[rim] - [90.0, 80.0, 120.0]) <= 1).mean() >= 0.95  # a fifth of the box's colour


RATIOS = (0.5, 0.7, 0.8, 0.9, 0.95, 0.97)  # depth of the foreground divided by the depth behind it


def near_walls(width: int, ratio: float, hole: float, slope: float) -> tuple[ibr.DepthImage, Camera, np.ndarray]:
    """A box in front of a wall, a target camera to the right, and the target's picture of the wall without the box.

    The target sees a hole of `hole` image widths. From the left of the image to the right, the wall's nearness grows by
    the fraction `slope`.
    """
    height = 2 * width // 3
    y, x = np.mgrid[:height, :width]
    K = np.array([[width, 0, (width - 1) / 2], [0, width, (height - 1) / 2], [0, 0, 1]])
    camera = Camera(K, (width, height))
    u, v = x / width, y / width
    wall = np.dstack([90 + 30 * np.sin(21 * u), 20 + 10 * np.cos(28 * v), 20 + 0 * u]).astype(np.uint8)
    box = np.dstack([190 + 0 * u, 160 + 0 * u, 110 + 20 * np.sin(96 * u)]).astype(np.uint8)
    nearness = (1 + slope * (u - 0.625)) / 3  # at the box's right edge, the wall is 3 away
    inside = (u > 0.31) & (u < 0.625) & (v > 0.19)
    aside = hole * 3 * ratio / (1 - ratio)
    # A surface at depth 3 keeps its place in the image.
    there = Camera(
        K + np.array([[0, 0, width * aside / 3], [0, 0, 0], [0, 0, 0]]),
        (width, height),
        camera.moved(aside, 0, 0).world_from_camera,
    )
    depth = np.where(inside, 3 * ratio, 1 / nearness).astype(np.float32)
    view = ibr.DepthImage(np.where(inside[..., None], box, wall), depth, camera)
    alone = ibr.DepthImage(wall, (1 / nearness).astype(np.float32), camera)
    return view, there, ibr.warp(alone, there).color


@pytest.mark.parametrize("ratio", RATIOS)
@pytest.mark.parametrize(("hole", "slope"), [(0.1, 0.0), (0.012, 0.0), (0.012, 0.05), (0.012, -0.05)])
@pytest.mark.parametrize("width", [160, 480, 960])
def test_holes_show_what_was_hidden_however_close_it_is_behind(width, hole, slope, ratio, lanes):
    """Holes narrow enough show the wall at any of these slopes; wide holes show it if the wall is flat."""
    view, camera, truth = near_walls(width, ratio, hole, slope)
    cut_ratio = 1 + 0.5 * (1 / ratio - 1)
    bare = ibr.warp(view, camera, classes=True, cut_ratio=cut_ratio)
    frame = ibr.warp(view, camera, fill="background", cut_ratio=cut_ratio)
    holes = bare.classes == ibr.PixelClass.HIDDEN
    assert holes.mean() > 0.2 * hole
    error = np.abs(frame.color[holes].astype(float) - truth[holes]).mean()
    # Levels of 255. Filling with half of the box's colour would give an error of 55. Different parts of the wall differ
    # by up to 10. In one column of a hole, a fifth of the box's colour is mixed in, which adds 22 / columns.
    assert error <= 10 + 22 / max(hole * width - 1, 1)


def foreground_of(lengths: Sequence[int], near: float, slope: float = 0.0) -> np.ndarray:
    """Fraction by which the near surface counts as foreground, for holes of `lengths` pixels in rows of 1000 pixels.

    Each hole lies between a near surface, of depth `near` at the hole, and a far surface of depth 3. Over 100 pixels
    towards the hole, the near surface's depth grows by the fraction `slope` of `near`.
    """
    depth = np.full((len(lengths), 1000), 3.0, np.float32)
    depth[:, :200] = near * (1 + slope * np.linspace(-2, 0, 200))
    valid = np.ones(depth.shape, bool)
    for row, length in zip(valid, lengths, strict=True):
        row[200 : 200 + length] = False
    _, falloff = told(target_of(np.zeros((*depth.shape, 3), np.uint8), depth, valid), STRAIGHT["right"])
    return falloff[:, 200] * (3 - depth[0, 199])


def test_what_is_foreground_changes_smoothly_as_holes_grow(lanes):
    """Smooth changes keep filled holes from flickering from frame to frame."""
    lengths = range(5, 60)
    part = foreground_of(lengths, 2.5, slope=0.3)
    assert part[0] == pytest.approx(1) and part[-1] == 0
    # The smooth step from 0.02 to 0.035 of the width, which is 15 pixels, changes by up to 1.5 / 15 per pixel.
    assert (np.diff(part) <= 1e-6).all() and np.diff(part).min() >= -0.1
    np.testing.assert_allclose(foreground_of(lengths, 2.5), 1.0, rtol=1e-5)  # flat, however wide


def test_what_is_foreground_changes_smoothly_as_surfaces_part(lanes):
    part = np.array([foreground_of([10], 3 * (1 - gap))[0] for gap in np.linspace(0.01, 0.035, 26)])
    assert part[0] == 0 and part[-1] == pytest.approx(1)
    # The smooth step goes from a gap of 1.5 % of the depth to 3 %. For each 0.1 % it changes by up to 1.5 / 15.
    assert (np.diff(part) >= -1e-4).all() and np.diff(part).max() <= 0.101


def test_what_is_foreground_changes_smoothly_as_surfaces_slope(lanes):
    part = np.array([foreground_of([100], 2.5, slope)[0] for slope in np.linspace(0, 0.04, 41)])
    assert part[0] == pytest.approx(1) and part[-1] == 0
    # The smooth step goes from 5 % to 15 % of the gap in nearness. Each of the slopes above is 0.001 larger than the
    # one before, which is 0.6 % of the gap. So the step changes by up to 1.5 * 0.06, and slightly more, since nearness
    # is not linear in depth.
    assert (np.diff(part) <= 1e-4).all() and np.diff(part).min() >= -0.1


# --- what a source has without depth ------------------------------------------------------------------


def window(color_there: np.ndarray | int, dtype: type = np.uint8) -> ibr.DepthImage:
    """A wall with a window, which has colours but no depth."""
    camera = Camera([[100, 0, 65], [0, 100, 50], [0, 0, 1]], (131, 101))
    color = np.full((101, 131, 3), 90, np.uint8)
    depth = np.full((101, 131), 2.0, np.float32)
    inside = np.s_[30:70, 40:90]
    color[inside], depth[inside] = color_there, np.nan
    if dtype is np.float32:
        color = color.astype(np.float32) / np.float32(255)
    return ibr.DepthImage(color, depth, camera)


@pytest.mark.parametrize("dtype", DTYPES)
def test_colours_without_depth_are_shown_where_the_depth_around_leads_to_them(dtype, lanes):
    stripes = (np.arange(50)[None, :, None] * np.array([5, 3, 4]) + 10).astype(np.uint8)
    view = window(stripes, dtype)
    frame = ibr.warp(view, view.camera.moved(0.2, 0, 0), fill="background")  # the wall shifts by 10 pixels
    assert not frame.valid[35:65, 35:75].any()
    np.testing.assert_allclose(frame.depth[35:65, 35:75], 2.0, rtol=1e-5)
    np.testing.assert_allclose(frame.color[35:65, 35:75], view.color[35:65, 45:85], atol=1e-5)


def test_black_without_depth_is_no_colour(lanes):
    view = window(0)
    frame = ibr.warp(view, view.camera.moved(0.2, 0, 0), fill="background")
    assert (frame.color[35:65, 35:75] == 90).all()


def test_of_several_views_the_nearest_ones_colours_count(lanes):
    near, other = window(40), window(200)
    far = ibr.DepthImage(other.color, other.depth, other.camera.moved(0.02, 0, 0))
    for views in ([near, far], [far, near]):
        frame = ibr.warp(views, near.camera.moved(0.001, 0, 0), fill="background")
        assert (frame.color[35:65, 48:84] == 40).all()


def test_a_backdrop_leaves_no_hole_where_there_is_no_depth():
    view = window(200)
    backed = ibr.DepthImage(view.color, view.depth, view.camera, default_depth=4.0)
    frame = ibr.warp(backed, view.camera.moved(0.2, 0, 0))
    assert frame.valid[35:65, 40:75].all()
    np.testing.assert_allclose(frame.depth[35:65, 40:75], 4.0, rtol=1e-5)
    assert (frame.color[35:65, 40:75] == 200).all()


# --- by OpenCV ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("mask", MASKS)
def test_inpainting_continues_what_is_around(mask, dtype):
    for size in SIZES:
        color, depth, valid = given = images(size, mask, dtype)
        target = target_of(*given)
        inpaint(target)
        frame = target.frame()
        np.testing.assert_array_equal(frame.color[valid], color[valid])
        np.testing.assert_array_equal(frame.depth[valid], depth[valid])
        assert np.isfinite(frame.depth).all() == (valid.any())
        if valid.any():
            assert depth[valid].min() * 0.999 <= frame.depth.min()
            assert frame.depth.max() <= depth[valid].max() * 1.001


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_inpainting_asks_for_no_unit(projection):
    """Depth in metres or millimetres, and colours bright or dark, in floats or bytes, give the same picture."""
    color, depth, valid = images((97, 75), "patches", np.uint8)
    bright = color.astype(np.float32) / np.float32(255)
    colors, depths = [], []
    for unit, given in ((1, bright), (1000, bright / 8), (1, color)):
        target = target_of(given, depth * np.float32(unit), valid, projection)
        inpaint(target)
        colors.append(target.frame().color)
        depths.append(target.frame().depth / unit)
    # OpenCV changes pixels beside filled ones by 1/65535 of the depth range, and float32 rounds.
    np.testing.assert_allclose(depths[0], depths[1], atol=1e-4)
    np.testing.assert_allclose(colors[0], 8 * colors[1], atol=1e-4)
    assert np.abs(255 * colors[0] - colors[2])[~valid].mean() < 2  # bytes are rounded to steps of 1/255


def test_a_missing_opencv_is_named(monkeypatch: pytest.MonkeyPatch):
    view = scenes.stepped((61, 37))
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(ibr.Error, match='fill="inpaint" needs OpenCV'):
        ibr.warp(view, view.camera.moved(0.4, 0, 0), fill="inpaint")


def ball_before_nothing(far: float, projection: str = "perspective") -> ibr.DepthImage:
    """A ball of radius 1 at depth 4, in colours over the whole image; around it, the depth is `far`."""
    y, x = np.mgrid[:61, :83]
    focal = 60.0 if projection == "perspective" else 15.0
    camera = Camera([[focal, 0, 41], [0, focal, 30], [0, 0, 1]], (83, 61), projection=projection)
    away = np.hypot(x - 41, y - 30) / 15
    depth = np.where(away < 1, 4 - np.sqrt(np.maximum(1 - away**2, 0)), far).astype(np.float32)
    color = np.dstack([2 * x + 40, 3 * y + 40, np.full_like(x, 90)]).astype(np.uint8)
    return ibr.DepthImage(color, depth, camera, far=50)


@pytest.mark.parametrize("way", ["background", "smooth"])
@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
@pytest.mark.parametrize("far", [np.inf, 50, 99])
def test_empty_space_is_no_hole_to_fill(far, projection, way, lanes):
    """Beside a ball in empty space nothing is filled, whatever colour the view has there, also without colours.

    Only "smooth" continues the ball, half as far as it hides the space beside it.
    """
    view = ball_before_nothing(far, projection)
    for target in (view.camera.moved(0.4, 0.1, 0), view.camera.orbited(25, (0, 0, 4)), view.camera):
        bare, filled = ibr.warp(view, target), ibr.warp(view, target, fill=way)
        shown = np.isfinite(filled.depth)
        np.testing.assert_array_equal(shown, filled.color.any(axis=2))
        assert (shown & ~bare.valid).mean() <= (0.04 if way == "smooth" else 0) and shown[bare.valid].all()
        alone = ibr.warp(ibr.DepthImage(None, view.depth, view.camera, far=50), target, fill=way)
        np.testing.assert_array_equal(np.isfinite(alone.depth), shown)


@pytest.mark.parametrize("way", ["background", "smooth"])
def test_unknown_depth_and_holes_before_surfaces_are_filled(way, lanes):
    """Unknown depth is filled, and so is the hole beside a box before a wall; the sky above the wall is not."""
    view = ball_before_nothing(np.nan)
    assert np.isfinite(ibr.warp(view, view.camera.moved(0.4, 0, 0), fill=way).depth).all()
    y = np.mgrid[:61, :83][0]
    depth = np.where(y < 20, np.inf, 5).astype(np.float32)
    depth[30:50, 30:50] = 2
    scene = ibr.DepthImage(view.color, depth, view.camera)
    filled = ibr.warp(scene, view.camera.moved(0.3, 0, 0), fill=way)
    assert not np.isfinite(filled.depth[:20]).any() and (~filled.valid[20:]).mean() > 0.05
    assert np.isfinite(filled.depth[20:]).mean() > 0.99  # a wedge beside the sky, outside of the view, stays empty


def test_views_all_around_an_object_leave_the_space_around_it_empty():
    for projection in ("orthographic", "perspective"):
        views = object_views(models.donut(24), 48, projection=projection)
        camera = Camera.look_at((2.2, 1.5, 2), (0, 0, 0), (0, 1, 0), (80, 60), fov_y=60)
        truth = capture(models.donut(24), camera).valid
        filled = ibr.warp(views, camera, fill="background")
        assert np.isfinite(filled.depth)[~truth].mean() < 0.02
        several = ibr.warp(views, camera, fill="background", samples=4)
        assert np.isfinite(several.depth)[~truth].mean() < 0.05
