"""Features of depth images: carried over as colours are, for any number of channels, and back by the transposed map."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import pyibr as ibr
from pyibr.warp.warp import warp_transposed
from tests.one_lane import both_forms

SIZE = (163, 121)
CAMERA = ibr.Camera([[140, 0, 80.3], [0, 143, 60.1], [0, 0, 1]], SIZE)
ORTHOGRAPHIC = ibr.Camera([[38, 0, 80.3], [0, 40, 60.1], [0, 0, 1]], SIZE, projection="orthographic")
MOVES = {
    "none": (0, 0, 0),
    "sideways": (0.21, 0, 0),
    "down": (0, 0.17, 0),
    "forward": (0.1, 0.05, 0.4),
    "back": (0, 0, -0.4),
}


def depth(seed: int = 0) -> NDArray[np.float32]:
    """A wavy wall, a disk in front of it, and single missing samples."""
    rng, (x, y) = np.random.default_rng(seed), np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    made = 3 + 0.4 * np.sin(x / 15) * np.cos(y / 11) - 1.1 * (np.hypot(x - 80, y - 60) < 23)
    return np.where(rng.random(made.shape) < 0.003, np.nan, made).astype(np.float32)


def noise(channels: int = 3, seed: int = 1) -> NDArray[np.float32]:
    return np.random.default_rng(seed).random((SIZE[1], SIZE[0], channels), np.float32)


def view(features: NDArray[Any], camera: ibr.Camera = CAMERA, **how: Any) -> ibr.DepthImage:
    return ibr.DepthImage(None, depth(), camera, features=features, **how)


@pytest.mark.parametrize("interpolation", ["linear", "nearest"])
@pytest.mark.parametrize("edges", ["cut", "connect"])
@pytest.mark.parametrize("move", MOVES)
@pytest.mark.parametrize("camera", [CAMERA, ORTHOGRAPHIC], ids=["perspective", "orthographic"])
def test_features_are_those_of_the_samples_that_colours_come_from(camera, move, edges, interpolation, lanes):
    colors = noise()
    source = ibr.DepthImage(colors, depth(), camera, features=colors)
    frame = ibr.warp(source, camera.moved(*MOVES[move]), edges=edges, interpolation=interpolation)
    assert frame.valid.mean() > 0.5
    apart = np.abs(frame.features - frame.color).max(axis=2)
    # On a diagonal between an open and a closed triangle, rounding decides to which a pixel belongs.
    assert (apart > 1e-3).mean() < 2e-4
    assert not frame.features[~frame.valid].any()


@pytest.mark.parametrize("how", [{"thin": True}, {"method": "search"}, {"side": "both"}])
def test_options_carry_features(how):
    colors = noise()
    frame = ibr.warp(ibr.DepthImage(colors, depth(), CAMERA, features=colors), CAMERA.moved(0.2, 0.1, 0), **how)
    assert (np.abs(frame.features - frame.color).max(axis=2) > 1e-3).mean() < 1e-3


def test_features_stay_on_their_side_of_an_edge():
    """A disk of features 1 in front of a wall of 0: no mixture, but `cv2.remap` by `Frame.source` mixes them."""
    import cv2

    is_disk = depth() < 2.4
    frame = ibr.warp(view(is_disk[..., None].astype(np.float32)), CAMERA.moved(0.2, 0.05, 0))
    seen = frame.depth < 2.4
    np.testing.assert_array_equal(frame.features[frame.valid, 0], seen[frame.valid])
    where = np.nan_to_num(frame.source)
    mixed = cv2.remap(is_disk.astype(np.float32), where[..., 0], where[..., 1], cv2.INTER_LINEAR)
    assert (np.abs(mixed - seen)[frame.valid] > 8 / 255).sum() > 100  # the rim has 145 pixels


@pytest.mark.parametrize("channels", [1, 2, 15, 16, 17, 33, 1024])
@pytest.mark.parametrize("dtype", [np.uint8, np.float16, np.float32])
def test_any_number_of_channels_of_each_type(dtype, channels, lanes):
    made = (200 * noise(channels)).astype(dtype)
    frame, exact = (ibr.warp(view(one), CAMERA.moved(0.2, 0.1, 0.1)) for one in (made, made.astype(np.float32)))
    assert frame.features.dtype == dtype and frame.features.shape == (SIZE[1], SIZE[0], channels)
    step = {np.uint8: 0.5, np.float16: 2.0**-4, np.float32: 0.0}[dtype]  # half a step of values below 256
    assert np.abs(frame.features.astype(np.float32) - exact.features).max() <= step + 1e-4 * bool(step)


def test_values_of_any_range_and_labels():
    values = noise(4) * np.float32([1e30, -1e30, 1, 1])
    values[..., 2], values[..., 3] = np.inf, np.nan
    frame = ibr.warp(view(values), CAMERA.moved(0.2, 0.1, 0.1))
    found = frame.features[frame.valid]
    assert found[:, 0].min() >= 0 and found[:, 0].max() > 9e29 and found[:, 1].min() < -9e29
    assert np.isposinf(found[:, 2]).all() and np.isnan(found[:, 3]).all()
    labels = np.random.default_rng(3).choice(np.array([3, 90, 200], np.uint8), (SIZE[1], SIZE[0], 1))
    frame = ibr.warp(view(labels), CAMERA.moved(0.2, 0.1, 0.1), interpolation="nearest")
    assert set(np.unique(frame.features[frame.valid])) == {3, 90, 200}


def test_lenses_carry_features():
    lens = ibr.Camera(CAMERA.K, SIZE, lens=ibr.Lens("brown_conrady", [-0.1, 0.01, 0, 0]))
    ramp = np.dstack([*np.mgrid[: SIZE[1], : SIZE[0]], np.zeros(SIZE[::-1]), np.ones(SIZE[::-1])]).astype(np.float32)
    frame = ibr.warp(view(ramp, lens), CAMERA.moved(0.1, 0, 0))
    apart = np.abs(frame.features[..., 1::-1] - frame.source).max(axis=2)
    # Features are constant beyond the outermost samples, whose pixels are 3 % of the picture, and change at the disk.
    assert (apart[frame.valid] > 0.02).mean() < 0.05
    np.testing.assert_allclose(frame.features[frame.valid][:, 2:], [[0, 1]] * frame.valid.sum(), atol=1e-6)
    through = ibr.warp(view(ramp), ibr.Camera(CAMERA.K, SIZE, lens=lens.lens).moved(0.1, 0, 0))
    apart = np.abs(through.features[..., 1::-1] - through.source).max(axis=2)
    assert (apart[through.valid] > 0.02).mean() < 0.05


def test_several_views_give_the_features_of_the_view_of_greatest_weight():
    cameras = {7: CAMERA, 9: CAMERA.moved(0.4, 0, 0)}
    left, right = (view(np.full((SIZE[1], SIZE[0], 2), value, np.float32), camera) for value, camera in cameras.items())
    for blend in ("quality", "nearest"):
        frame = ibr.warp([left, right], CAMERA.moved(0.2, 0, 0), blend=blend)
        assert {0, 1} <= set(np.unique(frame.view))
        np.testing.assert_array_equal(frame.features[..., 1], np.choose(frame.view + 1, [0, 7, 9]))


def test_features_survive_copies_and_other_calls():
    made = noise(5)
    source = ibr.DepthImage((255 * noise()).astype(np.uint8), depth(), CAMERA, features=made)
    assert (pickle.loads(pickle.dumps(source)).features == made).all()
    assert source.in_float.features is not None and not source.features.flags.writeable
    assert ibr.render(source, CAMERA).features is None
    moved = CAMERA.moved(0.1, 0, 0)
    one, two = ibr.warp(source, moved), ibr.warp(source, [CAMERA, moved], fill="background")
    np.testing.assert_array_equal(one.features, two[1].features)
    arrays = (np.empty_like(array) for array in (one.color, one.depth, one.valid))
    out = ibr.Frame(*arrays, moved, features=np.empty_like(one.features))
    assert ibr.warp(source, moved, out=out).features is out.features
    np.testing.assert_array_equal(out.features, one.features)


def test_guessed_layers_need_no_features():
    source = ibr.DepthImage((255 * noise()).astype(np.uint8), depth(), CAMERA, features=noise(5))
    target = CAMERA.moved(0.2, 0, 0)
    alone, both = ibr.warp(source, target), ibr.warp([source, ibr.background_layer(source, target)], target)
    np.testing.assert_array_equal(both.features, alone.features)
    out = ibr.Frame(*(np.empty_like(one) for one in (both.color, both.depth, both.valid)), target, features=noise(5))
    plain = ibr.DepthImage(source.color, source.depth, CAMERA)
    assert ibr.warp(plain, target, out=out).features is None


def test_bad_features_are_named():
    wrong = [noise()[..., 0], noise()[:-1], noise(0), np.zeros((SIZE[1], SIZE[0], 1025), np.uint8), noise().astype(int)]
    for features in (*wrong, "features"):
        with pytest.raises(ibr.ArgumentError, match="features: expected uint8, float16 or float32 of shape"):
            view(features)
    with pytest.raises(ibr.ArgumentError, match="views: expected features of one dtype"):
        ibr.warp([view(noise(3)), view(noise(4))], CAMERA)
    with pytest.raises(ibr.ArgumentError, match="samples"):
        ibr.warp(view(noise()), CAMERA, samples=4)
    with pytest.raises(ibr.ArgumentError, match="method"):
        ibr.warp(view(noise()), CAMERA, method="forward")
    frame = ibr.warp(view(noise()), CAMERA)
    out = ibr.Frame(frame.color, frame.depth, frame.valid, CAMERA, features=np.zeros((SIZE[1], SIZE[0], 4), np.float32))
    with pytest.raises(ibr.ArgumentError, match=r"out\.features"):
        ibr.warp(view(noise()), CAMERA, out=out)


@pytest.mark.parametrize("channels", [1, 5, 16, 35])
@pytest.mark.parametrize("move", MOVES)
def test_the_transposed_map_is_the_transposed_map(move, channels, lanes):
    """<A x, y> = <x, A' y>, in float64, within the rounding of float32."""
    values, camera = noise(channels) - np.float32(0.5), CAMERA.moved(*MOVES[move])
    frame = ibr.warp(view(values), camera)
    gradient = noise(channels, 2) - np.float32(0.5)
    back = warp_transposed(view(values), camera, gradient)
    assert back.shape == values.shape
    forward = np.einsum("yxc,yxc->c", frame.features, gradient, dtype=np.float64)
    backward = np.einsum("yxc,yxc->c", values, back, dtype=np.float64)
    scale = np.einsum("yxc,yxc->c", np.abs(frame.features), np.abs(gradient), dtype=np.float64)
    assert (np.abs(forward - backward) <= 1e-5 * scale).all()
    np.testing.assert_array_equal(back, warp_transposed(view(values), camera, gradient))


def test_both_forms_add_in_the_same_order():
    wide, narrow = both_forms(lambda: warp_transposed(view(noise(3)), CAMERA.moved(0.2, 0.1, 0.1), noise(3, 2)))
    np.testing.assert_allclose(wide, narrow, rtol=1e-4, atol=1e-4)
