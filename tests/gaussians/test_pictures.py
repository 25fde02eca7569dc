"""Gaussians in one picture with other things, and laws that their pictures obey."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import pyibr as ibr
from tests import scenes
from tests.exact import same_bits
from tests.gaussians.clouds import camera, cloud, shuffled
from tests.gaussians.test_reference import check
from tests.reference.gaussians import blended


def wall(z: float, slope: float = 0.0) -> ibr.Mesh:
    corners = [[-9, -9, z - 9 * slope], [9, -9, z + 9 * slope], [9, 9, z + 9 * slope], [-9, 9, z - 9 * slope]]
    return ibr.Mesh(corners, [[0, 2, 1], [0, 3, 2]], colors=np.tile(np.uint8([30, 200, 90]), (4, 1)))


def with_ties() -> ibr.Gaussians:
    """A cloud in which each mean occurs three times, with other shapes and colours."""
    one = cloud(400, 1)
    arrays = [np.concatenate([array] * 3) for array in (one.means, one.scales, one.rotations, one.opacities, one.sh)]
    rng = np.random.default_rng(3)
    arrays[3] = rng.random(len(arrays[3]))
    arrays[4] = rng.normal(0, 0.5, arrays[4].shape)
    return ibr.Gaussians(*arrays[:4], sh=arrays[4])


@pytest.mark.parametrize("thing", [cloud(3000, 2), with_ties()], ids=["cloud", "ties"])
def test_the_order_of_the_gaussians_changes_no_bit(thing, lanes):
    first = ibr.render(thing, camera())
    for other in (thing, shuffled(thing, 1), shuffled(thing, 2)):
        frame = ibr.render(other, camera())
        same_bits(first, frame)
        np.testing.assert_array_equal(first.alpha, frame.alpha)


def test_the_order_of_the_things_changes_no_bit():
    view = scenes.stepped((131, 97))
    twin = with_ties()
    things = [wall(4.3, 0.1), view, twin, ibr.Gaussians(twin.means, twin.scales, twin.rotations, twin.opacities,
                                                        colors=np.full((len(twin), 3), 0.9))]  # fmt: skip
    frames = [ibr.render(list(order), camera()) for order in itertools.permutations(things)]
    for frame in frames[1:]:
        same_bits(frames[0], frame)
    assert (frames[0].alpha == 1).all()


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_a_wall_through_a_cloud_hides_to_the_pixel(projection):
    things, view = [cloud(1500, seed=1), cloud(500, 1, seed=2)], camera(projection=projection)
    bare = ibr.render(wall(4.0, 0.12), view)
    frame = ibr.render([things[0], wall(4.0, 0.12), things[1]], view)
    check(frame, blended(things, view, bare.depth, bare.color / 255))
    assert frame.valid.all() and (frame.depth < bare.depth).mean() > 0.1
    free = ibr.render(things, view)
    behind = free.valid & (free.depth > 1.001 * bare.depth)  # medians behind the wall alone are hidden
    assert behind.any() and (frame.depth <= bare.depth).all()


def plane(count: int = 40000) -> tuple[ibr.Gaussians, np.ndarray, float]:
    """Flat Gaussians on a plane, its normal, and the product of the normal and a point of it."""
    rng = np.random.default_rng(0)
    normal, right = np.array([0.6, 0.3, -0.742]), np.array([0.0, 0.927, 0.375])
    normal /= np.linalg.norm(normal)
    right = np.cross(normal, right / np.linalg.norm(right))
    right /= np.linalg.norm(right)
    down = np.cross(normal, right)
    a, b = rng.uniform(-6, 6, (2, count))
    means = np.array([0, 0, 4.0]) + a[:, None] * right + b[:, None] * down
    trace = np.stack([right, down, normal], axis=1)
    w = 0.5 * np.sqrt(1 + np.trace(trace))
    odd = np.array([trace[2, 1] - trace[1, 2], trace[0, 2] - trace[2, 0], trace[1, 0] - trace[0, 1]])
    rotations = np.tile([w, *(odd / (4 * w))], (count, 1))
    scales = np.exp(rng.normal(np.log(0.09), 0.4, (count, 3))) * (1, 1, 0)
    made = ibr.Gaussians(means, scales, rotations, np.full(count, 0.8), colors=rng.random((count, 3)))
    return made, normal, float(normal @ [0, 0, 4.0])


def test_the_depth_of_a_slanted_plane_is_that_of_the_plane():
    thing, normal, offset = plane()
    view = ibr.Camera([[150, 0, 80], [0, 150, 60], [0, 0, 1]], (161, 121))
    frame = ibr.render(thing, view)
    y, x = np.mgrid[:121, :161]
    truth = offset / (np.stack([(x - 80) / 150, (y - 60) / 150, np.ones(x.shape)], axis=-1) @ normal)
    near = (truth > 0.5) & (truth < 7)
    assert near.mean() > 0.7 and frame.valid[near].all()
    error = np.abs(frame.depth / truth - 1)[near]
    assert (error < 1e-3).mean() > 0.99


def test_alpha_and_the_background():
    thing, view = cloud(150), camera()
    black, white = ibr.render(thing, view), ibr.render(thing, view, background=(255, 255, 255))
    assert ((black.alpha > 0) & ~black.valid).any() and (black.alpha == 0).any()
    rest = 255 * (1 - black.alpha[..., None])
    assert np.abs(white.color - np.minimum(black.color + rest, 255)).max() <= 1
    np.testing.assert_array_equal(black.valid, black.alpha >= 0.5)


def test_fills_come_before_gaussians():
    view = scenes.holed((131, 97))
    thing = cloud(60, size=0.1)
    holes = ibr.WarpedView(view, fill="background")
    filled = ibr.render(holes, view.camera)
    frame = ibr.render([thing, holes], view.camera)
    check(frame, blended([thing], view.camera, filled.depth, filled.color / 255), ~filled.valid)
    clear = (frame.alpha == 0) & ~filled.valid
    assert clear.any()
    np.testing.assert_array_equal(frame.color[clear], filled.color[clear])


@pytest.mark.parametrize("samples", [4, 9])
def test_samples_are_averaged(samples):
    things, view = [cloud(200), wall(4.5)], camera((61, 47))
    side = round(samples**0.5)
    for several in (things, things[:1]):
        fine = ibr.render(several, view.resized((side * 61, side * 47)))
        frame = ibr.render(several, view, samples=samples)
        blocks = fine.alpha.reshape(47, side, 61, side).mean(axis=(1, 3))
        np.testing.assert_allclose(frame.alpha, blocks, atol=1e-5)
        colors = fine.color.reshape(47, side, 61, side, 3).mean(axis=(1, 3))
        assert np.abs(frame.color - colors).max() <= 0.51


def test_a_lens_shows_the_same_cloud():
    straight = camera()
    bent = ibr.Camera(straight.K, straight.size, straight.world_from_camera, lens=ibr.Lens("brown_conrady", [0] * 4))
    one, other = (ibr.render([cloud(900), wall(4.5)], view) for view in (straight, bent))
    assert (np.abs(one.color.astype(int) - other.color).max(axis=2) <= 2).mean() > 0.95
    assert other.alpha.min() == 1
    assert np.abs(ibr.render(cloud(900), straight).alpha - ibr.render(cloud(900), bent).alpha).mean() < 0.01


def test_float_colors_and_light():
    view = scenes.smooth((131, 97))
    floats = ibr.DepthImage(view.color / np.float32(255), view.depth, view.camera)
    thing = cloud(300)
    one, other = ibr.render([view, thing], camera()), ibr.render([floats, thing], camera())
    assert other.color.dtype == np.float32 and np.abs(one.color / 255 - other.color).max() < 1.5 / 255
    light = ibr.Light(direction=(0, 0, 1), shadow_size=64)
    assert ibr.render([wall(9), thing], camera(), light).color.any()  # they cast no shadows
    alone, with_cloud = (ibr.render(some, camera(), light) for some in ([wall(9)], [wall(9), cloud(1, middle=-5)]))
    np.testing.assert_array_equal(alone.color, with_cloud.color)


def test_the_smallest_pictures_and_clouds():
    for size in ((1, 1), (2, 1), (1, 37), (17, 16)):
        frame = ibr.render(cloud(5, size=1.0), camera(size))
        assert frame.alpha.shape == size[::-1] and frame.alpha.max() > 0
    assert not ibr.render(cloud(9, middle=-6), camera()).alpha.any()  # all behind the camera
