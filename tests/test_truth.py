"""The ray-cast truth and the NumPy references match closed forms and each other."""

from __future__ import annotations

import numpy as np
import pytest

from pyibr.core.camera import Camera
from pyibr.images import DepthImage
from tests import scenes, truth
from tests.reference.warp import forward_reference, search_reference

pytest.importorskip("open3d")

PROJECTIONS = ("perspective", "orthographic")
SIZE = (31, 22)
TARGET = (27, 24)


@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("size", [(61, 37), (7, 13), (64, 64)])
def test_identity_pose_gives_the_input(size, projection):
    view = scenes.stepped(size, projection)
    seen = truth.raycast(view, view.camera)
    assert seen.valid.all()
    np.testing.assert_allclose(seen.depth, view.depth, rtol=1e-6)
    np.testing.assert_allclose(seen.color, view.color, atol=1e-6)
    y, x = np.mgrid[: size[1], : size[0]]
    np.testing.assert_allclose(seen.source, np.stack([x, y], -1), atol=1e-9)


@pytest.mark.parametrize("source", PROJECTIONS)
@pytest.mark.parametrize("target", PROJECTIONS)
def test_plane_is_seen_at_its_closed_form_depth(source, target):
    view = scenes.flat((61, 37), source)
    n = view.camera.forward
    for pose in scenes.some_cameras(view, "BDI", (40, 33), target):
        seen = truth.raycast(view, pose.camera)
        assert seen.valid.any(), pose.name
        y, x = np.nonzero(seen.valid)
        pixel = np.stack([x, y, np.ones_like(x)], -1) @ np.linalg.inv(pose.camera.K).T
        rotation = pose.camera.world_from_camera[:3, :3]
        if target == "perspective":
            origin, direction = pose.camera.center, pixel @ rotation.T
        else:
            origin, direction = pixel[:, :2] @ rotation[:, :2].T + pose.camera.center, pose.camera.forward
        expected = ((view.camera.center + 4 * n - origin) @ n) / (direction @ n)
        np.testing.assert_allclose(seen.depth[seen.valid], expected, rtol=1e-10, err_msg=pose.name)


def test_the_front_is_the_side_that_the_source_sees():
    view = scenes.flat((32, 32))
    behind = Camera(view.camera.K, (32, 32), view.camera.world_from_camera @ scenes.pose(yaw=180, center=(0, 0, 8)))
    seen = {side: truth.raycast(view, behind, side=side).valid.mean() for side in ("front", "back", "both")}
    front, back, both = seen.values()
    assert (front, back) == (0, both)
    assert both > 0.8
    assert truth.raycast(view, view.camera, side="back").valid.sum() == 0


def test_cut_triangles_and_background_are_not_there():
    view = scenes.holed((64, 48))
    seen = truth.raycast(view, view.camera, edges="cut", side="both")
    cells = scenes.image_coordinates(view.camera.size)[0][:-1, :-1].size
    whole = len(truth.triangulate(scenes.smooth((64, 48))))
    assert whole == 2 * cells
    assert len(truth.triangulate(view, "cut")) < len(truth.triangulate(view)) < whole
    assert not seen.valid[~view.valid].any()
    disc = view.depth == 100
    assert disc.any()
    assert not seen.valid[disc].any()
    depth = np.where(np.arange(64) < 32, 2, 2.11) * np.ones((48, 1))
    torn = DepthImage(view.color, depth.astype(np.float32), view.camera)
    assert len(truth.triangulate(torn, "cut", 1.05)) == 2 * 47 * 62
    assert len(truth.triangulate(torn, "cut", 1.06)) == 2 * 47 * 63


def test_of_several_views_the_nearest_is_seen():
    near, far = scenes.flat((40, 30)), scenes.stepped((40, 30))
    camera = near.camera.moved(0.3, 0.1, -0.2)
    both = truth.raycast([far, near], camera)
    one, other = truth.raycast(far, camera), truth.raycast(near, camera)
    np.testing.assert_array_equal(both.valid, one.valid | other.valid)
    np.testing.assert_array_equal(both.depth, np.fmin(one.depth, other.depth))
    assert set(np.unique(both.view[both.valid])) == {0, 1}
    first = one.depth <= np.where(other.valid, other.depth, np.inf)
    np.testing.assert_array_equal(both.view == 0, one.valid & first)


def test_band_holds_edges_and_nothing_of_a_slope():
    width, height = 40, 30
    camera = Camera([[30, 0, 20], [0, 30, 15], [0, 0, 1]], (width, height))
    color = np.zeros((height, width, 3), np.uint8)
    x = np.mgrid[:height, :width][1]
    slope = DepthImage(color, (1 / (0.1 + 0.02 * x)).astype(np.float32), camera)  # steep: up to 20 % a pixel
    step = DepthImage(color, np.where(x < 20, 2.0, 3.0).astype(np.float32), camera)
    inside = np.s_[4:-4, 4:-4]
    assert not truth.band(truth.raycast(slope, camera))[inside].any()
    shifted = Camera([[30, 0, 20.25], [0, 30, 15], [0, 0, 1]], (width, height))
    found = truth.band(truth.raycast(step, shifted), radius=3)[inside]
    expected = (x >= 19 - 2) & (x <= 21 + 2)  # pixel 20 shows the step's slope, with an edge on each side
    np.testing.assert_array_equal(found, expected[inside])


def test_depth_change_over_a_source_pixel():
    camera = Camera([[30, 0, 20], [0, 30, 15], [0, 0, 1]], (40, 30), projection="orthographic")
    y, x = np.mgrid[:30, :40].astype(np.float32)
    ramp = DepthImage(np.zeros((30, 40, 3), np.uint8), 2 + 0.1 * x + 0.01 * y, camera)
    target = Camera([[30, 0, 20.25], [0, 30, 15.5], [0, 0, 1]], (40, 30), projection="orthographic")
    seen = truth.raycast(ramp, target)
    change = truth.depth_change_one_pixel(seen, ramp, target)
    # In x and y, the hit lies 0.25 and 0.5 before a sample. The farthest of its four samples is 0.75 and 0.5 away.
    np.testing.assert_allclose(change[5:-5, 5:-5], 0.1 * 0.75 + 0.01 * 0.5, rtol=1e-4)


@pytest.mark.parametrize("scene", [scenes.smooth, scenes.stepped])
def test_every_region_and_pair_of_signs_is_there(scene):
    view = scene((40, 30))
    for region in scenes.REGIONS:
        poses = scenes.target_cameras(view, region)
        assert {pose.signs for pose in poses} == {(1, 1), (1, -1), (-1, 1), (-1, -1)}, region
        for pose in poses:
            assert scenes.epipole_region(view.camera, pose.camera) == region
            assert scenes.epipole_signs(view.camera, pose.camera) == pose.signs
            assert truth.raycast(view, pose.camera).valid.mean() > 0.1, pose.name


@pytest.mark.parametrize("source", PROJECTIONS)
@pytest.mark.parametrize("target", PROJECTIONS)
@pytest.mark.parametrize(("scene", "regions"), [(scenes.smooth, "AFH"), (scenes.stepped, "BDI"), (scenes.holed, "CEG")])
def test_search_reference_is_the_truth(scene, regions, source, target):
    view = scene(SIZE, source)
    first = 2 * PROJECTIONS.index(source) + PROJECTIONS.index(target)
    for number, pose in enumerate(scenes.some_cameras(view, regions, TARGET, target)[first::4]):
        edges, side = ("connect", "cut")[number % 2], ("front", "both")[number // 2 % 2]
        seen = truth.raycast(view, pose.camera, edges=edges, side=side)
        found = search_reference(view, pose.camera, edges=edges, side=side)
        assert np.count_nonzero(seen.valid != found.valid) <= 1, pose.name  # a ray may just touch the border
        same = seen.valid & found.valid
        agree = np.isclose(found.depth[same], seen.depth[same], rtol=1e-6)
        off = ~agree
        for by in (1e-6, -1e-6) if np.count_nonzero(off) > 1 else ():  # half-way between samples, either is right
            beside = search_reference(view, scenes.moved_aside(pose.camera, by, by), edges=edges, side=side)
            off &= ~np.isclose(beside.depth[same], seen.depth[same], rtol=1e-5)
        assert np.count_nonzero(off) <= 1, pose.name
        np.testing.assert_allclose(found.color[same][agree], seen.color[same][agree], atol=1e-5)


@pytest.mark.parametrize("source", PROJECTIONS)
def test_nearest_search_is_within_a_source_pixel(source):
    view = scenes.stepped(SIZE, source)
    for pose in scenes.some_cameras(view, {"perspective": "AEH", "orthographic": "BFG"}[source], TARGET)[::4]:
        seen = truth.raycast(view, pose.camera)
        found = search_reference(view, pose.camera, sample="nearest")
        np.testing.assert_array_equal(found.valid, seen.valid)
        limit = truth.depth_change_one_pixel(seen, view, pose.camera)
        within = np.abs(found.depth - seen.depth)[seen.valid] <= limit[seen.valid] + 1e-9
        assert within.all(), pose.name


@pytest.mark.parametrize("source", PROJECTIONS)
@pytest.mark.parametrize("target", PROJECTIONS)
def test_forward_reference_draws_points_of_the_surface(source, target):
    view = scenes.smooth(SIZE, source)
    camera = scenes.special_cameras(view, (64, 50), target)[1].camera
    found = forward_reference(view, camera)
    world = view.camera.world_from_camera[:3, :3] @ truth.samples(view).T + view.camera.center[:, None]
    pixel, depth = camera.project(world.T)
    column, row = np.floor(pixel + 0.5).astype(int).T
    inside = (column >= 0) & (column < 64) & (row >= 0) & (row < 50)
    expected = np.full((50, 64), np.inf)
    np.minimum.at(expected, (row[inside], column[inside]), depth[inside])
    np.testing.assert_array_equal(found.valid, np.isfinite(expected))
    np.testing.assert_allclose(found.depth[found.valid], expected[found.valid], rtol=1e-9)
    bigger = forward_reference(view, camera, splat=3)
    np.testing.assert_array_equal(bigger.valid, truth.dilate(found.valid, 1) | bigger.valid)
    assert bigger.valid.sum() > found.valid.sum()


def test_forward_reference_breaks_ties_by_the_earlier_sample():
    camera = Camera([[8, 0, 3.5], [0, 8, 3.5], [0, 0, 1]], (8, 8))
    color = np.zeros((8, 8, 3), np.uint8)
    color[..., 0] = np.arange(64).reshape(8, 8)
    view = DepthImage(color, np.full((8, 8), 2, np.float32), camera)
    half = Camera([[4, 0, 1.85], [0, 4, 1.85], [0, 0, 1]], (4, 4))  # sample x falls on x/2 + 0.1
    found = forward_reference(view, half)
    first = [0, 1, 3, 5]  # first of the samples that fall on one pixel
    np.testing.assert_array_equal(found.color[..., 0], color[first][:, first, 0])
