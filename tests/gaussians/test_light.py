"""Shadows that Gaussians cast, and shadows of opaque things on Gaussians."""

from __future__ import annotations

import numpy as np
import pytest

import pyibr as ibr
from tests.one_lane import one_lane

CAMERA = ibr.Camera.look_at((0, -3, 3), (0, 0, 0), (0, 0, 1), (161, 121), fov_y=45)
FLOOR = ibr.Mesh(
    [[-3, -3, 0], [3, -3, 0], [3, 3, 0], [-3, 3, 0]], [[0, 1, 2], [0, 2, 3]], colors=np.full((4, 3), 200, np.uint8)
)
SUN = ibr.Light(direction=(0, 0, -1), ambient=0.25, shadow_size=256)
LAMP = ibr.Light(position=(0, 0, 4), ambient=0.25, shadow_size=256)


def disc(radius: float, z: float) -> tuple[np.ndarray, np.ndarray]:
    """Points of a disc, 0.02 apart, and the outline where Gaussians of these points (`flat`) stop half of the light."""
    x, y = np.meshgrid(*[np.arange(-radius, radius, 0.02)] * 2)
    inside = np.hypot(x, y) <= radius
    angles = np.arange(64) / 32 * np.pi
    points = np.column_stack([x[inside], y[inside], np.full(inside.sum(), z)])
    reach = radius + np.sqrt(2 * np.log(2)) * 0.015
    return points, np.column_stack([reach * np.cos(angles), reach * np.sin(angles), np.full(64, z)])


def flat(points: np.ndarray, shade: float = 0.5, opacity: float = 1.0) -> ibr.Gaussians:
    count = len(points)
    shape = np.tile([0.015, 0.015, 0.0], (count, 1)), np.tile([1.0, 0, 0, 0], (count, 1)), np.full(count, opacity)
    return ibr.Gaussians(points, *shape, colors=np.full((count, 3), shade, np.float32))


@pytest.mark.parametrize("light", [SUN, LAMP])
@pytest.mark.parametrize("lanes", [16, 1])
def test_a_disc_of_gaussians_casts_the_shadow_of_a_disc(light: ibr.Light, lanes: int):
    points, corners = disc(0.5, 1.5)
    fan = ibr.Mesh(corners, [[0, i, i + 1] for i in range(1, 63)])
    below = ibr.Camera.look_at((0, -3, 1), (0, 0, 0), (0, 0, 1), (161, 121), fov_y=45)  # the disc is out of sight
    plain = ibr.render(FLOOR, below, light).color[..., 0]
    if lanes == 1:
        with one_lane():
            made = ibr.render([FLOOR, flat(points)], below, light).color[..., 0]
    else:
        made = ibr.render([FLOOR, flat(points)], below, light).color[..., 0]
    true = ibr.render([FLOOR, fan], below, light).color[..., 0]
    dark, right = made < 0.6 * plain, true < 0.6 * plain
    assert right.sum() > 500 and (dark & right).sum() / (dark | right).sum() > 0.95
    faint = ibr.render([FLOOR, flat(points, opacity=0.05)], below, light).color[..., 0]
    assert (faint == plain).mean() > 0.99  # less than half of the light is stopped


@pytest.mark.parametrize("light", [SUN, LAMP])
def test_opaque_things_darken_gaussians_and_clouds_do_not(light: ibr.Light):
    ground, high = flat(disc(1.0, 0.0)[0]), flat(disc(0.3, 1.0)[0], shade=0.9)
    lone, beside = (ibr.render(things, CAMERA).color for things in (ground, [ground, high]))
    np.testing.assert_array_equal(ibr.render([ground, high], CAMERA, light).color, beside)
    card = ibr.Mesh([[-0.3, -0.3, 2], [0.3, -0.3, 2], [0.3, 0.3, 2], [-0.3, 0.3, 2]], [[0, 1, 2], [0, 2, 3]])
    shaded = ibr.render([ground, card], CAMERA, light)
    on_ground = (shaded.depth > 3.5) & shaded.valid & (ibr.render(ground, CAMERA).alpha > 0.999)
    share = shaded.color[on_ground, 0] / lone[on_ground, 0]
    dark, bright = np.abs(share - 0.25) < 0.02, np.abs(share - 1) < 0.02
    assert dark.sum() > 100 and bright.sum() > 1000 and (dark | bright).mean() > 0.85


def test_stray_gaussians_change_no_shadow():
    points, _ = disc(0.5, 1.5)
    stray = np.concatenate([points, [[900, -400, 300], [-500, 200, 100]]])
    below = ibr.Camera.look_at((0, -3, 1), (0, 0, 0), (0, 0, 1), (161, 121), fov_y=45)
    near, far = (ibr.render([FLOOR, flat(some)], below, SUN).color.astype(int) for some in (points, stray))
    assert (np.abs(near - far) > 2).mean() < 0.01


def test_a_lights_kept_maps_know_the_clouds():
    """A light keeps its maps while the things stay the same."""
    points, _ = disc(0.5, 1.5)
    things, light = [FLOOR, flat(points)], ibr.Light(direction=(0, 0, -1), ambient=0.25, shadow_size=256)
    first, again = (ibr.render(things, CAMERA, light).color for _ in range(2))
    np.testing.assert_array_equal(first, again)
    without = ibr.render(FLOOR, CAMERA, light).color
    assert (without.astype(int) - first > 50).any()
