"""Depth meshes extend to the outer edges of their images' pixels."""

from __future__ import annotations

import numpy as np
import pytest

import pyibr as ibr
from pyibr.capture import cube_cameras
from pyibr.core.camera import Camera
from pyibr.depthmesh import Segmentation
from tests import scenes
from tests.depthmesh.views import PROJECTIONS, rough

SIZES = [(2, 2), (2, 9), (12, 2), (7, 13), (61, 37), (64, 33)]
WHOLE = Segmentation("none")


def plane(size: scenes.Size, projection: str, x0: int = 0) -> tuple[ibr.DepthImage, np.ndarray]:
    """Columns from x0 on of an image of an oblique plane, and the vector n with n . point = 1 on the plane."""
    K = np.array([[60.0, 0, 20 - x0], [0, 50, 12], [0, 0, 1]])
    camera = Camera(K, size, scenes.pose(yaw=10, center=(1, 2, 3)), projection=projection)
    y, x = np.mgrid[: size[1], : size[0]]
    ray = np.stack([x, y, np.ones_like(x)], -1) @ np.linalg.inv(K).T
    normal = np.array([0.1, -0.07, 0.25])
    depth = 1 / (ray @ normal) if projection == "perspective" else (1 - ray[..., :2] @ normal[:2]) / normal[2]
    color = np.broadcast_to(((x + x0) % 256).astype(np.uint8)[..., None], (*size[::-1], 3))
    return ibr.DepthImage(np.ascontiguousarray(color), depth.astype(np.float32), camera), normal


@pytest.mark.usefixtures("lanes")
@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("size", SIZES)
def test_a_view_is_covered_at_its_own_camera(size, projection):
    """A view's mesh covers its camera's picture, also at twice the resolution or with samples=4."""
    view = rough(np.random.default_rng(3), size, projection, 0.05)
    thing, (width, height) = ibr.DepthMesh(view, tolerance=0, segmentation=WHOLE), size
    frame = ibr.render(thing, view.camera)
    assert frame.valid.all()
    # float32 rounds 1/z. The rasteriser moves corners by up to 1/512 pixel, while the depth changes by up to 0.4 per
    # pixel.
    np.testing.assert_allclose(frame.depth, view.depth, atol=2e-3)
    assert ibr.render(thing, view.camera.resized((2 * width, 2 * height))).valid.all()
    several = ibr.render(thing, view.camera, samples=4)
    assert several.alpha is not None and (several.alpha == 1).all()


@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("size", SIZES)
def test_planes_go_on_as_planes(size, projection):
    view, normal = plane(size, projection)
    thing = ibr.DepthMesh(view, segmentation=WHOLE)
    for mesh in (thing.triangulate(view.camera, tolerance=0), thing.simplify(1e-3)):
        points = (mesh.vertices - view.camera.center) @ view.camera.world_from_camera[:3, :3]
        # Depths of about 4 are inverted and restored in float32.
        np.testing.assert_allclose(points @ normal, 1, atol=1e-5)
        np.testing.assert_array_equal(mesh.uv.min(axis=0), [0, 0])
        np.testing.assert_array_equal(mesh.uv.max(axis=0), [1, 1])
        low, high = thing.bounds
        assert (mesh.vertices >= low - 1e-5).all() and (mesh.vertices <= high + 1e-5).all()


@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("blended", [False, True])
def test_tiles_of_a_picture_meet(projection, blended):
    whole, _ = plane((41, 25), projection)
    left, right = plane((17, 25), projection)[0], plane((24, 25), projection, 17)[0]
    camera = whole.camera.moved(0.3, 0.2, -0.4)

    def drawn(*views: ibr.DepthImage) -> ibr.Frame:
        meshes = [ibr.DepthMesh(view, segmentation=WHOLE) for view in views]
        return ibr.render(ibr.DepthMeshObject(meshes, blended=2, closed=False) if blended else meshes, camera)

    expected, tiles = drawn(whole), drawn(left, right)
    np.testing.assert_array_equal(tiles.valid, expected.valid)
    assert 0.3 < tiles.valid.mean() < 1
    np.testing.assert_allclose(tiles.depth[tiles.valid], expected.depth[tiles.valid], rtol=1e-5)
    # Beyond the outermost samples, colours stay constant. Here they change by a level per pixel, so that they are off
    # by up to half a level.
    assert np.abs(tiles.color.astype(int) - expected.color).max() <= 1


@pytest.mark.parametrize("closed", [False, True])
def test_the_images_of_a_cube_map_meet(closed):
    n = 33
    views = list[ibr.DepthImage]()
    K = np.array([[n / 2, 0, (n - 1) / 2], [0, n / 2, (n - 1) / 2], [0, 0, 1]])  # the images fill the cube's sides
    for side in cube_cameras((0, 0, 0), n):
        camera = Camera(K, (n, n), side.world_from_camera)
        y, x = np.mgrid[:n, :n]
        ray = np.stack([x, y, np.ones_like(x)], -1) @ np.linalg.inv(K).T
        depth = (3 / np.linalg.norm(ray, axis=-1)).astype(np.float32)
        views.append(ibr.DepthImage(np.full((n, n, 3), 200, np.uint8), depth, camera))
    thing = ibr.DepthMeshObject(views, blended=6, tolerance=0, closed=closed)
    for forward in ((1, 1, 1), (-1, 0.2, 0.9), (0.1, -1, -1)):
        eye = Camera.look_at((0.2, 0.1, -0.1), forward, (0, 1, 0.1), (256, 200), fov_y=80)
        assert ibr.render(thing, eye).valid.all()


def test_the_border_of_another_surface_does_not_lead_on():
    """The two last columns are another surface; each surface is extrapolated by its own slope alone."""
    depth = np.full((9, 9), 4, np.float32)
    depth[:, 7:] = 2 + np.arange(2) * 0.1
    camera = Camera([[9, 0, 4], [0, 9, 4], [0, 0, 1]], (9, 9))
    view = ibr.DepthImage(np.zeros((9, 9, 3), np.uint8), depth, camera)
    frame = ibr.render(ibr.DepthMesh(view, tolerance=0), camera.resized((18, 18)))
    # At twice the resolution, the outermost pixels lie a quarter of a sample beyond the outermost samples. There 1/z is
    # extrapolated from 1/2 and 1/2.1.
    beyond = 1 / (1 / 2.1 + 0.25 * (1 / 2.1 - 1 / 2))
    np.testing.assert_allclose(frame.depth[:, -1], beyond, rtol=1e-3)
    np.testing.assert_allclose(frame.depth[:, 0], 4, rtol=1e-6)
