"""Depth images of Gaussians, and things made of them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import pyibr as ibr
from pyibr.capture import capture, object_views
from pyibr.capture.frusta import Frustum
from tests.gaussians.clouds import like


def ball(count: int = 8000, opacity: float = 0.95) -> ibr.Gaussians:
    """Flat Gaussians on a ball of radius 1, in two colours."""
    y = 1 - (2 * np.arange(count) + 1) / count
    turn = np.pi * (3 - np.sqrt(5)) * np.arange(count)
    means = np.column_stack([np.cos(turn) * np.sqrt(1 - y * y), y, np.sin(turn) * np.sqrt(1 - y * y)])
    half = np.column_stack([1 + means[:, 2], -means[:, 1], means[:, 0], np.zeros(count)])  # turns z to the normal
    colors = np.where(means[:, :1] > 0, [[0.9, 0.2, 0.1]], [[0.1, 0.3, 0.8]])
    scales = np.tile([0.03, 0.03, 1e-4], (count, 1))
    return ibr.Gaussians(means, scales, half, np.full(count, opacity), colors=colors.astype(np.float32))


def test_a_depth_image_shows_the_surface():
    camera = ibr.Camera.look_at((0, 0, 3), (0, 0, 0), (0, 1, 0), (121, 121), fov_y=40)
    view = capture(ball(), camera, background=(1, 2, 3))
    x, y = np.meshgrid(*[np.arange(121) - 60] * 2)
    r = np.hypot(x, y) / camera.K[0, 0]  # tangent of the angle to the axis
    b, square = 3 / (1 + r * r), (9 - 8 * (1 + r * r)) / (1 + r * r) ** 2
    truth = b - np.sqrt(np.maximum(square, 0))
    inside = square > 0.6  # not at the rim, where planes of flat Gaussians leave the ball
    assert view.valid[inside].all() and inside.mean() > 0.2 and np.abs(view.depth - truth)[inside].max() < 0.01
    assert (view.color[~view.valid] == (1, 2, 3)).all() and np.isinf(view.depth[~view.valid]).all()
    right = inside & (x > 10)  # three standard deviations from the other colour
    assert np.abs(view.color[right].astype(int) - (230, 51, 26)).max() <= 2  # not darkened by the black behind


def test_objects_are_made_of_gaussians():
    views = object_views(ball(), 128)
    camera = ibr.Camera.look_at((2, -3, 2), (0, 0, 0), (0, 0, 1), (101, 101), fov_y=40)
    rays = camera.unproject(np.argwhere(np.ones((101, 101)))[:, ::-1], np.ones(101 * 101)) - camera.center
    along = rays @ camera.center / np.linalg.norm(rays, axis=1)
    true = (camera.center @ camera.center - along**2 <= 1).reshape(101, 101)
    for thing in (ibr.DepthObject(views), ibr.DepthMeshObject(views)):
        made = ibr.render(thing, camera).valid
        assert (made & true).sum() / (made | true).sum() > 0.97


def test_frusta_see_gaussians():
    camera = ibr.Camera.look_at((0, 0, 3), (0, 0, 0), (0, 1, 0), (61, 61), fov_y=40)
    view = Frustum(camera).capture(ball())
    np.testing.assert_array_equal(view.depth, capture(ball(), camera).depth)


def test_mistakes():
    camera = ibr.Camera.look_at((0, 0, 3), (0, 0, 0), (0, 1, 0), (61, 61), fov_y=40)
    wrong: list[tuple[dict[str, Any], str]] = [
        ({"layer": "last"}, "layer: expected 'first' with Gaussians"),
        ({"normals": True}, "normals: expected False"),
        ({"background": (300, 0, 0)}, "background: expected .* 0 to 255"),
    ]
    for given, message in wrong:
        with pytest.raises(ibr.ArgumentError, match=message):
            capture(ball(100), camera, **given)
    faint = like(ball(100), opacities=np.full(100, 0.01))
    with pytest.raises(ibr.ArgumentError, match="camera: expected a camera that sees the Gaussians"):
        capture(faint, camera)
