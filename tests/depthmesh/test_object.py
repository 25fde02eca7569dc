"""Depth mesh objects in pictures: which views are drawn, their weights in the blend, and holes."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

import pyibr as ibr
from pyibr.capture import MeshScene, models, object_views
from pyibr.core.camera import Camera
from pyibr.depthmesh import Segmentation
from pyibr.images import metrics
from pyibr.images.metrics import silhouette_iou
from pyibr.opencl.device import current
from pyibr.opencl.watch import watching
from tests import scenes
from tests.builds import Builds
from tests.depthmesh.views import DIRECTIONS, PROJECTIONS, SIZE, rough, six, target
from tests.exact import same_bits
from tests.reference import depthmesh as reference
from tests.slicing.solids import looking, torus, views_of_torus

BLENDS = ("quality", "position", "nearest")


@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("blend", BLENDS)
def test_one_view_blended_is_that_view_drawn(blend, projection):
    for view in (views_of_torus("perspective")[5], six()[5], scenes.stepped((61, 37))):
        camera = target(projection=projection) if view.camera.width == 160 else view.camera.moved(0.3, 0.1, 0)
        for tolerance in (0.0, 2.0):
            one = ibr.render(ibr.DepthMesh(view, tolerance=tolerance), camera)
            thing = ibr.DepthMeshObject([view], tolerance=2 * tolerance, blend=blend, closed=False)
            assert one.valid.sum() > 300
            same = ibr.render(thing, camera)
            np.testing.assert_array_equal(same.valid, one.valid)
            np.testing.assert_array_equal(same.depth, one.depth)
            # Colours are multiplied by a weight and divided by it again, which rounds.
            assert np.abs(same.color.astype(int) - one.color).max() <= 1


@pytest.mark.parametrize("tolerance", [0, 1, 4])
@pytest.mark.parametrize("kind", PROJECTIONS)
def test_every_projection_draws_the_mesh_of_every_projection(kind, tolerance):
    thing = ibr.DepthMesh(views_of_torus(kind)[5], tolerance=tolerance)
    for projection in PROJECTIONS:
        camera = target(projection=projection)
        made, frame = thing.triangulate(camera), ibr.render(thing, camera)
        mesh = ibr.render(ibr.Mesh(made.vertices, made.faces, sides="front"), camera)
        assert mesh.valid.sum() > 1000
        assert (frame.valid != mesh.valid).mean() <= 1e-3
        both = frame.valid & mesh.valid
        np.testing.assert_allclose(frame.depth[both], mesh.depth[both], rtol=1e-4)
        assert metrics.median_depth_error(frame.depth, mesh.depth, valid=both) <= 1e-5


@pytest.mark.parametrize("closed", [True, False, "sheets"])
@pytest.mark.parametrize("blended", [1, 3])
def test_the_order_of_views_that_are_equally_close_changes_no_bit(closed, blended):
    """The first camera, on a diagonal, is equally close to three of the six views, the second one to two."""
    rng = np.random.default_rng(2)
    views = [
        ibr.DepthImage(rng.integers(60, 256, (*one.depth.shape, 3), np.uint8), one.depth, one.camera, far=one.far)
        for one in object_views(models.donut(), 48)
    ]
    for eye, up in (((4, 4, 4), (0, 0, 1)), ((4, 0, 4), (0, 1, 0))):
        camera = Camera.look_at(eye, (0, 0, 0), up, (61, 37), fov_y=40)
        orders = ((0, 1, 2, 3, 4, 5), (5, 4, 3, 2, 1, 0), (2, 0, 4, 1, 3, 5), (3, 1, 5, 0, 2, 4))
        first, *others = (
            ibr.render(ibr.DepthMeshObject([views[k] for k in order], closed=closed, blended=blended), camera)
            for order in orders
        )
        assert first.valid.sum() > 100
        for other in others:
            same_bits(first, other)


@pytest.mark.parametrize("epsilon", [0.0, 1e-7, 0.01])
def test_no_pixel_goes_without_colour(epsilon):
    """Blending takes surfaces up to `epsilon` behind the front surface, which itself is always among them."""
    bright = [ibr.DepthImage(np.full_like(v.color, 200), v.depth, v.camera) for v in six()]
    things = [ibr.DepthMeshObject(bright, blend=b, epsilon=epsilon) for b in BLENDS]
    if epsilon == 0:
        things.append(ibr.DepthMesh(bright[5]))
    for thing in things:
        for projection in PROJECTIONS:
            frame = ibr.render(thing, target(projection=projection))
            assert (np.abs(frame.color[frame.valid].astype(int) - 200) <= 1).all()


@pytest.mark.parametrize("blend", BLENDS)
def test_the_views_order_changes_nothing(blend):
    views = six()
    rng = np.random.default_rng(0)
    for camera in (target(), target(DIRECTIONS[2], "orthographic")):
        first = ibr.render(ibr.DepthMeshObject(views, blend=blend), camera)
        other = ibr.render(ibr.DepthMeshObject([views[k] for k in rng.permutation(6)], blend=blend), camera)
        np.testing.assert_array_equal(other.valid, first.valid)
        np.testing.assert_array_equal(other.depth, first.depth)
        # Sums are in another order. If several fronts are equally near, "nearest" takes the first view's colour.
        off = np.abs(other.color.astype(int) - first.color).max(axis=2)
        assert (off <= 1).mean() >= (0.999 if blend == "nearest" else 1)


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_the_full_grid_up_to_the_pictures_border(projection):
    """At tolerance 0, triangles that the picture's border cuts are not coarser than the others."""
    view = rough(np.random.default_rng(3), (49, 31), projection, 0.03)
    whole, thing = full_grid(view), ibr.DepthMesh(view, tolerance=0, segmentation=Segmentation("none"))
    for zoom in (1, 3, 11):
        K = view.camera.K * [[zoom], [zoom], [1]] + [[0, 0, 40 - 24 * zoom], [0, 0, 30 - 15 * zoom], [0, 0, 0]]
        camera = Camera(K, (81, 61), view.camera.world_from_camera, projection=projection).moved(0.05, 0.02, 0.1)
        expected, frame = ibr.render(whole, camera), ibr.render(thing, camera)
        np.testing.assert_array_equal(frame.valid, expected.valid)
        # A pixel on an edge may show either of its two triangles.
        assert (np.abs(frame.depth - expected.depth)[frame.valid] > 1e-4).mean() <= 1e-3, zoom


def full_grid(view: ibr.DepthImage) -> ibr.Mesh:
    """All triangles of the grid, up to the image's border, with alternating diagonals and fronts towards the view."""
    width, height = view.camera.size
    y, x = np.mgrid[: height - 1, : width - 1]
    a, main = y * width + x, (x + y) % 2 == 0
    b, c, d = a + 1, a + width, a + width + 1
    upper = np.stack([a, np.where(main, d, c), b], -1)
    lower = np.stack([c, d, np.where(main, a, b)], -1)
    faces = np.concatenate([upper.reshape(-1, 3), lower.reshape(-1, 3)]).astype(np.int32)
    points, structure = view.points.copy(), reference.Tree(view, np.full((height, width), 10, np.uint8))  # all drawn
    turn, center = view.camera.world_from_camera[:3, :3], view.camera.center
    border = [(x, y) for y in range(height) for x in range(width) if x in (0, width - 1) or y in (0, height - 1)]
    for x, y in border:
        points[y * width + x] = turn @ structure.drawn_place((x, y)) + center
    return ibr.Mesh(points.astype(np.float32), faces)


def test_what_was_drawn_before_changes_nothing():
    thing = ibr.DepthMeshObject(views_of_torus("perspective"), blended=2)
    for direction in (*DIRECTIONS, *DIRECTIONS[:1]):
        fresh = ibr.DepthMeshObject(views_of_torus("perspective"), blended=2)
        same_bits(ibr.render(thing, target(direction)), ibr.render(fresh, target(direction)))


def test_weights():
    views = views_of_torus("perspective")
    centers = np.array([view.camera.center for view in views])
    rng = np.random.default_rng(1)
    for blended in (1, 2, 3, 6, 20):
        thing = ibr.DepthMeshObject(views, blended=blended)
        for eye in rng.normal(0, 4, (20, 3)):
            weights = thing.weights(Camera.look_at(eye, (0, 0, 0), (0.1, 0.2, 1), SIZE))
            assert weights.shape == (6,) and weights.dtype == np.float64
            assert weights.sum() == pytest.approx(1)
            assert np.count_nonzero(weights) == min(blended, 6)
            distances = np.linalg.norm(centers - eye, axis=1)
            order = np.argsort(distances)
            assert (np.diff(weights[order]) <= 0).all()
            some = order[: min(blended, 6)]
            np.testing.assert_allclose(weights[some] * distances[some], weights[some[0]] * distances[some[0]])
        at_a_view = thing.weights(views[2].camera)
        assert at_a_view[2] > 0.999


def test_orthographic_cameras_have_weights_by_their_direction():
    thing = ibr.DepthMeshObject(six(), blended=3)
    for direction in np.random.default_rng(2).normal(size=(10, 3)):
        weights = thing.weights(looking(torus(), direction, SIZE, "orthographic"))
        facing = np.array([view.camera.forward @ direction for view in six()])
        assert set(np.argsort(facing)[:3]) == set(np.flatnonzero(weights))
        assert weights.argmax() == facing.argmin()


def test_where_an_orthographic_camera_stands_along_its_axis_changes_nothing():
    views = object_views(torus(), 64)
    moved = views[1].camera.moved(0, 0, -50)
    others = [views[0], ibr.DepthImage(views[1].color, views[1].depth + np.float32(50), moved), *views[2:]]
    thing, same = ibr.DepthMeshObject(views), ibr.DepthMeshObject(others)
    # Depths of the moved view are larger by 50, where float32 rounds by 4e-6.
    np.testing.assert_allclose(same.weights(target()), thing.weights(target()), atol=1e-5)


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_opposite_sides_are_one_thing(projection):
    views = object_views(models.donut(), 64, projection=projection)
    for first in (0, 2, 4):
        assert ibr.render(ibr.DepthMeshObject(views[first : first + 2]), views[first].camera).valid.any()


def test_a_sample_far_off_spoils_nothing():
    view = scenes.flat((33, 33))
    depth = view.depth.copy()
    depth[5, 7] = 1e6
    spoilt = ibr.DepthImage(view.color, depth, view.camera)
    mesh = ibr.DepthMesh(spoilt)
    np.testing.assert_allclose(mesh.bounds, ibr.DepthMesh(view).bounds, atol=1e-6)
    ends = np.array([[-0.5, -0.5], [32.5, -0.5], [-0.5, 32.5], [32.5, 32.5]])
    corners = view.camera.unproject(ends, np.full(4, view.depth[0, 0]))
    np.testing.assert_allclose(mesh.bounds, [corners.min(axis=0), corners.max(axis=0)], atol=1e-6)
    # The triangles at the sample are missing, which may uncover pixels of its neighbours.
    assert ibr.render(mesh, view.camera).valid.sum() >= 33 * 33 - 9
    extent = np.ptp(corners, axis=0).max()
    assert ibr.DepthMeshObject([spoilt]).epsilon == pytest.approx(0.01 * extent)


def plane_seen(angle: float, gray: int) -> ibr.DepthImage:
    """View of the plane z = 0 in one grey, from a distance of 4 and `angle` degrees off the plane's normal."""
    turn = np.radians(angle)
    camera = Camera.look_at((4 * np.sin(turn), 0, 4 * np.cos(turn)), (0, 0, 0), (0, 1, 0), (65, 65), fov_y=30)
    corners = [[-9, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]]
    view = MeshScene(corners, [[0, 1, 2], [0, 2, 3]]).capture(camera)
    return ibr.DepthImage(np.full_like(view.color, gray), view.depth, view.camera)


@pytest.mark.parametrize("blend", BLENDS)
def test_colours_are_weighed_by_position_and_quality(blend):
    angles, grays = (0, 60, -40), (20, 220, 120)
    thing = ibr.DepthMeshObject([plane_seen(a, g) for a, g in zip(angles, grays, strict=True)], blend=blend)
    camera = Camera.look_at((1.5, 0.4, 4), (0, 0, 0), (0, 1, 0), (41, 31), fov_y=12)
    frame, weights = ibr.render(thing, camera), thing.weights(camera)
    assert frame.valid.all()
    facing = np.cos(np.radians(angles)) if blend == "quality" else 1.0
    if blend == "nearest":
        assert set(np.unique(frame.color)) <= set(grays)
    else:
        expected = (weights * facing) @ grays / (weights * facing).sum()
        # 1.01: colours are rounded. Normals are exact, even at the border, since the surface is a plane.
        assert np.abs(frame.color - expected).max() <= 1.01


def test_what_lies_behind_by_more_than_epsilon_gives_no_colour():
    view = scenes.smooth((65, 65))
    gray = [np.full_like(view.color, level) for level in (20, 200)]
    for gap, epsilon, expected in ((0.02, 0.05, 110), (0.05, 0.02, 200)):
        behind = ibr.DepthImage(gray[0], view.depth + np.float32(gap), view.camera)
        near = ibr.DepthImage(gray[1], view.depth, view.camera)
        thing = ibr.DepthMeshObject([behind, near], tolerance=0.0, blend="position", epsilon=epsilon, closed=False)
        frame, bits = ibr.render(thing, view.camera), thing.occupancy(view.camera)
        inner = np.s_[1:-1, 1:-1]
        assert np.abs(frame.color[inner].astype(int) - expected).max() <= 1
        assert (bits[inner] == (3 if expected == 110 else 2)).all()
        np.testing.assert_allclose(frame.depth[inner], view.depth[inner], rtol=1e-4)


def test_occupancy():
    thing = ibr.DepthMeshObject(six(), closed=False)
    for direction in DIRECTIONS:
        camera = target(direction)
        views, frame, weights = thing.occupancy(camera), ibr.render(thing, camera), thing.weights(camera)
        assert (views.shape, views.dtype) == (SIZE[::-1], np.uint32)
        np.testing.assert_array_equal(views > 0, frame.valid)
        possible = int((np.uint32(1) << np.flatnonzero(weights).astype(np.uint32)).sum())
        assert not (views & ~np.uint32(possible)).any()
        for number in np.flatnonzero(weights):
            drawn = views >> np.uint32(number) & 1 > 0
            alone = ibr.render(ibr.DepthMesh(six()[number], tolerance=0.5), camera)  # half of the object's
            assert drawn.any() and not (drawn & ~alone.valid).any()
            # A view gives colour exactly where its surface is at most `epsilon` behind the front surface.
            near = alone.valid & (alone.depth <= np.nan_to_num(frame.depth) + thing.epsilon)
            assert (near != drawn).mean() <= 2e-3
        several = np.array([bin(v).count("1") for v in np.unique(views)])
        assert several.max() == 3
    only = ibr.DepthMeshObject(six(), blend="nearest", closed=False).occupancy(target())
    assert all(bin(v).count("1") <= 1 for v in np.unique(only))


def test_occupancy_names_views_by_their_own_numbers():
    views = six()
    camera = target()
    first = ibr.DepthMeshObject(views).occupancy(camera)
    order = [3, 5, 0, 1, 4, 2]
    other = ibr.DepthMeshObject([views[k] for k in order]).occupancy(camera)
    back = np.zeros_like(other)
    for place, number in enumerate(order):
        back |= (other >> np.uint32(place) & 1) << np.uint32(number)
    np.testing.assert_array_equal(back, first)


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_facing_views_come_before_closer_ones(projection):
    """A camera above a ring: a far view from above shows the whole ring; a closer view, from the side, half of it."""
    scene, up = MeshScene.from_mesh(models.donut(48)), (0, 1, 0)
    camera = Camera.look_at((0, 0.1, 4), (0, 0, 0), up, (121, 121), fov_y=45)
    views = []
    for eye in ((0, 0, 9), (3.6, 0, 1.5)):
        own = Camera.look_at(eye, (0, 0, 0), up, (160, 160), fov_y=35)
        if projection == "orthographic":
            own = Camera.look_at(eye, (0, 0, 0), up, (160, 160), projection=projection, height=3.5)
        views.append(scene.capture(own))
    truth, found = scene.capture(camera), {}
    for choose in ("closest", "facing"):
        thing = ibr.DepthMeshObject(views, blended=1, closed=False, choose=choose)
        found[choose] = silhouette_iou(ibr.render(thing, camera).valid, truth.valid)
        # Orthographic views are close by direction alone, so that the view that looks the same way is closest, too.
        expected = 1 if choose == "closest" and projection == "perspective" else 0
        assert thing.weights(camera)[expected] == 1
    assert found["facing"] >= 0.95
    assert projection == "orthographic" or found["closest"] <= 0.8
    # If all views are drawn, there is nothing to choose.
    same = [ibr.render(ibr.DepthMeshObject(views, choose=c), camera) for c in ("closest", "facing")]
    same_bits(*same)


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_exposures_are_matched(projection):
    views = object_views(models.donut(), 128, projection=projection)
    exposures = (1.0, 0.75, 1.0, 1.0, 0.85, 1.0)  # relative to the median
    others = [
        ibr.DepthImage((v.color * exposure).astype(np.uint8), v.depth, v.camera)
        for v, exposure in zip(views, exposures, strict=True)
    ]
    truth = MeshScene.from_mesh(models.donut())
    for eye in ((2, -2, 2), (-2, 1, 2.5)):
        camera = Camera.look_at(eye, (0, 0, 0), (0, 0, 1), (160, 120), fov_y=45)
        seen, found = truth.capture(camera), {}
        for match in (False, True):
            frame = ibr.render(ibr.DepthMeshObject(others, match_exposures=match), camera)
            found[match] = metrics.psnr(frame.color, seen.color, valid=frame.valid & seen.valid)
        # Colours are rounded down to bytes, by half a level on average, which limits PSNR to 48 dB.
        assert found[True] >= 40 and found[True] >= found[False] + 5
    same = [ibr.render(ibr.DepthMeshObject(views, match_exposures=m), camera) for m in (False, True)]
    # Equal exposures are changed by two levels at most: the views' samples lie in different places.
    assert np.abs(same[0].color.astype(int) - same[1].color).max() <= 2


@pytest.mark.parametrize("kind", PROJECTIONS)
def test_a_view_comes_back_at_its_own_camera(kind):
    views = views_of_torus(kind)
    for blend in BLENDS:
        thing = ibr.DepthMeshObject(views, tolerance=0, blend=blend)
        for view in (views[0], views[4]):
            frame = ibr.render(thing, view.camera)
            assert silhouette_iou(frame.valid, view.valid) >= 0.97
            inner = frame.valid & (cv2.erode(view.valid.astype(np.uint8), np.ones((5, 5))) > 0)
            assert inner.sum() > 2000
            assert np.quantile(np.abs(frame.depth - view.depth)[inner], 0.99) <= 0.01
            off = np.abs(frame.color.astype(int) - view.color).max(axis=2)[inner]
            # The view itself has almost all weight, except with "nearest", which may show any view's sample.
            assert np.quantile(off, 0.95) <= (2 if blend != "nearest" and kind == "perspective" else 12)


def test_one_view_comes_back():
    for view in (scenes.stepped((61, 37)), scenes.holed((61, 37)), six()[4]):
        thing = ibr.DepthMesh(view, tolerance=0, segmentation=Segmentation("none"))
        frame = ibr.render(thing, view.camera)
        assert not (frame.valid & ~view.valid).any()
        # Only pixels surrounded by valid samples are compared, since rounding decides at a surface's edge.
        inner = cv2.erode(view.valid.astype(np.uint8), np.ones((3, 3)), borderValue=0) > 0
        assert inner.sum() > 700
        assert frame.valid[inner].all()
        np.testing.assert_allclose(frame.depth[inner], view.depth[inner], rtol=1e-4)  # steep triangles at edges
        assert (np.abs(frame.color.astype(int) - view.color).max(axis=2)[inner] <= 1).mean() >= 0.99


def test_float_colours():
    views = [ibr.DepthImage((v.color / np.float32(255)).astype(np.float32), v.depth, v.camera) for v in six()]
    for thing, like in (
        (ibr.DepthMeshObject(views), ibr.DepthMeshObject(six())),
        (ibr.DepthMesh(views[5]), ibr.DepthMesh(six()[5])),
    ):
        frame, bytes_frame = ibr.render(thing, target()), ibr.render(like, target())
        np.testing.assert_array_equal(frame.depth, bytes_frame.depth)
        scale = 255 if frame.color.dtype == np.float32 else 1
        # On the device, colours have 8 bits per channel.
        assert np.abs(frame.color.astype(float) * scale - bytes_frame.color)[frame.valid].max() <= 1.01


def test_the_background_shows_through_holes_only():
    view = scenes.stepped((96, 128))
    with_it, without = (ibr.DepthMeshObject([view], closed=b) for b in (True, False))
    camera = view.camera.moved(0.35, 0.1, 0)
    full, bare = ibr.render(with_it, camera), ibr.render(without, camera)
    assert full.valid.sum() > bare.valid.sum() + 50
    np.testing.assert_array_equal(full.depth[bare.valid], bare.depth[bare.valid])
    np.testing.assert_array_equal(full.color[bare.valid], bare.color[bare.valid])
    # From the view's own position there is no hole.
    own = ibr.render(with_it, view.camera), ibr.render(without, view.camera)
    assert own[0].valid.sum() >= own[1].valid.sum()
    assert own[0].valid[1:-1, 1:-1].mean() > 0.99


def test_views_that_look_the_opposite_way_are_chosen_last():
    """However close a view is, it has 1/2000 of its weight if it looks the opposite way."""
    camera = ibr.Camera([[20, 0, 4], [0, 20, 4], [0, 0, 1]], (9, 9))
    turned = np.diag([-1.0, 1, -1, 1])
    turned[2, 3] = 4.5
    behind = ibr.Camera(camera.K, camera.size, turned)  # behind the wall at z = 2, half a unit farther than the camera
    far = ibr.Camera(camera.K, camera.size, camera.world_from_camera).moved(0, 0, -20)
    views = [
        ibr.DepthImage(None, np.full((9, 9), depth, np.float32), one) for one, depth in ((behind, 2.5), (far, 22.0))
    ]
    thing = ibr.DepthMeshObject(views, blended=1, choose="facing", closed=False)
    assert thing.weights(camera.moved(0, 0, 4.4)).argmax() == 1


def test_counts_and_cameras_build_nothing():
    builds, after, views = Builds(), list[int](), object_views(torus(), 24)
    with watching(builds):
        for count in (3, 4, 6):
            for blend in BLENDS:
                thing = ibr.DepthMeshObject(views[:count], blend=blend, blended=count // 2)
                for eye in ((0, 0.3, 4), (0, 0.1, 1.2), (0.9, 0, 0.2)):  # far from the object, close to it, and inside
                    ibr.render(thing, Camera.look_at(eye, (0, 0, 0), (0, 1, 0), (41, 31), fov_y=50))
            after.append(len(builds.of))
    assert after[0] == after[1] == after[2] > 0


@pytest.mark.parametrize("drawers", [1, 7, 1000])
def test_any_number_of_work_items_draws_the_same(drawers, monkeypatch):
    camera = target().resized((331, 301))
    expected = ibr.render(ibr.DepthMeshObject(six()), camera)
    profile = dataclasses.replace(current().profile, drawers=drawers)
    monkeypatch.setattr("pyibr.depthmesh.drawing.current", lambda: SimpleNamespace(profile=profile))
    same_bits(ibr.render(ibr.DepthMeshObject(six()), camera), expected)
