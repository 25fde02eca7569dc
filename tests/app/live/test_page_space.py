"""The page's camera sees what pyibr's camera sees, in scenes of any size and at any position."""

from __future__ import annotations

import numpy as np
import pytest

import pyibr as ibr
from pyibr.app.live.page_space import fov_of, page_space_around

SCENES = [((0, 0, 0), 1.0), ((4e5, -5e6, 300), 2.0), ((0, 0, 0), 1e-6), ((1, 2, 3), 1e7)]


@pytest.mark.parametrize(("middle", "size"), SCENES)
def test_a_camera_goes_to_the_page_and_back(middle, size):
    middle = np.array(middle, np.float64)
    page_space = page_space_around(middle - size, middle + size)
    camera = ibr.Camera.look_at(middle + size * np.array([3.0, -1, 2]), middle, (0.2, -1, 0), (61, 37), fov_y=33)
    wxyz, position = page_space.pose(camera)
    assert np.linalg.norm(position) < 20  # for any size of scene, the page's float32 and near plane suffice
    back = page_space.camera(np.float32(wxyz), np.float32(position), fov_of(camera), (61, 37))
    np.testing.assert_allclose(back.K, camera.K, rtol=1e-12)
    # The page's float32 has errors of 1e-7 of the distance, which is up to 20 times the scene's size.
    np.testing.assert_allclose(back.center, camera.center, atol=4e-6 * size, rtol=1e-15)
    np.testing.assert_allclose(back.world_from_camera[:3, :3], camera.world_from_camera[:3, :3], atol=1e-6)


def test_the_middle_of_the_picture_is_between_its_pixels():
    page_space = page_space_around(np.zeros(3), np.ones(3))
    camera = page_space.camera((1, 0, 0, 0), (0, 0, 0), np.pi / 2, (4, 2))
    ahead = camera.center + np.array([[0.0, 0, 1]])
    pixels, depth = camera.project(ahead)
    np.testing.assert_allclose(pixels, [[1.5, 0.5]])  # the middle of the page, if pixel centres are at integers
    top, _ = camera.project(camera.center + np.array([[0.0, -1, 1]]))  # 45 degrees up, at the picture's border
    np.testing.assert_allclose(top, [[1.5, -0.5]])
    assert depth[0] == pytest.approx(1.0)


def test_a_scene_without_extent_is_refused():
    for box in ((np.ones(3), np.ones(3)), (np.zeros(3), np.full(3, np.inf))):
        with pytest.raises(ibr.ArgumentError, match="some extent"):
            page_space_around(*box)
