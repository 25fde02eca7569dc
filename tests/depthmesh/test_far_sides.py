"""Far sides of depth edges: to close holes, far surfaces continue behind near ones, and nowhere else."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

pytest.importorskip("open3d")

import pyibr as ibr
from pyibr.capture import MeshScene
from pyibr.core.camera import Camera
from pyibr.depthmesh import Segmentation
from pyibr.depthmesh.far_sides import far_sides_of
from pyibr.images import DepthImage
from tests import scenes
from tests.depthmesh.views import PROJECTIONS
from tests.shadowed import box, joined

SIZE = (160, 120)
STEP = 2.0  # depth of the near part of a step


def room(slope: float) -> MeshScene:
    """A box in front of a wall that fills all views; from left to right, the wall's depth grows by `slope` per unit."""
    corners = np.array([[-30, -30, 0], [30, -30, 0], [30, 30, 0], [-30, 30, 0]], float)
    corners[:, 2] = 5 + slope * corners[:, 0]
    near = joined([box((0.1, 0.2, 2.5), (0.5, 0.4, 0.2))])
    count = len(near.vertices)
    faces = np.concatenate([near.faces, np.array([[0, 1, 2], [0, 2, 3]]) + count])
    colors = np.concatenate([np.full((count, 3), 220), np.tile([60, 120, 30], (4, 1))]).astype(np.uint8)
    return MeshScene(np.concatenate([near.vertices, corners]), faces, colors=colors)


def camera_at(x: float, projection: str, fov: float = 45) -> Camera:
    eye, up = (x, 0, -0.5), (0, -1, 0)
    if projection == "orthographic":
        return Camera.look_at(eye, (0.3 * x, 0, 3), up, SIZE, projection="orthographic", height=4 * fov / 45)
    return Camera.look_at(eye, (0.3 * x, 0, 3), up, SIZE, fov_y=fov)


@pytest.mark.parametrize("slope", [0.0, 0.3])
@pytest.mark.parametrize("kind", PROJECTIONS)
@pytest.mark.parametrize("projection", PROJECTIONS)
def test_the_wall_goes_on_behind_a_box(projection, kind, slope):
    scene = room(slope)
    view, camera = scene.capture(camera_at(0.0, kind)), camera_at(1.0, projection, 25)
    truth, things = scene.capture(camera), [ibr.DepthMeshObject([view], closed=b) for b in (False, True)]
    bare, frame = (ibr.render(thing, camera) for thing in things)
    # Only pixels of the wall are checked: the box's right side, which no view sees either, is not.
    wall = truth.valid & (truth.color[..., 0] < 100)
    closed = frame.valid & ~bare.valid & wall
    hole = cv2.erode((~bare.valid & wall).astype(np.uint8), np.ones((3, 3))) > 0
    assert closed.sum() > 200
    assert frame.valid[hole].mean() >= 0.98
    off = np.abs(frame.depth - truth.depth) / truth.depth
    # A ray's point is known to 1/128 of a step of 1.5 % of the extent; the extent is at most 4 times the depth.
    assert np.median(off[closed]) <= 1e-3 and (off[closed] <= 0.01).mean() >= 0.97
    assert (np.abs(frame.color.astype(int) - truth.color)[closed].max(axis=1) <= 2).mean() >= 0.97
    same = bare.valid & (frame.depth == bare.depth)
    assert same.sum() >= 0.999 * bare.valid.sum()
    np.testing.assert_array_equal(frame.color[same], bare.color[same])


@pytest.mark.parametrize("given", [True, False])
def test_what_goes_on_behind_a_box_is_relit_by_its_own_normals(given):
    """A new light falls on the continued surface by that surface's normals."""
    slope, way = 0.3, np.array([0.5, 0.4, 1.0])
    view, camera = room(slope).capture(camera_at(0.0, "perspective")), camera_at(1.0, "perspective", 25)
    truth, light = room(slope).capture(camera), ibr.Light(direction=way, shadow_size=0, relight=True)
    normal = np.array([slope, 0, -1]) / np.hypot(slope, 1)
    if given:  # the wall's normal everywhere; the box is not checked
        own = (normal @ view.camera.world_from_camera[:3, :3]).astype(np.float32)
        view = DepthImage(view.color, view.depth, view.camera, normals=np.broadcast_to(own, (*SIZE[::-1], 3)))
    bare, frame = (ibr.render(ibr.DepthMeshObject([view], closed=b), camera, light) for b in (False, True))
    closed = frame.valid & ~bare.valid & truth.valid & (truth.color[..., 0] < 100)
    assert closed.sum() > 200
    lambert = -normal @ way / np.linalg.norm(way)
    expected = np.array([60, 120, 30]) * (light.ambient + (1 - light.ambient) * lambert)
    # Normals have 8 bits per component, so that colours of up to 120 are off by up to 0.4 %.
    assert (np.abs(frame.color - expected)[closed].max(axis=1) <= 1.5).mean() >= 0.97


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_surfaces_end_half_a_sample_beyond_their_last_ones(projection):
    """Seen from the view's position at a higher resolution, each pixel shows box or wall as the nearest sample does."""
    times = 3  # pixels per sample; an odd number, so that no pixel lies half-way between two samples
    view = room(0.0).capture(camera_at(0.0, projection))
    camera = view.camera
    K = np.diag([times, times, 1]) @ camera.K
    size = (times * (SIZE[0] - 1) + 1, times * (SIZE[1] - 1) + 1)
    finer = Camera(K, size, camera.world_from_camera, projection=camera.projection)
    bare, frame = (ibr.render(ibr.DepthMeshObject([view], closed=b), finer) for b in (False, True))
    rows, columns = (np.rint(np.arange(n) / times).astype(int) for n in size[::-1])
    nearest = view.depth[np.ix_(rows, columns)]
    closed = frame.valid & ~bare.valid
    assert closed.sum() > 500 and np.array_equal(frame.valid, bare.valid | closed)
    for near in (True, False):
        part = closed & ((nearest < 3) == near)
        assert part.sum() > 0.3 * closed.sum()
        # On each ray, the point is found to 1/128 of 1.5 % of the extent.
        assert (np.abs(frame.depth - nearest) <= 1e-3 * nearest)[part].mean() >= 0.98
        assert (np.abs(frame.color[..., 0].astype(int) - (220 if near else 60)) <= 2)[part].mean() >= 0.98


def test_several_views_close_what_one_sees_past():
    """Two views see a box from both sides; in each view, an edge of the box hides the wall where the hole remains."""
    scene = room(0.0)
    views = [scene.capture(camera_at(x, "perspective")) for x in (-0.4, 0.4)]
    camera = camera_at(1.6, "perspective", 25)
    truth, frame = scene.capture(camera), ibr.render(ibr.DepthMeshObject(views), camera)
    bare = ibr.render(ibr.DepthMeshObject(views, closed=False), camera)
    hole = ~bare.valid & (truth.color[..., 0] < 100) & truth.valid
    assert hole.sum() > 200
    assert frame.valid[hole].mean() >= 0.95
    assert (np.abs(frame.depth - truth.depth) <= 0.01 * truth.depth)[hole & frame.valid].mean() >= 0.95


def test_nothing_goes_on_behind_what_stands_alone():
    """Without a wall, the unseen space behind the box stays empty."""
    near = joined([box((0.1, 0.2, 2.5), (0.5, 0.4, 0.2)), box((1.2, 0.2, 4.5), (0.3, 0.4, 0.2))])
    views = [near.capture(camera_at(x, "perspective")) for x in (-0.4, 0.4)]
    for x in (-1.6, 1.6):
        camera = camera_at(x, "perspective")
        truth, frame = near.capture(camera), ibr.render(ibr.DepthMeshObject(views), camera)
        beside = cv2.dilate(truth.valid.astype(np.uint8), np.ones((5, 5))) == 0
        assert frame.valid.sum() > 500 and not frame.valid[beside].any()


def stepped(size: scenes.Size, projection: str, far: float = 4.0) -> DepthImage:
    """A view with the left half at depth STEP and the right half at depth `far`, each in one colour."""
    x = np.broadcast_to(np.arange(size[0]), size[::-1])
    depth = np.where(x < size[0] // 2, STEP, far).astype(np.float32)
    color = np.where((x < size[0] // 2)[..., None], np.uint8(200), np.uint8(50))
    return DepthImage(np.repeat(color, 3, axis=2), depth, scenes.source_camera(size, projection))


@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("size", [(4, 2), (7, 13), (31, 17), (64, 64)])
def test_what_goes_on_behind_a_step(size, projection):
    view = stepped(size, projection)
    words = np.where(view.depth > STEP, np.uint32(0xFF323232), np.uint32(0xFFC8C8C8))
    mesh = ibr.DepthMesh(view, segmentation=Segmentation("disparity", gap=0.1))  # tears the step at any image size
    found = far_sides_of(mesh.tree, view.depth)
    depth, color = found.depth, found.colored(words)
    assert depth.dtype == np.float32 and color.dtype == np.uint32
    np.testing.assert_allclose(depth, 4, rtol=1e-6)  # the far plane continues at its constant depth
    np.testing.assert_array_equal(color, 0xFF323232)


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_nothing_goes_on_where_there_is_no_edge(projection):
    flat = scenes.flat((17, 11), projection)
    words = np.arange(17 * 11, dtype=np.uint32).reshape(11, 17)
    holed = flat.depth.copy()
    holed[3:5, 4:9] = 0  # a hole has no far side
    for limit in (flat.depth, holed):
        view = DepthImage(flat.color, limit, flat.camera)
        found = far_sides_of(ibr.DepthMesh(view).tree, limit)
        np.testing.assert_array_equal(found.depth, limit)
        np.testing.assert_array_equal(found.colored(words), words)


def test_background_goes_on_as_background():
    view = stepped((31, 17), "perspective", np.inf)
    assert np.isinf(far_sides_of(ibr.DepthMesh(view).tree, view.depth).depth).all()


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_background_lends_no_colour_to_what_goes_on_beside_it(projection):
    """The near part lies between a farther surface and black background."""
    x = np.broadcast_to(np.arange(31), (17, 31))
    depth = np.select([x < 6, x < 20], [np.float32(4), np.float32(STEP)], np.float32(np.inf))
    color = np.select([x < 6, x < 20], [np.uint8(50), np.uint8(200)], np.uint8(0))
    view = DepthImage(np.repeat(color[..., None], 3, axis=2), depth, scenes.source_camera((31, 17), projection))
    words = np.select([x < 6, x < 20], [np.uint32(0xFF323232), np.uint32(0xFFC8C8C8)], np.uint32(0))
    found = far_sides_of(ibr.DepthMesh(view, segmentation=Segmentation("disparity", gap=0.1)).tree, view.depth)
    surface = found.hidden & np.isfinite(found.depth)
    assert surface.sum() > 60
    np.testing.assert_array_equal(found.colored(words)[surface], 0xFF323232)
