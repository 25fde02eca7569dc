"""All things are drawn for cameras with lenses, and from images with lenses; some functions refuse lenses."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import pyibr as ibr
from pyibr.picture.undistort import undistorted_silhouette
from pyibr.slicing import alpha_tests
from tests import truth

pytest.importorskip("open3d")
from pyibr.capture import models
from pyibr.capture.raycast import MeshScene

BARREL = ibr.Lens("brown_conrady", [-0.22, 0.05, 0.002, -0.001])
FISHEYE = ibr.Lens("kannala_brandt", [0.02, -0.01, 0.002, 0])
WIDE = ibr.Lens("kannala_brandt", [0, 0, 0, 0])
LENSES = {"none": None, "barrel": BARREL, "fisheye": FISHEYE}
SIZE = (121, 97)


@cache
def torus() -> MeshScene:
    return MeshScene.from_mesh(models.donut())


def around(lens: ibr.Lens | None, angle: float, height: float = 1.2) -> ibr.Camera:
    """A camera that looks at the torus from `angle` degrees around it, with a wide margin."""
    eye = (3 * np.sin(np.radians(angle)), height, 3 * np.cos(np.radians(angle)))
    camera = ibr.Camera.look_at(eye, (0, 0, 0), (0, 1, 0), SIZE, fov_y=70)
    return ibr.Camera(camera.K, SIZE, camera.world_from_camera, lens=lens)


def seen_by_rays(camera: ibr.Camera) -> ibr.DepthImage:
    return torus().capture(camera)


def check(frame: ibr.Frame, expected: ibr.DepthImage, depth: float, color: float, missed: float = 0.0) -> None:
    """Check coverage and depth against cast rays, except within two pixels of silhouettes."""
    inside = ~truth.dilate(~expected.valid, 2)
    assert (~frame.valid & inside).mean() <= missed
    assert (frame.valid & ~truth.dilate(expected.valid, 2)).mean() <= missed
    both = inside & frame.valid
    assert both.mean() > 0.03
    assert np.percentile(np.abs(frame.depth - expected.depth)[both] / expected.depth[both], 99) < depth
    assert np.percentile(np.abs(frame.color.astype(float) - expected.color)[both], 95) < color


@pytest.mark.parametrize("lens", ["barrel", "fisheye"])
def test_meshes_are_drawn_as_rays_see_them(lens):
    camera = around(LENSES[lens], 20)
    check(ibr.render(models.donut(), camera), seen_by_rays(camera), 2e-3, 300)


@pytest.mark.parametrize("lens", ["barrel", "fisheye", "none"])
def test_depth_objects_from_lenses(lens):
    views = [seen_by_rays(around(LENSES[lens], angle, height)) for angle in range(0, 360, 60) for height in (2.5, -2.5)]
    camera = around(FISHEYE if lens == "barrel" else None, 30)
    expected = seen_by_rays(camera)
    # Pinhole cameras would hardly do better with so few views: they leave 0.025, inside the ring.
    check(ibr.render(ibr.DepthObject(views, slices=128), camera), expected, 0.035, 60, 0.01)
    hull = ibr.render(ibr.VisualHull(views, slices=96), camera)
    assert (hull.valid & ~truth.dilate(expected.valid, 6)).mean() < 0.03
    assert (~hull.valid & ~truth.dilate(~expected.valid, 3)).mean() < 0.002


@pytest.mark.parametrize("lens", ["barrel", "fisheye", "none"])
def test_depth_meshes_from_lenses(lens):
    views = [seen_by_rays(around(LENSES[lens], angle)) for angle in (0, 25, 50)]
    camera = around(BARREL if lens == "fisheye" else None, 25)
    expected = seen_by_rays(camera)
    check(ibr.render(ibr.DepthMesh(views[1]), camera), expected, 0.01, 25, 0.01)
    check(ibr.render(ibr.DepthMeshObject(views), camera), expected, 0.01, 25, 0.01)
    mesh = ibr.DepthMesh(views[1]).triangulate(around(BARREL, 25), tolerance=0.5)
    check(ibr.render(mesh, camera), expected, 0.01, 300, 0.01)


def test_silhouettes_are_undistorted():
    camera = around(BARREL, 10)
    view = seen_by_rays(camera)
    one = undistorted_silhouette(ibr.Silhouette(view.color, view.valid, camera))
    assert one.camera.lens is None
    pinhole = torus().capture(one.camera)
    apart = one.valid != pinhole.valid
    assert not (apart & ~(truth.dilate(pinhole.valid, 2) & truth.dilate(~pinhole.valid, 2))).any()


def test_shadows_fall_the_same_way():
    floor = ibr.Mesh([[-4, -1, -4], [4, -1, -4], [-4, -1, 4], [4, -1, 4]], [[0, 1, 2], [3, 2, 1]])
    ring = models.donut()
    light = ibr.Light(direction=(-0.3, -1, -0.2))
    camera = around(BARREL, 20)
    frame = ibr.render([floor, ring], camera, light)
    straight = ibr.render([floor, ring], ibr.Camera(camera.K, SIZE, camera.world_from_camera), light)
    seen = frame.color[frame.valid].mean() / straight.color[straight.valid].mean()
    assert 0.9 < seen < 1.1
    middle = np.s_[30:-30, 40:-40]  # near the axis, a lens bends little
    assert np.abs(frame.color[middle].astype(float) - straight.color[middle]).mean() < 12


def test_backgrounds_are_beside_what_a_lens_sees():
    mesh = models.donut()
    frame = ibr.render(mesh, around(ibr.Lens("brown_conrady", [-0.45, 0, 0, 0]), 0), background=(10, 20, 30))
    assert frame.color[0, 0].tolist() == [10, 20, 30]
    assert (frame.color[~frame.valid] == [10, 20, 30]).all()


def test_what_refuses_lenses_says_so():
    camera, wide = around(BARREL, 0), ibr.Camera([[40, 0, 60], [0, 40, 48], [0, 0, 1]], SIZE, lens=WIDE)
    corners, uv = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 0], [1, 0], [1, 1], [0, 1]]
    square = ibr.Mesh(corners, [[0, 1, 2], [0, 2, 3]], uv=uv)
    height, color = np.full((4, 4), 0.48, np.float32), np.full((4, 4, 3), 200, np.uint8)
    relief = ibr.ReliefSurface(square, height, color, scale=0.2)
    sliced = ibr.SlicedSurface(square, height, color, scale=0.2)
    view = seen_by_rays(around(None, 0))
    blended = ibr.DepthMeshObject([view])
    calls = (
        (lambda: relief.tile_coordinates(camera), "without a lens"),
        (lambda: alpha_tests(sliced, camera), "without a lens"),
        (lambda: blended.occupancy(camera), "without a lens"),
        (lambda: blended.weights(wide), "up to 75 degrees from its axis"),
        (lambda: ibr.DepthMesh(view).triangulate(wide, tolerance=1.0), "up to 75 degrees from its axis"),
    )
    for call, words in calls:
        with pytest.raises(ibr.ArgumentError, match=words) as caught:
            call()
        assert caught.value.argument == "camera"
        assert "\n" not in str(caught.value)
    for thing in (relief, sliced):  # these accept lenses
        assert ibr.render(thing, camera).color.shape == (97, 121, 3)
    assert blended.weights(camera).tolist() == [1.0]


@pytest.mark.parametrize("draw", [ibr.warp, ibr.render])
def test_images_that_a_lens_tears_apart_are_refused(draw):
    """The tangential distortion moves pixels by millions of pixels: 96 x 14 pixels would become 40 million."""
    lens = ibr.Lens("brown_conrady", [0, 0, 0.03, 0.01, 0])
    camera = ibr.Camera([[3.5e10, 0, 23.5], [0, 32, 3], [0, 0, 1]], (48, 7), lens=lens)
    view = ibr.DepthImage(
        None, np.full((9, 13), 2.0, np.float32), ibr.Camera([[9, 0, 6], [0, 9, 4], [0, 0, 1]], (13, 9))
    )
    with pytest.raises(ibr.ArgumentError, match="lens: expected a lens whose undistorted image has at most 100 times"):
        draw(view, camera)


def test_distances_along_the_rays_of_a_lens():
    camera = ibr.Camera([[60, 0, 60], [0, 60, 48], [0, 0, 1]], SIZE, lens=BARREL)
    wall = np.full(SIZE[::-1], 2, np.float32)
    distance = ibr.euclidean_from_depth(wall, camera)
    points = ibr.DepthImage(np.zeros((*SIZE[::-1], 3), np.uint8), wall, camera).points
    np.testing.assert_allclose(distance.ravel(), np.linalg.norm(points, axis=1), rtol=1e-6)
    np.testing.assert_allclose(ibr.depth_from_euclidean(distance, camera), wall, rtol=1e-6)
