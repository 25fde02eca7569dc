"""Several things in one picture."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest

import pyibr as ibr
from pyibr.camera import Camera
from tests import scenes

CAMERA = Camera([[60, 0, 40], [0, 60, 30], [0, 0, 1]], (81, 61))


def wall(z: float, half: float, color: tuple[int, int, int]) -> ibr.Mesh:
    corners = [[-half, -half, z], [half, -half, z], [half, half, z], [-half, half, z]]
    return ibr.Mesh(corners, [[0, 2, 1], [0, 3, 2]], colors=np.tile(np.array(color, np.uint8), (4, 1)))


def view(z: float, dtype: type = np.uint8) -> ibr.DepthImage:
    color = np.full((61, 81, 3), 90 if dtype == np.uint8 else 0.5, dtype)
    return ibr.DepthImage(color, np.full((61, 81), z, np.float32), CAMERA)


def relief() -> ibr.SlicedSurface:
    base = ibr.Mesh([[-1, -1, 4], [1, -1, 4], [1, 1, 4], [-1, 1, 4]], [[0, 2, 1], [0, 3, 2]], uv=np.eye(4)[:, :2])
    return ibr.SlicedSurface(base, np.full((4, 4), 0.8, np.float32), np.full((2, 2, 3), 30, np.uint8), 0.5)


def test_one_depth_buffer_for_all_in_any_order():
    things = [wall(3, 0.5, (255, 0, 0)), view(5), wall(2, 0.2, (0, 255, 0)), relief()]
    pictures = [ibr.render(order, CAMERA) for order in permutations(things)]
    for other in pictures[1:]:
        np.testing.assert_array_equal(pictures[0].color, other.color)
        np.testing.assert_allclose(pictures[0].depth, other.depth, rtol=1e-6)
    frame = pictures[0]
    assert tuple(frame.color[30, 40]) == (0, 255, 0)
    assert tuple(frame.color[30, 48]) == (255, 0, 0)
    assert tuple(frame.color[30, 53]) == (30, 30, 30)
    assert tuple(frame.color[2, 2]) == (90, 90, 90)
    np.testing.assert_allclose([frame.depth[30, 40], frame.depth[30, 48], frame.depth[2, 2]], [2, 3, 5], rtol=1e-6)


def test_a_depth_image_alone_is_the_warp():
    source = scenes.smooth((64, 48))
    target = source.camera.moved(0.2, 0.1, 0.1)
    a, b = ibr.render(source, target), ibr.warp(source, target)
    np.testing.assert_array_equal(a.color, b.color)
    np.testing.assert_array_equal(a.depth, b.depth)


def test_the_dtype_is_float_if_a_depth_images_is():
    assert ibr.render([view(5), wall(3, 0.5, (255, 0, 0))], CAMERA).color.dtype == np.uint8
    frame = ibr.render([view(5, np.float32), wall(3, 0.5, (255, 0, 0)), view(4)], CAMERA)
    assert frame.color.dtype == np.float32
    np.testing.assert_allclose(frame.color[30, 40], (1, 0, 0), atol=1e-6)
    np.testing.assert_allclose(frame.color[2, 2], 90 / 255, atol=1e-6)


def test_background():
    frame = ibr.render(wall(3, 0.5, (255, 0, 0)), CAMERA, background=(10, 20, 30))
    assert (frame.color[~frame.valid] == (10, 20, 30)).all()
    assert (frame.color[frame.valid] == (255, 0, 0)).all()
    assert np.isnan(frame.depth[~frame.valid]).all()


def test_nothing_in_view():
    frame = ibr.render([wall(-3, 1, (9, 9, 9)), wall(3, 0.5, (9, 9, 9))], CAMERA.moved(50, 0, 0))
    assert not frame.valid.any()
    assert (frame.color == 0).all()


BAD = [
    ("things", {"things": []}),
    ("things", {"things": 3}),
    ("things", {"things": [np.zeros((4, 4))]}),
    ("camera", {"camera": "front"}),
    ("light", {"light": (0, 0, 1)}),
    ("background", {"background": (0, 0)}),
    ("background", {"background": (0, 0, 300)}),
]


@pytest.mark.parametrize(("argument", "changes"), BAD)
def test_bad_input(argument, changes):
    with pytest.raises(ibr.ArgumentError, match=f"^{argument}: "):
        ibr.render(**{"things": wall(3, 1, (9, 9, 9)), "camera": CAMERA, **changes})
