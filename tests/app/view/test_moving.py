"""Pictures of Gaussians for a moving camera: they are near the exact ones, and never of another look."""

from __future__ import annotations

import threading
import time
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

import pyibr as ibr
from pyibr.app.view import moving
from pyibr.app.view.methods import RenderMethod, Style, methods_of
from pyibr.app.view.moving import LastPictures, WarpedFrame
from pyibr.app.view.painting import paint
from tests.app.browser import opened, rested, settles_on, until

CAMERA = ibr.Camera([[150, 0, 86], [0, 150, 64.5], [0, 0, 1]], (173, 130))
MIDDLE = (0.0, 0.0, 4.0)
REST, MOVING = Style("render"), Style("render", moving=True)


@pytest.fixture(autouse=True)
def slow(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every cloud counts as slow, and nothing is drawn on other threads."""
    monkeypatch.setattr(moving, "_FAST", 0.0)
    monkeypatch.setattr(LastPictures, "_begin", lambda *_: None)


def flat(points: np.ndarray, size: float, opacity: float) -> ibr.Gaussians:
    """Flat Gaussians across the z axis, with colours that vary smoothly."""
    count = len(points)
    colors = (0.5 + 0.4 * np.sin(points * (2, 3, 4))).astype(np.float32)
    scales = np.tile([size, size, size / 20], (count, 1))
    return ibr.Gaussians(points, scales, np.tile([1, 0, 0, 0], (count, 1)), np.full(count, opacity), colors=colors)


@cache
def disk(opacity: float = 0.9) -> ibr.Gaussians:
    """A disk with a soft border."""
    a, b = np.mgrid[-1:1:41j, -1:1:41j].reshape(2, -1)
    points = np.stack([0.6 * a, 0.6 * b, np.full(len(a), 3.5)], axis=1)
    return flat(points[np.hypot(a, b) < 1], 0.03, opacity)


@cache
def wall() -> ibr.Gaussians:
    """A slanted wall behind the disk."""
    x, y = np.mgrid[-4:4:140j, -3:3:110j].reshape(2, -1)
    return flat(np.stack([x, y, 5 + 0.2 * x], axis=1), 0.06, 0.9)


def knot() -> ibr.Mesh:
    return ibr.Mesh([[-0.9, -0.8, 4], [0.9, -0.8, 4], [-0.9, -0.4, 4.2], [0.9, -0.4, 4.2]], [[0, 1, 2], [3, 2, 1]])


def method_of(*things: Any) -> RenderMethod:
    return methods_of(list(things))["render"]


def turned(degrees: float) -> ibr.Camera:
    return CAMERA.orbited(degrees, MIDDLE)


def off(one: ibr.Frame, other: ibr.Frame) -> float:
    """Mean difference in levels of 255."""
    return float(np.abs(one.color.astype(float) - other.color).mean())


# ---- warped pictures beside exact ones


def test_a_camera_that_rests_gets_the_exact_picture_and_one_that_has_not_moved_the_same():
    method = method_of(disk(), wall(), knot())
    at_rest, exact = method.draw(CAMERA, REST), ibr.render([disk(), wall(), knot()], CAMERA)
    np.testing.assert_array_equal(at_rest.color, exact.color)
    np.testing.assert_array_equal(at_rest.depth, exact.depth)
    frame = method.draw(CAMERA, MOVING)
    assert isinstance(frame, WarpedFrame) and not isinstance(at_rest, WarpedFrame)
    np.testing.assert_array_equal(frame.color, exact.color)
    np.testing.assert_array_equal(frame.valid, exact.valid)
    np.testing.assert_allclose(frame.depth, exact.depth, rtol=1e-5)


def test_along_a_path_warped_pictures_are_near_the_exact_ones():
    """Of an unmoved picture's error, at most 15 % is left, in guessed holes and at edges; rounding adds 0.25 levels."""
    things, light = [disk(), wall(), knot()], ibr.Light(direction=(0.3, 0.5, 1))
    method = method_of(*things)
    first = method.draw(CAMERA, replace(REST, light=light))
    for degrees in (0.5, 1.0, 2.0, 4.0):
        frame = method.draw(turned(degrees), replace(MOVING, light=light))
        exact = ibr.render(things, turned(degrees), light)
        assert isinstance(frame, WarpedFrame)
        assert off(frame, exact) < 0.25 + 0.15 * off(first, exact)
        seen = np.abs(frame.color.astype(float) - exact.color)[frame.valid].mean()
        assert seen < 1.2
        same = np.abs(frame.depth / exact.depth - 1) < 0.01
        assert same[frame.valid].mean() > 0.99


def test_a_soft_border_moves_with_its_surface_and_the_background_does_not_smear():
    """Beside a disk before a plain background, the warp leaves no trace of the disk where it was."""
    method = method_of(disk())
    style = replace(REST, background=(40, 90, 200))
    first = method.draw(CAMERA, style)
    assert ((first.alpha > 0.02) & ~first.valid).sum() > 200  # there is a border without depth
    camera = CAMERA.moved(0.3, 0, 0)
    frame = method.draw(camera, replace(style, moving=True))
    exact = ibr.render(disk(), camera, background=style.background)
    apart = np.abs(frame.color.astype(int) - exact.color).max(axis=2)
    assert apart[exact.alpha == 0].max() <= 2
    assert apart[(exact.alpha > 0) & ~exact.valid].mean() < 12  # of 255, though the border is steep
    assert (exact.valid & ~frame.valid).mean() < 0.002
    assert (frame.valid & (exact.alpha == 0)).mean() < 0.002  # the border has the disk's depth, and no more has
    np.testing.assert_array_equal(np.isnan(frame.depth), ~frame.valid)


@pytest.mark.parametrize("opacity", [0.004, 0.02])
def test_a_cloud_without_any_depth_is_shown(opacity):
    method = method_of(disk(opacity))
    assert not method.draw(CAMERA, REST).valid.any()
    frame = method.draw(turned(2), MOVING)
    assert isinstance(frame, WarpedFrame) and not frame.valid.any()
    assert off(frame, ibr.render(disk(opacity), turned(2))) < 4


@pytest.mark.parametrize("size", [(1, 1), (2, 1), (3, 5), (19, 13)])
@pytest.mark.parametrize("layout", ["one", "swipe", "side by side", "difference"])
def test_pictures_of_any_size_are_warped(size, layout):
    methods = methods_of({"all": [disk(), knot()], "mesh": knot()})
    for show in ("color", "depth", "classes"):
        style = Style("all", "mesh", layout, show=show, moving=True)
        paint(methods, CAMERA, replace(style, moving=False))
        assert paint(methods, turned(1).resized(size), style).color.shape == (size[1], size[0], 3)


# ---- which picture is shown


def test_no_picture_of_another_look_is_shown():
    method = method_of(disk(), knot())
    changes = (
        {"light": ibr.Light(direction=(0, 1, 1))},
        {"background": (9, 8, 7)},
        {"parameters": (("near", 3.9),)},
        {"samples": 4},
        {"anisotropy": 2},
    )
    for change in changes:
        method.draw(CAMERA, REST)
        before = method.draw(turned(0.5), replace(MOVING, **change))
        assert not isinstance(before, WarpedFrame), change
        np.testing.assert_array_equal(before.color, method.draw(turned(0.5), replace(REST, **change)).color)
        assert isinstance(method.draw(turned(0.6), replace(MOVING, **change)), WarpedFrame), change


def test_what_changes_no_frame_needs_no_new_picture():
    method = method_of(disk())
    method.draw(CAMERA, REST)
    for change in ({"show": "depth"}, {"other": "render", "layout": "swipe", "swipe": 0.2}, {"gain": 2.0}):
        assert isinstance(method.draw(turned(1), replace(MOVING, **change)), WarpedFrame)


def test_pictures_from_far_away_are_not_warped_and_the_nearest_is():
    method = method_of(disk(), wall())
    for camera in (turned(100), CAMERA.moved(0, 0, 9), ibr.Camera.from_fov(CAMERA.size, fov_x=150)):
        method.draw(CAMERA, REST)
        assert not isinstance(method.draw(camera, MOVING), WarpedFrame)
    for degrees in (0, 12):
        method.draw(turned(degrees), REST)
    for degrees in (1, 11):
        frame, exact = method.draw(turned(degrees), MOVING), ibr.render([disk(), wall()], turned(degrees))
        assert isinstance(frame, WarpedFrame) and off(frame, exact) < 4


def test_what_is_drawn_fast_is_always_exact(monkeypatch):
    monkeypatch.setattr(moving, "_FAST", 60.0)
    method = method_of(disk())
    for degrees in (0, 1):
        frame = method.draw(turned(degrees), MOVING)
        np.testing.assert_array_equal(frame.color, ibr.render(disk(), turned(degrees)).color)
    assert not isinstance(methods_of(knot())["render"].draw(CAMERA, MOVING), WarpedFrame)


def test_the_next_exact_picture_is_drawn_meanwhile_and_is_wider(monkeypatch):
    monkeypatch.undo()
    monkeypatch.setattr(moving, "_FAST", 0.0)
    last, drawn, gate = LastPictures(), list[ibr.Camera](), threading.Event()

    def exact(camera: ibr.Camera) -> ibr.Frame:
        drawn.append(camera)
        if len(drawn) > 1:
            gate.wait(20)
        return ibr.render([disk(), wall()], camera)

    last.draw(exact, CAMERA, "look")
    until(lambda: not last._drawing.is_alive())  # it builds the kernels
    frames = [last.draw_moving(exact, turned(degrees), "look") for degrees in (3, 4, 5)]
    assert all(isinstance(frame, WarpedFrame) for frame in frames)  # none has waited for the exact picture
    until(lambda: len(drawn) == 2)  # only one is drawn at a time
    gate.set()
    until(lambda: not last._drawing.is_alive())
    assert drawn[1].width > 1.2 * CAMERA.width
    np.testing.assert_array_equal(drawn[1].world_from_camera, turned(3).world_from_camera)
    truth = ibr.render([disk(), wall()], turned(5))
    newer = last.draw_moving(exact, turned(5), "look")
    assert isinstance(newer, WarpedFrame) and off(newer, truth) < 0.7 * off(frames[2], truth)
    assert newer.valid.mean() > frames[2].valid.mean()
    until(lambda: not last._drawing.is_alive())


def test_each_look_keeps_its_pictures():
    last = LastPictures()
    for look in ("mine", *4 * ["yours"]):
        last.draw(lambda camera: ibr.render([disk(), wall()], camera), CAMERA, look)
    assert [one.look for one in last._kept] == [*4 * ["yours"], "mine"]


@pytest.mark.parametrize("kind", [ibr.Error, ValueError])
def test_an_error_meanwhile_is_told_at_rest_alone(monkeypatch, kind):
    monkeypatch.undo()
    monkeypatch.setattr(moving, "_FAST", 0.0)
    monkeypatch.setattr(threading, "excepthook", lambda args: pytest.fail(str(args.exc_value)))
    last = LastPictures()
    last.draw(lambda camera: ibr.render(disk(), camera), CAMERA, "look")

    def fails(camera: ibr.Camera) -> ibr.Frame:
        raise kind("no memory")

    until(lambda: not last._drawing.is_alive())
    assert isinstance(last.draw_moving(fails, turned(5), "look"), WarpedFrame)
    until(lambda: not last._drawing.is_alive())
    drawing = last._drawing
    assert isinstance(last.draw_moving(fails, turned(5), "look"), WarpedFrame) and last._drawing is drawing
    with pytest.raises(kind, match="no memory"):
        last.draw(fails, turned(5), "look")


# ---- in a browser


@pytest.mark.thorough
def test_a_page_shows_warped_pictures_while_the_camera_moves_and_rests_on_the_exact_one(browser, monkeypatch):
    monkeypatch.undo()
    monkeypatch.setattr(moving, "_FAST", 0.0)
    with ibr.view([disk(), wall(), knot()], CAMERA, port=0) as pages, opened(browser, pages.url, (320, 240)) as tab:
        until(lambda: len(pages.open) == 1)
        (page,) = pages.open.values()
        said: list[str] = []

        def truth() -> np.ndarray:
            return ibr.render([disk(), wall(), knot()], page.stream.camera, page.controls.style().light).color

        monkeypatch.setattr(page.panel, "say", said.append)
        settles_on(tab, truth)
        start, count = page.stream.camera, len(tab.kinds())
        tab.drag((120, 120), (200, 110), 20, 0.03)
        until(lambda: np.linalg.norm(page.stream.camera.center - start.center) > 0.1)
        rested(tab)
        settles_on(tab, truth)
        assert "image/jpeg" in tab.kinds()[count:]
        assert any("moving" in text and "Warped from the last exact picture" in text for text in said)
        assert "Warped" not in said[-1]
        time.sleep(0.5)
        assert tab.kinds()[-1] == "image/png" and tab.complaints == []
