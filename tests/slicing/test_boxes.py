"""The box of an object holds the whole object, and little more."""

from __future__ import annotations

import numpy as np
import pytest

import pyibr as ibr
from pyibr.capture import object_views
from pyibr.core.camera import Camera
from pyibr.opencl.device import one_call
from pyibr.slicing.boxes import Box, box_of_samples, box_of_silhouettes
from pyibr.slicing.cells import maps_of
from tests.embree import points_of
from tests.picture.test_far import moved_view
from tests.reference.slicing import visual_hull
from tests.slicing.solids import cup, looking, torus, views_of_torus

KINDS = ["orthographic", "perspective", "four", "nine, anywhere"]


def within(box: Box, points: np.ndarray) -> np.ndarray:
    along = points @ box.axes.T
    return ((along >= box.low) & (along <= box.high)).all(axis=1)


def nearness_of(view: ibr.DepthImage, box: Box, missing_is_empty: bool) -> np.ndarray:
    """(H, W) nearness of a view's samples in the map that objects read."""
    with one_call():
        return maps_of([view], box, missing_is_empty).to_host()[: view.depth.size].reshape(view.depth.shape)


def test_a_box_is_a_unit_cube_in_its_own_frame():
    axes, _ = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))
    box = Box(axes, np.array([1.0, -2, 3]), np.array([2.0, 3, 7]))
    np.testing.assert_allclose(box.edges, [1, 5, 4])
    cube = box.corners @ box.from_world[:, :3].T + box.from_world[:, 3]
    assert {tuple(corner) for corner in np.rint(cube).astype(int).tolist()} == {
        (x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)
    }
    np.testing.assert_allclose(cube, np.rint(cube), atol=1e-12)
    np.testing.assert_allclose(box.center, box.corners.mean(axis=0))


@pytest.mark.parametrize("kind", KINDS)
def test_the_box_of_samples_is_theirs_along_the_first_views_axes(kind):
    views = views_of_torus(kind)
    box = box_of_samples(views, True)
    np.testing.assert_allclose(box.axes, views[0].camera.world_from_camera[:3, :3].T)
    every = np.concatenate([points_of(view) for view in views])
    assert within(box, every).all()
    extent = np.ptp(every @ box.axes.T, axis=0)
    np.testing.assert_allclose(box.edges, extent + 0.002 * extent.max(), rtol=1e-9)  # 1/1000 more on each side


def test_a_flat_object_has_a_box_with_an_inside():
    camera = Camera([[20, 0, 10], [0, 20, 10], [0, 0, 1]], (21, 21))
    view = ibr.DepthImage(np.zeros((21, 21, 3), np.uint8), np.full((21, 21), 2.0, np.float32), camera)
    box = box_of_samples([view], True)
    assert (box.edges > 0).all()
    assert np.isfinite(box.from_world).all()


@pytest.mark.parametrize("projection", ["orthographic", "perspective"])
def test_background_is_as_far_as_the_box_reaches(projection):
    views = object_views(torus(), 40, projection=projection)
    box = box_of_samples(views, True)
    for view in views:
        nearness = nearness_of(view, box, True)
        z = view.camera.camera_from_world[2, :3] @ box.corners.T + view.camera.camera_from_world[2, 3]
        far = nearness[~view.valid]
        np.testing.assert_allclose(far, 1 / z.max() if projection == "perspective" else -z.max(), rtol=1e-6)
        there = view.depth[view.valid]
        expected = 1 / there if projection == "perspective" else -there
        np.testing.assert_array_max_ulp(nearness[view.valid], expected, 4)  # the last two bits hold the kind of cell
        assert far.max() < nearness[view.valid].min()


@pytest.mark.parametrize("by", [(0, 0, 0), (300, -200, 100)])
@pytest.mark.parametrize("kind", KINDS)
def test_the_box_of_silhouettes_holds_all_that_lies_within_them(kind, by):
    views = [moved_view(view, by) for view in views_of_torus(kind)]
    box = box_of_silhouettes(views)
    np.testing.assert_array_equal(box.axes, np.eye(3))
    random = np.random.default_rng(2).uniform(-1, 1, size=(200_000, 3))
    points = box.center + random * 0.75 * box.edges.max()  # a cube 1.5 times as wide as the box
    points = points[visual_hull(views)(points)]
    assert len(points) > 1000
    assert within(box, points).all()
    # The box exceeds the points by two cells of the last grid, by samples of a silhouette and by the cells' radii. All
    # this is no more than a tenth.
    assert (box.edges <= 1.1 * np.ptp(points, axis=0) + 0.05 * box.edges.max()).all()


def test_two_opposite_views_anywhere_in_the_world():
    """Outlines from opposite sides do not limit the object's depth along the rays; the box ends at the cameras."""
    for projection in ("orthographic", "perspective"):
        here = object_views(torus(), 60, projection=projection)[:2]
        box, there = (box_of_silhouettes(v) for v in (here, [moved_view(view, (100, 30, 5)) for view in here]))
        assert within(box, torus().vertices).all()
        np.testing.assert_allclose(there.center - box.center, (100, 30, 5), atol=0.05)
        np.testing.assert_allclose(there.edges, box.edges, rtol=0.02)


def test_a_small_silhouette_is_found():
    """Four views have silhouettes of one pixel each."""
    views = []
    for eye in ((3, 0, 0), (0, 3, 0.1), (0, 0.1, 3), (2, 2, 2)):
        camera = Camera.look_at(eye, (0, 0, 0), (0.1, 0.2, 0.3), (201, 151), fov_y=60)
        mask = np.zeros((151, 201), bool)
        mask[75, 100] = True
        views.append(ibr.Silhouette(np.zeros((151, 201, 3), np.uint8), mask, camera))
    box = box_of_silhouettes(views)
    pixel = 2 * 3 * np.tan(np.radians(30)) / 151
    assert within(box, np.zeros((1, 3))).all()
    # The box contains the pixel's square and, around it, the pixel and a half that a coarse grid must keep.
    assert (box.edges <= 8 * pixel).all()
    target = views[3].camera
    frame = ibr.render(ibr.VisualHull(views, slices=64), Camera(target.K, target.size, target.world_from_camera))
    assert frame.valid[75, 100]
    assert frame.valid.sum() <= 9


def test_views_with_nothing_in_common():
    views = object_views(cup(), 40)
    apart = [views[0], moved_view(views[2], (0, 0, 50))]
    for made in (ibr.DepthObject, ibr.VisualHull):
        with pytest.raises(ibr.ArgumentError, match=r"^views: "):
            made(apart)


def test_samples_without_depth_say_that_there_is_nothing_or_nothing_at_all():
    camera = Camera([[20, 0, 10], [0, 20, 10], [0, 0, 1]], (21, 21))
    depth = np.full((21, 21), 2.0, np.float32)
    depth[:, 0], depth[:, 1], depth[:, 2], depth[:, 3] = np.nan, 0, np.inf, 9
    view = ibr.DepthImage(np.zeros((21, 21, 3), np.uint8), depth, camera, far=8)
    box = box_of_samples([view], True)
    far, near = nearness_of(view, box, True), nearness_of(view, box, False)
    surface = np.float32(0.5)
    assert (far[:, :4] < surface).all()
    assert (near[:, :2] > surface).all()  # unknown: every point passes the test
    assert (near[:, 2:4] < surface).all()
    np.testing.assert_array_max_ulp(far[:, 4:], near[:, 4:], 3)


def test_silhouettes_from_one_side_bound_nothing():
    view = cup().capture(looking(cup(), (0, 0, 1), (60, 50)))
    aside = ibr.DepthImage(view.color, view.depth, view.camera.moved(0.1, 0, 0))
    for views in ([view], [view, view], [view, aside]):
        with pytest.raises(ibr.ArgumentError, match="one side"):
            box_of_silhouettes(views)
