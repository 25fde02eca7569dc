"""Pictures blended from several views: where views overlap, they are closer to the truth than one view's picture."""

from __future__ import annotations

import numpy as np
import pytest

import pyibr as ibr
from benchmarks import scenes as real
from pyibr.images import metrics
from pyibr.images.exposure import compared_colors
from tests import scenes
from tests.data import shared

SIZE = (61, 37)


def plane(depth: float, color: int, camera: ibr.Camera) -> ibr.DepthImage:
    shape = camera.height, camera.width
    return ibr.DepthImage(np.full((*shape, 3), color, np.uint8), np.full(shape, depth, np.float32), camera)


@pytest.mark.parametrize("method", ["epipolar", "search", "forward"])
@pytest.mark.usefixtures("lanes")
def test_one_view_given_twice_is_the_view(method):
    view = scenes.holed(SIZE)
    for pose in scenes.special_cameras(view, (53, 30))[:3]:
        once, twice = (ibr.warp(views, pose.camera, method=method) for views in (view, [view, view]))
        np.testing.assert_array_equal(once.valid, twice.valid)
        np.testing.assert_array_equal(once.color, twice.color)
        np.testing.assert_allclose(once.depth, twice.depth, rtol=1e-6)


@pytest.mark.usefixtures("lanes")
def test_what_is_hidden_shows_nowhere():
    camera = scenes.source_camera(SIZE)
    behind, before = plane(4.0, 50, camera.moved(0.1, 0, 0)), plane(2.0, 200, camera)
    depth = np.array(before.depth)
    depth[:, 30:] = np.nan
    before = ibr.DepthImage(before.color, depth, camera)
    frame = ibr.warp([behind, before], camera)
    left = np.s_[:, :29]
    assert (frame.color[left] == 200).all()
    np.testing.assert_allclose(frame.depth[left], 2.0, rtol=1e-5)
    assert (frame.color[:, 31:] == 50).all()
    told = ibr.warp([behind, before], camera, classes=True)
    assert told.view is not None and (told.view[left] == 1).all() and (told.view[:, 31:] == 0).all()


@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
def test_exposures_are_matched_to_the_one_in_the_middle(dtype):
    view = scenes.smooth((97, 61))
    color = view.color // 2 + 60
    if dtype == np.float32:
        color = (color / np.float32(255)).astype(np.float32)
    gains = (0.75, 1.0, 1.02)
    cameras = [view.camera, view.camera.moved(0.05, 0, 0), view.camera.moved(0, 0.05, 0)]
    made = [ibr.warp(ibr.DepthImage(color, view.depth, view.camera), camera, edges="connect") for camera in cameras]
    views = [
        ibr.DepthImage((frame.color * gain).astype(dtype), frame.depth, camera)
        for frame, camera, gain in zip(made, cameras, gains, strict=True)
    ]
    target = view.camera.moved(0.02, 0.02, 0)
    right, frame = ibr.warp(made_view(made[1]), target), ibr.warp(views, target)
    both = right.valid & frame.valid
    most = 255 if dtype == np.uint8 else 1
    off = np.abs(frame.color.astype(float) - right.color)[both] / most
    assert np.median(off) < 0.01 and off.mean() < 0.02, "from the middle exposure; the texture is resampled three times"
    unmatched = ibr.warp(views, target, blend="nearest")
    assert np.abs(unmatched.color.astype(float) - right.color)[both].mean() / most > 2 * off.mean()


def made_view(frame: ibr.Frame) -> ibr.DepthImage:
    return ibr.DepthImage(frame.color, frame.depth, frame.camera)


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
@pytest.mark.usefixtures("lanes")
def test_noise_becomes_less(projection):
    rng = np.random.default_rng(1)
    camera = scenes.source_camera((97, 61), projection)
    views = []
    for number in range(4):
        own = camera.moved(0.02 * number, 0, 0)
        depth = (3 + rng.normal(0, 0.01, (61, 97))).astype(np.float32)
        views.append(ibr.DepthImage(np.full((61, 97, 3), 100, np.uint8), depth, own))
    target = camera.moved(0.03, 0, 0)
    inside = np.s_[10:-10, 20:-20]
    off = {how: ibr.warp(views, target, blend=how).depth[inside] - 3 for how in ("quality", "nearest")}
    # The nearest of four noisy depths is one standard deviation too near on average. Their mean has half the noise.
    assert abs(off["quality"].mean()) < 0.25 * abs(off["nearest"].mean())
    assert off["quality"].std() < 0.75 * (ibr.warp(views[0], target).depth[inside] - 3).std()


def test_depth_alone_is_blended():
    view = scenes.holed(SIZE)
    alone = ibr.DepthImage(None, view.depth, view.camera, far=view.far)
    camera = view.camera.moved(0.1, 0, 0)
    other = view.camera.moved(0.3, 0.1, 0)
    second = ibr.warp(view, other)
    pair = [ibr.DepthImage(color, second.depth, other) for color in (second.color, None)]
    colored, plain = ibr.warp([view, pair[0]], camera), ibr.warp([alone, pair[1]], camera)
    np.testing.assert_array_equal(colored.depth, plain.depth)


@pytest.mark.thorough
@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_a_view_that_is_left_out_is_seen_better(noise):
    """Blending is over 0.5 dB better than the nearest view, and loses less than 0.5 dB if a view is 25 % darker."""
    shared("rgbd_livingroom1")
    size = (640, 480)
    views = [real.rgbd(real.LIVINGROOM, number, size, noise) for number in (0, 50)]
    seen = real.rgbd(real.LIVINGROOM, 4, size)
    hard, blended = (ibr.warp(views, seen.camera, blend=how, classes=True) for how in ("nearest", "quality"))
    where = hard.valid & blended.valid
    np.testing.assert_array_equal(hard.valid, blended.valid)
    changes = [np.count_nonzero(np.diff(frame.view, axis=1)) for frame in (hard, blended)]
    assert changes[1] < 0.7 * changes[0], "the shown view changes less from pixel to pixel"
    darker = ibr.DepthImage((views[1].color * 0.75).astype(np.uint8), views[1].depth, views[1].camera)
    three = [views[0], real.rgbd(real.LIVINGROOM, 0, size, noise), darker]
    frames = hard, blended, ibr.warp(three, seen.camera)
    nearest, best, with_darker = (metrics.psnr(frame.color, seen.color, valid=where) for frame in frames)
    assert best > nearest + 0.5 and with_darker > best - 0.5


def test_exposures_by_orthographic_depths_are_the_same_however_far_the_camera_is():
    """Two surfaces 0.6 apart are not matched as one, even for an orthographic target 1000 scene units farther back."""
    cameras = [scenes.source_camera((97, 61), "orthographic").moved(0.1 * k, 0, 0) for k in range(2)]
    texture = scenes.texture(*scenes.image_coordinates((97, 61))) // 2 + 60
    views = [
        ibr.DepthImage((texture * gain).astype(np.uint8), np.full((61, 97), depth, np.float32), camera)
        for camera, gain, depth in zip(cameras, (1.0, 0.6), (2.0, 2.6), strict=True)
    ]
    near, far = (ibr.warp(views, cameras[0].moved(0, 0, -back)).color.astype(int) for back in (0, 1000))
    assert np.abs(near - far).max() <= 1


def test_how_many_pixels_tell_exposures():
    """Some 200 shared pixels suffice to compare exposures. Nearly black or white ones, often clipped, do not count."""
    rng = np.random.default_rng(0)

    def told(count: int, dark: int = 0) -> float | None:
        colors = rng.uniform(0.2, 0.7, (count, 3))
        colors[:dark] = 0.01
        other = colors * 0.7
        other[:dark] = 0.9
        found = compared_colors(colors, other)
        return None if found is None else float(np.exp(found[0]).mean())

    assert told(100) is None and told(400, 250) is None
    assert told(400) == pytest.approx(1 / 0.7) and told(900, 500) == pytest.approx(1 / 0.7)


def test_layers_closer_than_noise_explains_are_one_surface():
    camera = scenes.source_camera(SIZE)
    for apart, is_one in ((1.01, True), (1.1, False)):
        frame = ibr.warp([plane(3.0, 100, camera), plane(3.0 * apart, 100, camera)], camera)
        assert (np.median(frame.depth) > 3.001) == is_one
