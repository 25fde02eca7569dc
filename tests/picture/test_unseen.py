"""Marks on parts that no depth image has seen, compared with rays from the images' cameras to the true surface."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

import pyibr as ibr
from pyibr.capture import capture, cube_cameras, models
from pyibr.picture.drawable import as_drawable
from pyibr.picture.unseen import MarkedUnseen
from tests.embree import embree, points_of
from tests.one_lane import both_forms

MARK = (230, 40, 40)
TARGET = ibr.Camera.look_at((1.6, -1.9, 2.3), (0, 0, 0), (0, 0, 1), (163, 121), fov_y=50)


@cache
def scene() -> ibr.Mesh:
    """A donut, and a ball in its hole that occludes a part of it."""
    ring, ball = models.donut(96), models.donut(48, radius=1e-3, tube=0.35)
    corners = np.concatenate([ring.vertices, ball.vertices + np.array([0, 0, 0.3])])
    colors = np.random.default_rng(0).integers(100, 200, (len(corners), 3)).astype(np.uint8)
    return ibr.Mesh(corners, np.concatenate([ring.faces, ball.faces + len(ring.vertices)]), colors=colors)


@cache
def source(projection: str, eye: tuple[float, float, float], size: int = 255) -> ibr.DepthImage:
    how = {"fov_y": 45} if projection == "perspective" else {"projection": projection, "height": 2.5}
    camera = ibr.Camera.look_at(eye, (0, 0, 0), (0, 1, 0.2), (size, size + 14), **how)
    return capture(scene(), camera)


def marked(views: list[ibr.DepthImage], camera: ibr.Camera = TARGET, **how: Any) -> np.ndarray:
    """(H, W) True where the picture is marked."""
    plain = ibr.render(scene(), camera)
    frame = ibr.render(MarkedUnseen(as_drawable(scene()), views, **how), camera)
    np.testing.assert_array_equal(frame.depth, plain.depth)
    expected = np.rint(0.4 * plain.color.astype(float) + 0.6 * np.array(MARK))
    is_marked = np.abs(frame.color - expected).max(axis=2) <= 1  # float32 rounds 0.6 and 0.4
    changed = (frame.color != plain.color).any(axis=2)
    assert not (changed & ~is_marked).any()
    assert not changed[~plain.valid].any()
    return changed


def unseen_by_rays(views: list[ibr.DepthImage], points: np.ndarray, margin: float = 0.0) -> np.ndarray:
    """(n,) True if each view misses the point: it lies outside the view's image, or is occluded."""
    rays = embree(scene())
    unseen = np.ones(len(points), bool)
    for view in views:
        camera = view.camera
        pixels, depth = camera.project(points)
        away = points - (camera.center if camera.projection == "perspective" else points - 10 * camera.forward)
        far = np.linalg.norm(away, axis=1)
        packed = np.concatenate([points - away, away / far[:, None]], axis=1).astype(np.float32)
        hit = rays.cast_rays(packed)["t_hit"].numpy()
        inside = ((pixels >= -0.5 - margin) & (pixels <= np.array(camera.size) - 0.5 + margin)).all(axis=1) & (
            depth > 0
        )
        unseen &= ~(inside & (hit > far - 2e-3))
    return unseen


def test_only_the_part_in_a_box_is_marked():
    views = [source("perspective", (0.0, 0.0, 4.0))]
    box = np.array([[0.1, -2.0, -0.3], [2.0, 0.4, 0.25]])
    whole, part = marked(views), marked(views, within=box)
    points = points_of(ibr.render(scene(), TARGET), whole)
    inside = ((points > box[0]) & (points < box[1])).all(axis=1)
    near = (np.abs(points[:, None] - box) < 1e-4).any(axis=(1, 2))  # left out: rounding (3e-7 of the distance) decides
    assert 0.2 < inside.mean() < 0.8
    np.testing.assert_array_equal(part[whole][~near], inside[~near])
    assert not part[~whole].any()


CASES = {
    "one": [("perspective", (0.0, 0.0, 4.0))],
    "two": [("perspective", (2.5, 0.0, 3.0)), ("perspective", (-1.0, -2.0, 2.5))],
    "orthographic": [("orthographic", (1.0, 0.5, 4.0))],
    "near": [("perspective", (1.6, -0.3, 0.9))],
}


@pytest.mark.parametrize("name", CASES)
def test_what_is_marked_is_what_no_ray_reaches(name):
    views = [source(*case) for case in CASES[name]]
    found = marked(views)
    frame = ibr.render(scene(), TARGET)
    points = points_of(frame)
    truth = unseen_by_rays(views, points)
    assert 0.04 < truth.mean() < 0.95
    agree = found[frame.valid] == truth
    # Silhouettes are off by up to a sample, and on oblique surfaces a sample covers much.
    steep = np.all([np.abs(slopes(view, points)) > 0.3 for view in views], axis=0)
    assert steep.sum() > 2000
    assert agree[steep].mean() > 0.995
    assert agree.mean() > 0.96


def slopes(view: ibr.DepthImage, points: np.ndarray) -> np.ndarray:
    """(n,) cosines between the surface's normals and the directions to the view."""
    camera = view.camera
    ahead = points - TARGET.center
    packed = np.concatenate([np.broadcast_to(TARGET.center, ahead.shape), ahead], axis=1).astype(np.float32)
    normals = embree(scene()).cast_rays(packed)["primitive_normals"].numpy()
    to = (
        camera.center - points if camera.projection == "perspective" else np.broadcast_to(-camera.forward, points.shape)
    )
    return np.sum(normals * to, axis=1) / np.linalg.norm(normals, axis=1) / np.linalg.norm(to, axis=1)


def test_what_the_camera_itself_has_seen_is_not_marked():
    view = capture(scene(), TARGET)
    assert marked([view])[view.valid].mean() < 0.01  # pixels at silhouettes, which have a neighbour's depth
    np.testing.assert_array_equal(marked([]), ibr.render(scene(), TARGET).valid)


def test_the_side_that_counts_is_asked_for():
    """Views inside a ball see the back of its surface: from outside it only counts as seen by `side="back"`."""
    middle = [capture(scene(), camera) for camera in cube_cameras((0, 0, 0.3), 128)]
    assert marked(middle).sum() > 0.99 * ibr.render(scene(), TARGET).valid.sum()
    back = marked(middle, side="back")
    frame = ibr.render(scene(), TARGET)
    points = points_of(frame)
    on_ball = np.abs(np.linalg.norm(points - (0, 0, 0.3), axis=1) - 0.35) < 0.02
    assert back[frame.valid][on_ball].mean() < 0.03
    np.testing.assert_array_equal(marked(middle, side="both") & marked(middle), marked(middle, side="both"))


def test_what_a_view_has_no_depth_for_it_has_not_seen():
    view = capture(scene(), TARGET)
    depth = np.array(view.depth)
    depth[:, :80] = np.inf
    holed = ibr.DepthImage(view.color, depth, TARGET)
    found = marked([holed])
    assert found[:, :79][view.valid[:, :79]].all()
    assert found[:, 82:][view.valid[:, 82:]].mean() < 0.02
    near = float(np.nanmedian(view.depth[view.valid]))
    found = marked([ibr.DepthImage(view.color, view.depth, TARGET, far=near)])
    beyond = ~view.valid | (view.depth > near)
    around = np.all([np.roll(beyond, step, (0, 1)) for step in np.ndindex(3, 3)], axis=0)  # neighbours, too
    seen = ibr.render(scene(), TARGET).valid & np.roll(around, (-1, -1), (0, 1))
    assert seen.sum() > 1000
    assert found[seen].all()


def test_other_things_stay_as_they_are_and_pictures_in_floats_are_marked_alike():
    view = source("perspective", (0.0, 0.0, 4.0))
    wall = ibr.Mesh([[-9, -9, -1], [9, -9, -1], [0, 9, -1]], [[0, 1, 2]], colors=np.full((3, 3), 90, np.uint8))
    thing = MarkedUnseen(as_drawable(scene()), [view])
    alone, after = ibr.render(thing, TARGET), ibr.render([wall, thing], TARGET)
    plain = ibr.render([wall, scene()], TARGET)
    on_wall = (plain.color == 90).all(axis=2)
    assert on_wall.sum() > 500
    assert (after.color[on_wall] == 90).all()
    seen = alone.valid & ~on_wall
    edge = (after.color != alone.color).any(axis=2) & seen  # beside the silhouette, normals come from the wall
    assert edge.sum() < 0.03 * seen.sum()
    dot = ibr.DepthImage(
        np.zeros((1, 1, 3), np.float32), np.full((1, 1), 50, np.float32), ibr.Camera(np.eye(3), (1, 1))
    )
    in_floats = ibr.render([thing, dot], TARGET)
    np.testing.assert_allclose(in_floats.color[seen], alone.color[seen] / 255, atol=1.01 / 255)


@pytest.mark.thorough
def test_one_lane_marks_the_same():
    views = [source(*case) for case in CASES["two"]]
    np.testing.assert_array_equal(*both_forms(lambda: marked(views)))


def test_lights_see_the_thing_itself():
    light = ibr.Light(direction=(0.2, 0.3, -1))
    lit = ibr.render(MarkedUnseen(as_drawable(scene()), [capture(scene(), TARGET)]), TARGET, light)
    plain = ibr.render(scene(), TARGET, light)
    assert (lit.color == plain.color).all(axis=2).mean() > 0.98


def test_lenses_and_sides_are_checked():
    thing = as_drawable(scene())
    with pytest.raises(ibr.ArgumentError, match="side"):
        MarkedUnseen(thing, [], side="left")
    bent = ibr.Camera(TARGET.K, TARGET.size, lens=ibr.Lens("brown_conrady", [-0.1, 0, 0, 0]))
    with pytest.raises(ibr.ArgumentError, match="views"):
        MarkedUnseen(thing, [ibr.DepthImage(None, np.ones((121, 163), np.float32), bent)])
