"""Quilts: the order of their views, the positions of the cameras, and the cameras' pictures."""

from __future__ import annotations

import numpy as np
import pytest

import pyibr as ibr
from pyibr.capture.quilt import QuiltRig, suffix_of, tiled
from tests.capture.test_stereo import DEPTHS, SIZE, planes


def test_the_first_view_is_at_the_lower_left():
    views = [np.full((2, 3, 3), number, np.uint8) for number in range(6)]
    whole = tiled(views, (3, 2))
    assert whole.shape == (4, 9, 3)
    np.testing.assert_array_equal(whole[::2, ::3, 0], [[3, 4, 5], [0, 1, 2]])
    np.testing.assert_array_equal(whole[1::2, 2::3, 0], whole[::2, ::3, 0])


def test_cameras_are_equal_angles_apart_and_keep_the_focus():
    start = ibr.Camera.look_at((1, 2, 3), (0, 0, 1), (0, 1, 0), (40, 50))
    cameras = QuiltRig((4, 2), cone=24, focus=2.5).cameras(start)
    middle = start.center + 2.5 * start.forward
    ways = np.array([camera.center - middle for camera in cameras])
    aside = np.degrees(np.arctan2(ways @ start.world_from_camera[:3, 0], -ways @ start.forward))
    np.testing.assert_allclose(aside, np.linspace(-12, 12, 8), atol=1e-9)
    pixels = np.array([[0.0, 0.0], [39.0, 11.0], [20.0, 49.0]])
    on_plane = start.unproject(pixels, np.full(3, 2.5))
    for camera in cameras:
        np.testing.assert_allclose(camera.project(on_plane)[0], pixels, atol=1e-9)
        np.testing.assert_array_equal(camera.forward, start.forward)


def test_views_of_another_form_are_cut_out_of_the_middle():
    start = ibr.Camera([[100, 0, 79.5], [0, 100, 59.5], [0, 0, 1]], (160, 120))
    for width, focal, middle in ((90, 100, 44.5), (320, 200, 159.5)):
        (left, _) = QuiltRig((2, 1), (width, 120), focus=1, cone=1e-3).cameras(start)
        np.testing.assert_allclose(left.K, [[focal, 0, middle], [0, focal, 59.5], [0, 0, 1]], atol=1e-2)


def test_each_view_shows_what_its_camera_sees():
    """Colours encode columns, so that pictures show their move, f step (1 / z - 1 / focus).

    Views are arranged from left to right, and from the bottom row to the top row.
    """
    view, focus = planes(), 3.2
    whole = ibr.quilt(view, grid=(3, 2), cone=4, focus=focus, fill=None)
    assert whole.shape == (2 * SIZE[1], 3 * SIZE[0], 3)
    steps = focus * np.tan(np.radians(np.linspace(-2, 2, 6)))
    for number, step in enumerate(steps):
        row, column = divmod(number, 3)
        tile = whole[(1 - row) * SIZE[1] :, column * SIZE[0] :]
        for plane, z in enumerate(DEPTHS):
            inner = slice(20, 100)
            moved = np.arange(SIZE[0])[inner] - tile[8 * plane + 3, inner, 0] * SIZE[0]
            np.testing.assert_allclose(moved, view.camera.K[0, 0] * step * (1 / focus - 1 / z), atol=0.1)


def test_the_name_is_as_displays_know_it():
    assert suffix_of((8, 6), (420, 560)) == "_qs8x6a0.75"
    assert suffix_of((7, 7), (1920, 1080)) == "_qs7x7a1.778"


def test_meshes_need_a_camera_and_have_a_focus():
    plate = ibr.Mesh([[-9, -9, 4], [9, -9, 4], [-9, 9, 4], [9, 9, 4]], [[0, 1, 2], [3, 2, 1]])
    with pytest.raises(ibr.ArgumentError, match="camera"):
        ibr.quilt(plate)
    camera = ibr.Camera.from_fov((12, 9), fov_x=60)
    assert (ibr.quilt(plate, camera, grid=(2, 2)) > 0).all()


@pytest.mark.parametrize(
    ("how", "word"),
    [
        ({"grid": (1, 1)}, "grid"),
        ({"grid": (0, 3)}, "grid"),
        ({"cone": 0}, "cone"),
        ({"focus": -1}, "focus"),
        ({"size": (3,)}, "size"),
    ],
)
def test_mistakes_are_told(how: dict, word: str):
    with pytest.raises(ibr.ArgumentError, match=word):
        QuiltRig(**how)
