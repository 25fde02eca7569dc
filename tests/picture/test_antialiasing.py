"""Several samples per pixel: averages, and the smoothness of silhouettes."""

from __future__ import annotations

import numpy as np
import pytest

import pyibr as ibr
from pyibr.capture import models
from pyibr.images.metrics import psnr
from tests import scenes, truth

SIZE = (61, 47)
BACKGROUND = (40, 90, 160)


def beside(size: tuple[int, int] = SIZE) -> ibr.Camera:
    return ibr.Camera.look_at((2.2, 1.5, 1.8), (0, 0, 0), (0, 0, 1), size, fov_y=45)


def blocks(image: np.ndarray, side: int) -> np.ndarray:
    """Group the pixels of a finer picture to (H, W, samples, ...)."""
    height, width = (length // side for length in image.shape[:2])
    rest = image.shape[2:]
    apart = image.reshape(height, side, width, side, *rest).swapaxes(1, 2)
    return apart.reshape(height, width, side * side, *rest)


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
@pytest.mark.parametrize("samples", [4, 9])
def test_a_pixel_is_the_mean_of_its_samples(samples, projection):
    """Samples are the pixels of a finer picture. Colour and alpha are their means; depth lies in their range."""
    camera = beside()
    if projection == "orthographic":
        camera = ibr.Camera(
            [[20, 0, 30], [0, 20, 23], [0, 0, 1]], SIZE, camera.world_from_camera, projection=projection
        )
    side = round(samples**0.5)
    fine = ibr.render(models.donut(24), camera.resized((side * SIZE[0], side * SIZE[1])))
    frame = ibr.render(models.donut(24), camera, samples=samples)
    assert frame.alpha is not None
    np.testing.assert_allclose(frame.alpha, blocks(fine.valid, side).mean(axis=2), atol=1e-6)
    assert 0 < ((frame.alpha > 0) & (frame.alpha < 1)).mean() < 0.5
    np.testing.assert_array_equal(frame.valid, frame.alpha > 0)
    # 0.5 levels for rounding to bytes, 0.01 for float32.
    assert np.abs(frame.color - blocks(fine.color.astype(float), side).mean(axis=2)).max() <= 0.51
    seen = blocks(fine.depth, side)[frame.valid]
    depth = frame.depth[frame.valid]
    nearest, farthest = np.nanmin(seen, axis=1), np.nanmax(seen, axis=1)
    assert (depth >= nearest * (1 - 1e-6)).all()
    apart = farthest > 1.05 * nearest
    assert apart.any()
    assert (depth <= np.where(apart, 0.5 * (nearest + farthest), farthest) * (1 + 1e-6)).all()
    assert np.isnan(frame.depth[~frame.valid]).all()


def test_the_depth_of_a_plane_is_what_the_pixels_centre_sees():
    camera = ibr.Camera([[40, 0, 30], [0, 40, 23], [0, 0, 1]], SIZE)
    plane = ibr.Mesh([[-9, -9, 5], [9, -9, 6], [-9, 9, 5], [9, 9, 6]], [[0, 1, 2], [3, 2, 1]])
    one, four = ibr.render(plane, camera), ibr.render(plane, camera, samples=4)
    np.testing.assert_allclose(four.depth, one.depth, rtol=1e-5)


@pytest.mark.parametrize("dtype", [np.uint8, pytest.param(np.float32, marks=pytest.mark.thorough)])
def test_the_background_shows_by_what_is_not_covered(dtype):
    known = scenes.stepped(SIZE)
    grey = np.full((*SIZE[::-1], 3), 200 if dtype == np.uint8 else 0.8, dtype)
    scene = ibr.DepthImage(grey, known.depth, known.camera)
    background = np.array(BACKGROUND if dtype == np.uint8 else np.array(BACKGROUND) / 255)
    frame = ibr.render(scene, scene.camera.moved(0.1, 0, 0), None, background, samples=16)
    plain = ibr.render(scene, scene.camera.moved(0.1, 0, 0), samples=16)
    assert frame.alpha is not None
    expected = plain.color + (1 - frame.alpha[..., None]) * background
    assert frame.color.dtype == dtype
    np.testing.assert_allclose(frame.color, expected, atol=0.51 if dtype == np.uint8 else 1e-6)
    assert np.abs(frame.color[frame.alpha == 1] - scene.color[0, 0]).max() < 1e-6


def test_silhouettes_are_smoother_by_more_than_their_samples_ask_for():
    """Errors of coverage are proportional to the samples' spacing: 4 samples halve them (by 6 dB), 16 quarter them."""
    camera = beside((160, 120))
    frames = {n: ibr.render(models.donut(48), camera, None, BACKGROUND, samples=n) for n in (1, 4, 16, 64)}
    alpha = frames[64].alpha
    band = truth.dilate((alpha > 0) & (alpha < 1), 1)
    loss = {n: psnr(frame.color, frames[64].color, valid=band) for n, frame in frames.items() if n < 64}
    assert loss[4] >= loss[1] + 6
    assert loss[16] >= loss[1] + 12


@pytest.mark.parametrize("method", ["epipolar", "forward"])
def test_warps_have_samples_too(method):
    view = scenes.stepped(SIZE)
    camera = view.camera.moved(0.2, 0.05, 0.1)
    fine = ibr.warp(view, camera.resized((2 * SIZE[0], 2 * SIZE[1])), method=method)
    frame, own = ibr.warp([view], [camera, view.camera], method=method, samples=4)
    assert frame.alpha is not None
    assert own.color.shape == frame.color.shape == view.color.shape
    np.testing.assert_array_equal(frame.alpha, blocks(fine.valid, 2).mean(axis=2))
    assert np.abs(frame.color - blocks(fine.color.astype(float), 2).mean(axis=2)).max() <= 0.51
    into = ibr.Frame(np.empty_like(frame.color), np.empty_like(frame.depth), np.empty_like(frame.valid), camera)
    out = ibr.warp(view, camera, method=method, samples=4, out=into)
    np.testing.assert_array_equal(into.color, frame.color)
    np.testing.assert_array_equal(into.depth, frame.depth)
    np.testing.assert_array_equal(out.alpha, frame.alpha)


@pytest.mark.parametrize(("samples", "fill"), [(4, "smooth"), (36, "background")])
def test_what_was_seen_stays_as_it_was_seen_where_holes_are_filled(samples, fill):
    view = scenes.stepped(SIZE)
    for camera in (view.camera.moved(0.4, 0, 0), view.camera.moved(0.3, 0.2, 0.1)):
        bare, frame = (ibr.warp(view, camera, fill=way, samples=samples) for way in (None, fill))
        np.testing.assert_array_equal(frame.valid, bare.valid)
        np.testing.assert_array_equal(frame.alpha, bare.alpha)
        np.testing.assert_array_equal(frame.depth[bare.valid], bare.depth[bare.valid])
        whole = bare.alpha == 1
        np.testing.assert_array_equal(frame.color[whole], bare.color[whole])
        assert np.isfinite(frame.depth).all()
        partly = bare.valid & ~whole
        assert partly.any()
        assert (~bare.valid).any()
        # Empty samples of a pixel are filled, too, so its colour is the mean of all samples.
        side = round(samples**0.5)
        fine = ibr.warp(view, camera.resized((side * SIZE[0], side * SIZE[1])), fill=fill)
        mean = blocks(fine.color.astype(float), side).mean(axis=2)
        assert np.abs(frame.color - mean).max() <= 0.51


def test_a_background_does_not_shine_through_filled_holes():
    view = scenes.stepped(SIZE)
    camera = view.camera.moved(0.2, 0, 0)
    thing = ibr.WarpedView(view, fill="background")
    around = (0, 0, 255)
    black, blue = (ibr.render(thing, camera, samples=4, background=color) for color in ((0, 0, 0), around))
    np.testing.assert_array_equal(black.color, blue.color)
    bare = ibr.render(ibr.WarpedView(view), camera, samples=4, background=around)
    assert (bare.color[~bare.valid] == around).all()


def test_through_a_lens():
    view = scenes.stepped(SIZE)
    lens = ibr.Lens("brown_conrady", [-0.2, 0.02, 0.01, 0.0])
    camera = ibr.Camera(view.camera.K, SIZE, view.camera.moved(0.1, 0, 0).world_from_camera, lens=lens)
    fine = ibr.warp(view, camera.resized((2 * SIZE[0], 2 * SIZE[1])))
    frame = ibr.warp(view, camera, samples=4)
    np.testing.assert_array_equal(frame.alpha, blocks(fine.valid, 2).mean(axis=2))


@pytest.mark.parametrize("samples", [0, 2, 100, 4.0, True, "4"])
def test_other_numbers_are_refused(samples):
    view = scenes.stepped(SIZE)
    for call in (ibr.warp, ibr.render):
        with pytest.raises(ibr.ArgumentError, match="samples: expected 1, 4, 9"):
            call(view, view.camera, samples=samples)


def test_what_several_samples_cannot_tell_is_refused():
    view = scenes.stepped(SIZE)
    for name in ("origins", "classes"):
        with pytest.raises(ibr.ArgumentError, match=f"{name}: expected False with several samples"):
            ibr.warp(view, view.camera, **{name: True}, samples=4)
    with pytest.raises(ibr.ArgumentError, match=r"samples: expected at most \d+ pixels"):
        ibr.warp(view, view.camera.resized((20_000, 20_000)), samples=64)
