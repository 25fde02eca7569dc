"""Stereo pairs: shifts between the eyes by the formula, layouts pixel by pixel, and Dubois' colours."""

from __future__ import annotations

import numpy as np
import pytest

import pyibr as ibr
from pyibr.capture.stereo import StereoRig, depth_range_of, joined

SIZE = 120, 22
NEAR, FAR = 2.0, 5.0
DEPTHS = 2.0, 3.2, 5.0
"""Depths of three planes, one below the other in 8, 8 and 6 rows of the image."""


def shift(z: float, divergence: float, convergence: float) -> float:
    """Column of a point at depth z in the left eye's picture minus its column in the right eye's, by the formula."""
    d = (1 / z - 1 / FAR) / (1 / NEAR - 1 / FAR)
    return divergence / 100 * SIZE[0] * (d - convergence)


def planes() -> ibr.DepthImage:
    """A view of three planes, whose colours encode columns."""
    depth = np.repeat(np.float32(DEPTHS), 8)[: SIZE[1], None] * np.ones(SIZE[0], np.float32)
    color = np.broadcast_to(np.arange(SIZE[0], dtype=np.float32)[:, None] / SIZE[0], (*SIZE[::-1], 3))
    return ibr.DepthImage(color.copy(), depth, ibr.Camera.from_fov(SIZE, fov_x=50))


@pytest.mark.parametrize("synthetic_view", ["both", "left", "right"])
@pytest.mark.parametrize(("divergence", "convergence"), [(2.0, 0.5), (7.3, 0.0), (5.0, 1.0)])
def test_points_shift_by_the_law(synthetic_view: str, divergence: float, convergence: float):
    pose = ibr.Camera.look_at((1, 2, 3), (0, 0, 1), (0, 1, 0), SIZE).world_from_camera
    camera = ibr.Camera([[150, 3, 66], [0, 140, 9], [0, 0, 1]], SIZE, pose)
    z = np.linspace(1, 9, 40)
    points = camera.unproject(np.column_stack([np.linspace(0, 119, 40), np.linspace(3, 17, 40)]), z)
    left, right = StereoRig(divergence, convergence, synthetic_view, (NEAR, FAR)).cameras(camera)
    at, at_left, at_right = (one.project(points)[0] for one in (camera, left, right))
    expected = np.array([shift(one, divergence, convergence) for one in z])
    np.testing.assert_allclose(at_left[:, 0] - at_right[:, 0], expected, atol=1e-9)
    np.testing.assert_allclose([at_left[:, 1], at_right[:, 1]], [at[:, 1]] * 2, atol=1e-9)
    there = {"both": (at_left + at_right) / 2, "left": at_right, "right": at_left}[synthetic_view]
    np.testing.assert_allclose(there, at, atol=1e-9)


def test_pictures_shift_by_the_law():
    """Colours, which encode columns and are interpolated, show the shifts to a tenth of a pixel."""
    picture = ibr.stereo(planes(), divergence=6, convergence=0.3, depth_range=(NEAR, FAR), fill=None)
    for eye, side in ((picture[:, : SIZE[0]], 0.5), (picture[:, SIZE[0] :], -0.5)):
        for number, z in enumerate(DEPTHS):
            inner = slice(20, 100)  # columns away from the picture's borders
            from_column = eye[8 * number + 3, inner, 0] * SIZE[0]
            moved = np.arange(SIZE[0])[inner] - from_column
            np.testing.assert_allclose(moved, side * shift(z, 6, 0.3), atol=0.1)


def test_an_eye_at_the_camera_sees_its_picture():
    view = planes()
    left = ibr.stereo(view, synthetic_view="right", divergence=4)[:, : SIZE[0]]
    np.testing.assert_array_equal(left, view.color)


def test_depth_alone_is_white():
    view = planes()
    picture = ibr.stereo(ibr.DepthImage(None, view.depth, view.camera))
    assert picture.shape == (SIZE[1], 2 * SIZE[0], 3) and (picture == 255).all()


def test_the_range_of_depth_leaves_out_what_is_far_out():
    """The nearest and the farthest 1 % of the samples do not count."""
    near = np.concatenate([np.linspace(0.2, 0.5, 981), np.full(10, 9), np.full(10, 1e-3)])
    np.testing.assert_allclose(depth_range_of((1 / near).astype(np.float32)), (2, 5), rtol=1e-5)


def test_layouts():
    left, right = np.random.default_rng(1).integers(0, 256, (2, 5, 7, 3), dtype=np.uint8)
    pair = [left, right]
    np.testing.assert_array_equal(joined(pair, "full-sbs"), np.hstack(pair))
    np.testing.assert_array_equal(joined(pair, "full-tb"), np.vstack(pair))
    mean = [(one[:, 0:6:2].astype(float) + one[:, 1:6:2]) / 2 for one in pair]
    np.testing.assert_allclose(joined(pair, "half-sbs"), np.hstack(mean), atol=0.5)
    mean = [(one[0:4:2].astype(float) + one[1:4:2]) / 2 for one in pair]
    np.testing.assert_allclose(joined(pair, "half-tb"), np.vstack(mean), atol=0.5)
    luma = [one @ [0.299, 0.587, 0.114] for one in pair]
    np.testing.assert_allclose(joined(pair, "gray"), np.dstack([luma[0], luma[1], luma[1]]), atol=0.5 + 1e-3)


def test_colours_of_dubois():
    """Pure colours for one eye are multiplied by Dubois' matrices in linear light, with the sRGB curve."""
    black = np.zeros((1, 1, 3), np.uint8)
    for side, eye, light in (
        (0, (255, 0, 0), (0.437, 0, 0)),
        (0, (0, 255, 0), (0.449, 0, 0)),
        (1, (255, 0, 0), (0, 0.377, 0)),
        (1, (0, 255, 0), (0, 0.761, 0)),
        (1, (0, 0, 255), (0, 0.009, 1)),
    ):
        pair = [black, black]
        pair[side] = np.uint8([[eye]])
        shown = [255 * (12.92 * v if v <= 0.0031308 else 1.055 * v ** (1 / 2.4) - 0.055) for v in light]
        np.testing.assert_allclose(joined(pair, "dubois")[0, 0], shown, atol=0.51)


def test_mistakes_are_told():
    view = planes()
    for how, word in (
        ({"layout": "sbs"}, "layout"),
        ({"divergence": -1}, "divergence"),
        ({"convergence": 1.5}, "convergence"),
        ({"synthetic_view": "none"}, "synthetic_view"),
        ({"depth_range": (3, 2)}, "depth_range"),
    ):
        with pytest.raises(ibr.ArgumentError, match=word):
            ibr.stereo(view, **how)
    plate = ibr.Mesh([[0, 0, 1], [1, 0, 1], [0, 1, 1]], [[0, 1, 2]])
    with pytest.raises(ibr.ArgumentError, match="camera"):
        ibr.stereo(plate)
    flat = ibr.Camera(view.camera.K, SIZE, projection="orthographic")
    with pytest.raises(ibr.ArgumentError, match="perspective"):
        ibr.stereo(view, flat)
