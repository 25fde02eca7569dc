"""Masks of guessed pixels: they contain exactly the pixels that show surface which no view saw."""

from __future__ import annotations

from functools import cache
from typing import Any

import cv2
import numpy as np
import pytest

import pyibr as ibr
from pyibr.capture import MeshScene, object_views
from pyibr.core.camera import Camera
from tests.depthmesh.test_closing import SIZE, donut
from tests.embree import points_of
from tests.shadowed import box
from tests.slicing.solids import knot

o3d = pytest.importorskip("open3d")

SCENES = {"donut": (donut, (2, -2, 2)), "knot": (knot, (5.1, -4.7, 6.2))}


@cache
def drawn(name: str) -> tuple[MeshScene, list[ibr.DepthImage], Camera]:
    scene, eye = SCENES[name][0](), SCENES[name][1]
    views = object_views(scene, 128, projection="perspective")
    return scene, views, Camera.look_at(eye, (0, 0, 0), (0, 0, 1), SIZE, fov_y=42)


def closed_and_open(name: str, **kwargs: Any) -> tuple[ibr.Frame, ibr.Frame]:
    """Render with and without closing; both frames draw all views, so that only closed pixels differ."""
    _, views, camera = drawn(name)
    first, second = (
        ibr.render(ibr.DepthMeshObject(views, blended=6, closed=closed), camera, **kwargs) for closed in (True, False)
    )
    return first, second


@cache
def pictured(name: str) -> tuple[ibr.Frame, ibr.DepthImage]:
    scene, views, camera = drawn(name)
    return ibr.render(ibr.DepthMeshObject(views), camera), scene.capture(camera)


def told(frame: ibr.Frame) -> np.ndarray:
    assert frame.guessed is not None and frame.guessed.dtype == np.bool_
    assert frame.guessed.shape == frame.valid.shape and not (frame.guessed & ~frame.valid).any()
    return frame.guessed


def differs(frame: ibr.Frame, other: ibr.Frame) -> np.ndarray:
    return (frame.valid != other.valid) | (frame.valid & other.valid & (frame.depth != other.depth))


@pytest.mark.parametrize("name", SCENES)
def test_guessed_is_exactly_what_is_closed(name, lanes):
    closed, bare = closed_and_open(name)
    assert told(closed).sum() > 300
    np.testing.assert_array_equal(told(closed), differs(closed, bare))
    if lanes == 1:  # with several lanes, all pixels of a block use one level of detail
        np.testing.assert_array_equal(closed.color[~told(closed)], bare.color[~told(closed)])
    assert bare.guessed is None


@pytest.mark.parametrize("name", SCENES)
def test_no_view_saw_what_is_guessed(name):
    scene, views, camera = drawn(name)
    guessed, away = guessed_and_away(views, *pictured(name))
    assert (away < 0.5).sum() > 800 and guessed[away < 0.5].mean() < 0.02  # 0.5: drawn surfaces extend by half a sample
    some = views[::2]  # three sides, half of the surface
    guessed, away = guessed_and_away(some, ibr.render(ibr.DepthMeshObject(some), camera), scene.capture(camera))
    assert (away > 2.5).sum() > 300 and guessed[away > 2.5].mean() > 0.95


def guessed_and_away(
    views: list[ibr.DepthImage], frame: ibr.Frame, truth: ibr.DepthImage
) -> tuple[np.ndarray, np.ndarray]:
    """For every seventh pixel, whether it is guessed, and the distance of its true point from the nearest sample.

    Distances are in units of the samples' distance. A point that a view saw is at most 0.7 of it away from a sample if
    the surface faces the view, and at most 1.4 if it is turned by 60 degrees.
    """
    both = frame.valid & truth.valid
    samples = np.concatenate([points_of(view, view.valid) for view in views])
    spacing = float(np.median([view.depth[view.valid].mean() / view.camera.K[0, 0] for view in views]))
    points, known = (
        o3d.geometry.PointCloud(o3d.utility.Vector3dVector(some)) for some in (points_of(truth, both)[::7], samples)
    )
    return told(frame)[both][::7], np.array(points.compute_point_cloud_distance(known)) / spacing


@pytest.mark.parametrize("name", SCENES)
def test_what_is_not_guessed_measures_better(name):
    frame, truth = pictured(name)
    both = frame.valid & truth.valid
    off = np.abs(frame.depth - truth.depth) > 0.02 * truth.depth
    assert off[both & ~told(frame)].mean() < 0.2 * off[both & told(frame)].mean()


@pytest.mark.usefixtures("lanes")
def test_of_several_samples_any_may_be_guessed():
    _, views, camera = drawn("donut")
    thing = ibr.DepthMeshObject(views)
    frame = ibr.render(thing, camera, samples=9)
    fine = ibr.render(thing, camera.resized((3 * camera.width, 3 * camera.height)))
    any_of_nine = told(fine).reshape(camera.height, 3, camera.width, 3).any(axis=(1, 3))
    np.testing.assert_array_equal(told(frame), any_of_nine)


@pytest.mark.parametrize("samples", [1, 4])
def test_a_lens_carries_over_what_is_guessed(samples):
    _, views, camera = drawn("donut")
    lens = Camera(
        camera.K, camera.size, camera.world_from_camera, lens=ibr.Lens("brown_conrady", [-0.1, 0.01, 0.001, 0.002])
    )
    closed, bare = (
        ibr.render(ibr.DepthMeshObject(views, blended=6, closed=closed), lens, samples=samples)
        for closed in (True, False)
    )
    check_guesses_of_lens(closed, bare, 500)


def test_a_fisheyes_faces_are_joined():
    _, views, _ = drawn("donut")
    lens = ibr.Lens("kannala_brandt", [0, 0, 0, 0])
    near = Camera.look_at((1.3, -1.3, 1.2), (0, 0, 0), (0, 0, 1), SIZE, fov_y=90)
    camera = Camera([[70, 0, 119.5], [0, 70, 89.5], [0, 0, 1]], SIZE, near.world_from_camera, lens=lens)
    closed, bare = (
        ibr.render(ibr.DepthMeshObject(views, blended=6, closed=closed), camera) for closed in (True, False)
    )
    check_guesses_of_lens(closed, bare, 100)


def check_guesses_of_lens(closed: ibr.Frame, bare: ibr.Frame, least: int) -> None:
    """Assert that pixels are guessed where closing changes depth, except beside such pixels.

    A lens mixes four pixels of one surface, so that closed pixels change their neighbours. With several samples per
    pixel, depth is that of the front samples, so that other samples may be guessed without changing the depth.
    """
    changed = differs(closed, bare)
    assert told(closed).sum() > least and changed[told(closed)].mean() > 0.99
    beside = cv2.dilate(told(closed).astype(np.uint8), np.ones((5, 5))) > 0
    assert not (changed & ~beside).any() and (changed & ~told(closed)).sum() < 0.1 * changed.sum()


@pytest.mark.parametrize("first", ["object", "box"])
def test_what_is_drawn_before_a_guess_is_none(first):
    _, views, camera = drawn("donut")
    thing = ibr.DepthMeshObject(views)
    alone, before = ibr.render(thing, camera), box((0.9, -0.9, 0.55), (0.1, 0.1, 0.5))
    things = [thing, before] if first == "object" else [before, thing]
    for light in (None, ibr.Light(direction=(-1, 1, -2))):
        frame = ibr.render(things, camera, light)
        shown = frame.depth == alone.depth
        assert told(alone)[~shown].sum() > 50 and told(alone)[shown].sum() > 50
        np.testing.assert_array_equal(told(frame), told(alone) & shown)
    other = ibr.DepthMeshObject([views[0]], closed=False)
    frame = ibr.render([thing, other], camera)
    np.testing.assert_array_equal(told(frame), told(alone) & (frame.depth == alone.depth))


def test_nothing_is_told_where_nothing_guesses():
    _, views, camera = drawn("donut")
    assert ibr.render([ibr.DepthMeshObject(views, closed=False), ibr.DepthMesh(views[0])], camera).guessed is None
    assert ibr.warp(views[0], camera).guessed is None
    away = camera.moved(0, 0, -1e3)
    assert not told(ibr.render(ibr.DepthMeshObject(views), away)).any()
