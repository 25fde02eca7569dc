"""Depth meshes of images of any size: no part is lost, and planes take two triangles."""

from __future__ import annotations

import numpy as np
import pytest

import pyibr as ibr
from pyibr.core.camera import Camera
from pyibr.depthmesh import Segmentation
from tests import scenes
from tests.depthmesh.test_triangulation import vertical_error
from tests.depthmesh.views import PROJECTIONS, cells_of, check_crack_free, coverage, rough, samples_for

SIZES = [(513, 513), (512, 512), (640, 480), (514, 3), (1000, 37), (2, 2), (2, 5), (4, 7), (130, 257)]
WHOLE = Segmentation("none")


def plane(size: scenes.Size, projection: str, slope: tuple[float, float]) -> ibr.DepthImage:
    """View of a plane, about 1.5 to 4 away. The image is as wide as the depth (perspective) or 1 (orthographic)."""
    width, height = size
    camera = Camera([[width, 0, width / 2], [0, width, height / 2], [0, 0, 1]], size, projection=projection)
    y, x = np.mgrid[:height, :width]
    near = 0.45 + slope[0] * (x / width - 0.5) + slope[1] * (y / height - 0.5)
    depth = 1 / near if projection == "perspective" else 1.5 + 3 * near
    return ibr.DepthImage(np.zeros((height, width, 3), np.uint8), depth.astype(np.float32), camera)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("projection", PROJECTIONS)
def test_planes_take_two_triangles_and_lose_no_pixel(size, projection):
    """Walls and floors, from the view's camera, and from a camera inside the bounding spheres of their vertices."""
    for slope in ((0, 0), (0.2, 0.1), (-0.05, 0.35)):
        view = plane(size, projection, slope)
        thing = ibr.DepthMesh(view, segmentation=WHOLE)
        for camera in (view.camera, view.camera.moved(0.3, 0.1, 0.5)):
            assert len(thing.triangulate(camera, tolerance=1).faces) == 2
        assert len(thing.simplify(1e-4).faces) == 2
        whole = ibr.render(ibr.DepthMesh(view, tolerance=0, segmentation=WHOLE), view.camera)
        coarse = ibr.render(ibr.DepthMesh(view, tolerance=16, segmentation=WHOLE), view.camera)
        assert coarse.valid.all() and whole.valid.all()
        # Corners are extrapolated by half a pixel from samples one pixel apart, which amplifies roundings of 2^-24.
        np.testing.assert_allclose(coarse.depth, whole.depth, rtol=2**-16)


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_no_border_is_lost_at_any_tolerance(projection):
    """At any tolerance, a surface without holes is drawn up to the image's border."""
    for number, size in enumerate([(7, 13), (50, 33), (18, 64), (3, 2), (31, 30)]):
        thing = ibr.DepthMesh(rough(np.random.default_rng(number), size, projection, 0.02), segmentation=WHOLE)
        for tolerance in (0, 2, 16, 1e9):
            corners = samples_for(thing, thing.view.camera, tolerance)
            assert check_crack_free(corners, size).all()
            assert (coverage(corners, size) == 1).all()


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_rims_of_a_pixel_stay_at_the_border(projection):
    """The last two columns or rows are another surface, whose triangles are one cell wide."""
    for size in ((50, 33), (33, 50), (64, 64)):
        for axis in (0, 1):
            depth = np.full(size[::-1], 3, np.float32)
            depth[(slice(None),) * (1 - axis) + (slice(-2, None),)] = 2
            camera = Camera([[400, 0, 20], [0, 400, 20], [0, 0, 1]], size, projection=projection)
            thing = ibr.DepthMesh(ibr.DepthImage(np.zeros((*depth.shape, 3), np.uint8), depth, camera))
            drawn = cells_of(thing)
            assert drawn.sum() == 2 * (depth.size - sum(depth.shape) + 1) - 2 * (depth.shape[axis] - 1)
            for tolerance in (0, 1, 5):  # errors of partly drawn triangles are 4 * 2 samples
                np.testing.assert_array_equal(coverage(samples_for(thing, camera, tolerance), size), drawn)


def test_tolerances_hold_whatever_the_size():
    """Errors of a gently waved surface stay within the tolerance; they are measured as differences of depth."""
    for size in ((65, 65), (66, 66), (100, 37), (61, 120)):
        a, b = scenes.image_coordinates(size)
        depth = (4 + 0.03 * np.sin(9 * a) + 0.03 * np.cos(7 * b)).astype(np.float32)
        camera = Camera([[400, 0, size[0] / 2], [0, 400, size[1] / 2], [0, 0, 1]], size)
        view = ibr.DepthImage(np.zeros((*depth.shape, 3), np.uint8), depth, camera)
        for tolerance in (0.1, 0.5, 1):
            mesh = ibr.DepthMesh(view, segmentation=WHOLE).triangulate(camera, tolerance=tolerance)
            # Slopes are at most 1.7, so that depth differs by at most twice the distance between the surfaces.
            assert vertical_error(mesh, view) * 400 / depth.min() <= 2 * tolerance
            assert tolerance < 1 or len(mesh.faces) < 0.2 * depth.size
