"""Gaussians in one picture with other things, and laws that their pictures obey."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import pyibr as ibr
from benchmarks.gaussians.twin import axes_of, blended
from pyibr.core.undistortion import rays_of
from pyibr.drawing import copy, upload
from tests import scenes
from tests.exact import same_bits
from tests.gaussians.clouds import camera, cloud, like, shuffled
from tests.gaussians.test_reference import check


def wall(z: float, slope: float = 0.0) -> ibr.Mesh:
    corners = [[-9, -9, z - 9 * slope], [9, -9, z + 9 * slope], [9, 9, z + 9 * slope], [-9, 9, z - 9 * slope]]
    return ibr.Mesh(corners, [[0, 2, 1], [0, 3, 2]], colors=np.tile(np.uint8([30, 200, 90]), (4, 1)))


def with_ties() -> ibr.Gaussians:
    """A cloud in which each mean occurs three times, with other opacities and colours."""
    rng, one = np.random.default_rng(3), cloud(400, 1)
    return like(one, np.tile(np.arange(400), 3), opacities=rng.random(1200), sh=rng.normal(0, 0.5, (1200, 4, 3)))


@pytest.mark.parametrize("thing", [cloud(3000, 2), with_ties()], ids=["cloud", "ties"])
def test_the_order_of_the_gaussians_changes_no_bit(thing, lanes):
    first = ibr.render(thing, camera())
    for other in (thing, shuffled(thing, 1), shuffled(thing, 2)):
        same_bits(first, ibr.render(other, camera()))


def test_the_order_of_the_things_changes_no_bit():
    view = scenes.stepped((131, 97))
    twin = with_ties()
    twins = [like(twin, **change) for change in ({"sh": 2 * twin.sh}, {"low_pass": 3}, {"near": 3.9})]
    for one in twins:
        same_bits(ibr.render([twin, one], camera()), ibr.render([one, twin], camera()))
    things = [wall(4.3, 0.1), view, twin, twins[0]]
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


def test_the_depth_of_a_slanted_plane_is_that_of_the_plane():
    """Beside it, Gaussians that are turned towards the camera have the depths of their centres."""
    rng, count, turn = np.random.default_rng(0), 40000, [np.cos(0.35), 0.6 * np.sin(0.35), 0.8 * np.sin(0.35), 0]
    means = np.append(rng.uniform(-8, 8, (count, 2)), np.full((count, 1), 4), axis=1)
    scales, rotations = np.exp(rng.normal(np.log(0.12), 0.4, (count, 3))) * (1, 1, 0), np.tile([1, 0, 0, 0], (count, 1))
    thing = ibr.Gaussians(means, scales, rotations, np.full(count, 0.8), colors=rng.random((count, 3)))
    pose = np.eye(4)
    pose[:3, :3] = axes_of(np.array([turn]))[0]
    view = ibr.Camera([[150, 0, 80], [0, 150, 60], [0, 0, 1]], (161, 121), pose)
    truth, frame, turned = (
        ibr.render(one, view) for one in (wall(4.0), thing, like(thing, rotations=0 * rotations + turn))
    )
    near = truth.depth < 7
    assert near.mean() > 0.7 and frame.valid[near].all()
    right, by_centres = (np.abs(one.depth / truth.depth - 1)[near] < 1e-3 for one in (frame, turned))
    assert right.mean() > 0.99 and by_centres.mean() < 0.2


def test_fills_and_the_background_come_before_gaussians():
    view, around = scenes.holed((131, 97)), (255, 250, 245)
    thing, holes = cloud(100, size=0.1), ibr.WarpedView(view, fill="background")
    for eye in (view.camera, camera().moved(1.5, 0, 0)):
        filled = ibr.render(holes, eye, background=around)
        frame = ibr.render([thing, holes], eye, background=around)
        expected = blended([thing], eye, filled.depth, filled.color / 255)
        check(frame, expected, ~filled.valid)
        assert np.abs(frame.color / 255 - expected[0]).max() <= 1 / 255
        np.testing.assert_array_equal(frame.color[frame.alpha == 0], filled.color[frame.alpha == 0])
    assert (np.isnan(filled.depth) & (frame.alpha > 0.5)).any() and (frame.alpha == 0).any()
    alone = ibr.render(thing, eye)
    assert ((alone.alpha > 0) & ~alone.valid).any()
    np.testing.assert_array_equal(alone.valid, alone.alpha >= 0.5)


@pytest.mark.parametrize("samples", [4, 9])
def test_samples_are_averaged(samples):
    things, view = [cloud(200), wall(4.5)], camera((61, 47))
    side = round(samples**0.5)
    for several in (things, things[:1]):
        fine = ibr.render([like(things[0], low_pass=0.3 * samples), *several[1:]], view.resized((side * 61, side * 47)))
        frame = ibr.render(several, view, samples=samples)
        blocks = fine.alpha.reshape(47, side, 61, side).mean(axis=(1, 3))
        np.testing.assert_allclose(frame.alpha, blocks, atol=1e-5)
        colors = fine.color.reshape(47, side, 61, side, 3).mean(axis=(1, 3))
        assert np.abs(frame.color - colors).max() <= 0.51
    dust = cloud(3000, size=0.004)
    assert ibr.render(dust, view, samples=samples).alpha.mean() > 0.9 * ibr.render(dust, view).alpha.mean()


def test_a_lens_shows_the_same_cloud():
    straight = camera()
    bent = ibr.Camera(straight.K, straight.size, straight.world_from_camera, lens=ibr.Lens("brown_conrady", [0] * 4))
    for things in ([cloud(900), wall(4.5)], [cloud(900)]):
        one, other = (ibr.render(things, view, background=(99, 0, 0)) for view in (straight, bent))
        assert (np.abs(one.color.astype(int) - other.color).max(axis=2) <= 2).mean() > 0.95
        assert np.abs(one.alpha - other.alpha).mean() < 0.01


@pytest.mark.parametrize("opacity", [0.45, 0.95])
def test_a_soft_gaussian_is_smooth_through_a_lens(opacity):
    K = [[100, 0, 65], [0, 100, 48], [0, 0, 1]]
    shape = [[0.6, 0.2, 3]], [[0.15] * 3], [[1, 0, 0, 0]], [opacity]
    thing = ibr.Gaussians(*shape, colors=[[1.0, 1, 1]], low_pass=0)
    frame = ibr.render(thing, ibr.Camera(K, (131, 97), lens=ibr.Lens("brown_conrady", [-0.2, 0, 0, 0])))
    u, v = np.moveaxis(100 * rays_of(frame.camera), 2, 0) - np.reshape([20, 20 / 3], (2, 1, 1))
    J = np.array([[100, 0, -20], [0, 100, -20 / 3]]) / 3
    (uu, uv), (_, vv) = np.linalg.inv(0.15**2 * J @ J.T)
    expected = opacity * np.exp(-0.5 * (uu * u * u + 2 * uv * u * v + vv * v * v))
    assert np.abs(frame.alpha - expected).max() < 0.01
    assert np.abs(frame.color / 255 - expected[..., None]).max() < 0.012


def test_the_faces_of_a_wide_lens_meet():
    """Two faces see the same rays at their border. The opacities of all faces stay in a fisheye's picture."""
    rng = np.random.default_rng(0)
    means = rng.normal(size=(6000, 3))
    means *= rng.uniform(2, 6, (6000, 1)) / np.linalg.norm(means, axis=1, keepdims=True)
    scales, rotations = 0.3 * np.exp(rng.normal(0, 0.6, (6000, 3))), rng.normal(size=(6000, 4))
    thing = ibr.Gaussians(means, scales, rotations, rng.uniform(0.02, 0.14, 6000), colors=rng.random((6000, 3)))
    K, pose = [[100, 0, 100], [0, 100, 100], [0, 0, 1]], np.eye(4)
    pose[:3, :3] = [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]
    front, side = ibr.render(thing, ibr.Camera(K, (201, 201))), ibr.render(thing, ibr.Camera(K, (201, 201), pose))
    steps = np.abs(front.color[:, -1].astype(int) - side.color[:, 0]).max(axis=1)
    assert np.percentile(steps, 95) <= 10  # 18 if each face sorted by its depth
    wide = ibr.Camera([[40, 0, 65], [0, 40, 65], [0, 0, 1]], (131, 131), lens=ibr.Lens("kannala_brandt", [0] * 4))
    frame = ibr.render(thing, wide)
    assert frame.valid.mean() > 0.1 and frame.alpha[frame.valid].min() > 0.4


def test_float_colors_and_light():
    view = scenes.smooth((131, 97))
    floats = ibr.DepthImage(view.color / np.float32(255), view.depth, view.camera)
    thing = cloud(300)
    one, other = ibr.render([view, thing], camera()), ibr.render([floats, thing], camera())
    assert other.color.dtype == np.float32 and np.abs(one.color / 255 - other.color).max() < 1.5 / 255
    light = ibr.Light(direction=(0.3, 0.2, 1), shadow_size=256)
    same_bits(ibr.render(thing, camera()), ibr.render(thing, camera(), light))


def test_several_kinds_of_blended_things():
    """Each kind is blended once, in the order of their first things, with the opacity of those before."""
    called = []

    class Veil:
        bounds = np.zeros((2, 3))

        def draw(self, target, lighting):
            pass

        @staticmethod
        def blend_together(things, target, lighting):
            called.append("veils")
            copy(upload(0.5 + 0.5 * target.alpha.to_host()), target.alpha)

    class Other(Veil):
        blend_together = staticmethod(lambda *_: called.append("others"))

    class Wrong(Veil):
        blend_together = print  # not static

    frame = ibr.render([Other(), Veil(), cloud(150), Veil()], camera())
    np.testing.assert_allclose(1 - frame.alpha, 0.5 - 0.5 * ibr.render(cloud(150), camera()).alpha, atol=1e-6)
    assert ibr.render([Veil(), wall(9), Other()], camera()).alpha.min() == 1
    assert called == ["others", "veils", "veils", "others"]
    with pytest.raises(ibr.ArgumentError, match="things: expected classes with a static method `blend_together`"):
        ibr.render(Wrong(), camera())


def test_a_very_wide_picture():
    """Its bins are numbered beyond 2^15."""
    wide, x = 600_000, np.array([0.0, 0.5, 0.99])
    means, rotations = np.stack([x, 0 * x, 0 * x + 1], axis=1), np.tile([1, 0, 0, 0], (3, 1))
    thing = ibr.Gaussians(means, np.full((3, 3), 1e-5), rotations, np.full(3, 0.9), colors=np.ones((3, 3)))
    frame = ibr.render(thing, ibr.Camera([[wide, 0, 0], [0, wide, 8], [0, 0, 1]], (wide, 17)))
    assert frame.alpha[8, np.int64(x * wide)].min() > 0.8


def test_the_smallest_pictures_and_clouds():
    for size in ((1, 1), (2, 1), (1, 37), (17, 16)):
        frame = ibr.render(cloud(5, size=1.0), camera(size))
        assert frame.alpha.shape == size[::-1] and frame.alpha.max() > 0
    assert not ibr.render(cloud(9, middle=-6), camera()).alpha.any()  # all behind the camera
