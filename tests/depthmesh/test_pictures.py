"""Pictures of depth meshes: with other objects, with lights, from far away and from close up."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("open3d")

import pyibr as ibr
from pyibr.capture import MeshScene, cube_cameras, object_views
from pyibr.core.camera import Camera
from pyibr.depthmesh import Segmentation
from tests import scenes
from tests.depthmesh.views import PROJECTIONS, SIZE, six, target
from tests.embree import embree
from tests.shadowed import AMBIENT, CAMERAS, agreement, ball, box, joined, plane
from tests.slicing.solids import torus


@pytest.mark.thorough
@pytest.mark.parametrize(
    "shape",
    [
        {"direction": (1, 0.6, -1.2)},
        {"position": (-2, -1, 3), "direction": (2, 1.2, -3), "angle": 50},
        {"position": (-1.5, -2, 2.8)},
    ],
    ids=str,
)
def test_shadows_are_cast_and_received(shape):
    solid = ball((0.2, 0.1, 0.75), 0.6)
    bar, floor = box((-0.3, -0.6, 1.4), (0.1, 0.7, 0.05)), plane()
    views = object_views(joined([solid]), 128)
    scene, light = embree(solid, bar, floor), ibr.Light(**shape, ambient=AMBIENT)
    for thing in (ibr.DepthMeshObject(views), ibr.DepthMeshObject([ibr.DepthMesh(view) for view in views], blended=6)):
        # Samples are 0.01 apart: so precise is the ball's silhouette for the light.
        assert agreement([thing, bar, floor], scene, CAMERAS["perspective"], light) >= 0.97


def test_images_are_not_shaded():
    """Images already contain light: colours change only in another object's shadow, to their ambient part."""
    thing = ibr.DepthMeshObject(six())
    camera = target()
    plain = ibr.render(thing, camera)
    lit = ibr.render(thing, camera, ibr.Light(direction=(0, 0, -1), ambient=0.25, shadow_size=0))
    np.testing.assert_array_equal(lit.color, plain.color)
    roof = ibr.Mesh([[-3, 3, -3], [3, 3, -3], [3, 3, 3], [-3, 3, 3]], [[0, 1, 2], [0, 2, 3]])
    shaded = ibr.render([thing, roof], camera, ibr.Light(direction=(0, -1, 0), ambient=0.25))
    under = plain.valid & (shaded.depth == plain.depth)
    assert under.sum() > 1000
    np.testing.assert_allclose(shaded.color[under], 0.25 * plain.color[under], atol=1)


def test_frames_from_one_place_are_told_by_where_they_look():
    """Frames of a panorama have one centre: for each camera, those that look the same way are drawn."""
    scene = joined([box((0, 0, 0), (2, 2, 2))])
    views = [scene.capture(camera) for camera in cube_cameras((0.1, 0, 0), 65)]
    thing = ibr.DepthMeshObject(views, blended=3, closed=False)
    for number, view in enumerate(views):
        assert ibr.render(thing, view.camera).valid.mean() > 0.95
        assert thing.weights(view.camera).argmax() == number


def test_frames_of_something_else_come_last():
    """The frame that is closest to the camera looks the opposite way, and is not drawn."""
    scene = joined([box((0, 0, 0), (2, 2, 2))])
    ahead, behind = cube_cameras((0.1, 0, 0), 65)[4:]
    thing = ibr.DepthMeshObject([scene.capture(behind), scene.capture(ahead.moved(0.2, 0, -0.5))], blended=1)
    assert thing.weights(ahead).tolist() == [0, 1]
    assert ibr.render(thing, ahead).valid.mean() > 0.95


def test_a_lit_surface_does_not_shade_itself():
    """There are no false shadows at any tolerance, although light and camera choose different triangles."""
    y, x = np.mgrid[:192, :192]
    depth = (4 + 0.15 * np.sin(x / 11) + 0.15 * np.cos(y / 9)).astype(np.float32)
    camera = Camera([[192, 0, 95.5], [0, 192, 95.5], [0, 0, 1]], (192, 192))
    view = ibr.DepthImage(np.full((192, 192, 3), 200, np.uint8), depth, camera)
    for tolerance in (0, 1, 4):
        frame = ibr.render(
            ibr.DepthMesh(view, tolerance=tolerance), camera.moved(0.4, 0.2, 0), ibr.Light(direction=(0.1, 0.1, 1))
        )
        assert (frame.color[frame.valid] == 200).all(), tolerance


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_views_seen_small_are_averaged(projection):
    """From far away a checkerboard is grey, and colours of holes do not mix in; from close up it is sharp."""
    size = (203, 131)
    y, x = np.mgrid[: size[1], : size[0]]
    light = (x // 2 + y // 2) % 2 == 0
    color = np.repeat(np.where(light, 240, 40).astype(np.uint8)[..., None], 3, 2)
    color[60:71, 90:111] = (255, 0, 0)
    depth = np.full(size[::-1], 4, np.float32)
    depth[60:71, 90:111] = np.nan
    camera = scenes.source_camera(size, projection)
    thing = ibr.DepthMesh(ibr.DepthImage(color, depth, camera), segmentation=Segmentation("none"))
    for scale, spread in ((8, 12), (21, 12), (3, 45)):
        small = ibr.render(thing, camera.resized((size[0] // scale, size[1] // scale)))
        assert small.valid.mean() > 0.8
        seen = small.color[small.valid].astype(float)
        assert abs(seen.mean() - 140) < 5 and seen.std() < spread, scale
        assert np.ptp(seen, axis=-1).max() == 0  # grey alone: red samples have no depth
    same = ibr.render(thing, camera)
    assert same.valid.mean() > 0.97 and set(np.unique(same.color[same.valid])) == {40, 240}


def test_colours_stay_sharp_where_views_stand_in_the_middle():
    """Views from the middle of a room look sharp, although their distance from the room's centre is almost 0."""
    walls = box((0, 0, 0), (1, 1, 1))
    corners = np.array(walls.vertices)
    checkers = np.kron([[40, 220], [220, 40]] * 4, np.ones((8, 8)))
    texture = np.tile(checkers.astype(np.uint8)[..., None], (1, 4, 3))
    points = MeshScene(corners, walls.faces, uv=corners[:, [0, 1]] * 0.4 + 0.5, texture=texture)
    views = [points.capture(camera) for camera in cube_cameras((1e-3, 0, 0), 128)]
    camera = Camera.look_at((0.2, 0.1, 0.15), (0.1, 0.2, 1.0), (0, 1, 0), SIZE, fov_y=70)
    truth, frame = points.capture(camera), ibr.render(ibr.DepthMeshObject(views, tolerance=0.0, blended=6), camera)
    both = frame.valid & truth.valid
    assert both.mean() > 0.95
    assert np.abs(frame.color.astype(int) - truth.color)[both].mean() <= 10  # levels of 255; squares are 40 and 220


def test_from_within():
    thing = ibr.DepthMeshObject(six())
    ring = torus().vertices[0]
    for eye in ((0, 0, 0), 0.5 * ring, ring, 0.999 * ring):
        frame = ibr.render(thing, Camera.look_at(eye, np.add(eye, (0.3, 2, 0.1)), (0, 0, 1), (41, 33), fov_y=80))
        np.testing.assert_array_equal(np.isfinite(frame.depth), frame.valid)
        assert (frame.depth[frame.valid] > 0).all()


def test_many_triangles_in_a_large_picture():
    """There are 400,000 triangles and 6,656 bins of pixels; their product exceeds 32 bits."""
    n = 450
    depth = (2 + 0.02 * np.random.default_rng(1).normal(size=(n, n))).astype(np.float32)
    view = ibr.DepthImage(
        np.full((n, n, 3), 99, np.uint8), depth, Camera([[n, 0, 224], [0, n, 224], [0, 0, 1]], (n, n))
    )
    wide = Camera([[9000, 0, 8192], [0, 400, 205], [0, 0, 1]], (16384, 411))
    frame = ibr.render(ibr.DepthMesh(view, tolerance=0, segmentation=Segmentation("none")), wide)
    assert 0.45 < frame.valid.mean() < 0.55
    assert abs(frame.depth[frame.valid] - 2).max() < 0.2
