"""Texture continued into holes by patches of the same surface."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest

import pyibr as ibr
from pyibr.images import metrics
from pyibr.warp.exemplar import continue_texture
from pyibr.warp.filling import push_and_pull
from tests.one_lane import one_lane, skip_where_unused
from tests.warp.test_fill import DTYPES, MASKS, images, target_of
from tests.warp.test_real_data import PAIRED, pair

CAMERA = ibr.Camera([[100, 0, 74.5], [0, 100, 48], [0, 0, 1]], (150, 97))
ASIDE = CAMERA.moved(0.4, 0, 0)  # the wall shifts by 10 pixels, the card by 20
LANES = pytest.mark.parametrize("lanes", [16, pytest.param(1, marks=pytest.mark.thorough)])


def wallpaper(shift: int) -> np.ndarray:
    """Slanted green and blue stripes of a wall, seen by a camera that is moved by so many of the wall's pixels."""
    y, x = np.mgrid[:97, shift : 150 + shift]
    return np.where(((x + y // 2) % 12 < 5)[..., None], (30, 160, 60), (40, 90, 200)).astype(np.uint8)


def behind_card(wall: np.ndarray) -> ibr.DepthImage:
    """A red card in front of a wall."""
    depth, color = np.full((97, 150), 4.0, np.float32), wall.copy()
    depth[30:70, 60:95] = 2
    color[depth == 2] = np.array((220, 40, 30)) / (1 if wall.dtype == np.uint8 else 255)
    return ibr.DepthImage(color, depth, CAMERA)


@LANES
@pytest.mark.parametrize("dtype", DTYPES)
def test_stripes_are_continued_and_nothing_of_the_foreground(dtype, lanes):
    skip_where_unused(lanes)
    scale = 1 if dtype == np.uint8 else np.float32(255)
    wall, truth = ((wallpaper(shift) / scale).astype(dtype) for shift in (0, 10))
    with one_lane() if lanes == 1 else nullcontext():
        fills = "background", "exemplar", "exemplar"
        before, after, again = (ibr.warp(behind_card(wall), ASIDE, fill=fill) for fill in fills)
    smear, error = (np.abs(f.color.astype(float) - truth)[~f.valid].mean() for f in (before, after))
    assert (~after.valid).sum() > 1000 and error < 0.1 * smear
    assert after.color[~after.valid][:, 0].max() * scale <= 60, "no red of the card"
    np.testing.assert_array_equal(after.color[after.valid], before.color[before.valid])
    np.testing.assert_array_equal(after.depth, before.depth)
    np.testing.assert_array_equal(again.color, after.color)


def test_patches_that_predict_nothing_stay_away():
    clutter = np.random.default_rng(3).integers(0, 256, (97, 150, 3)).astype(np.uint8)
    before, after = (ibr.warp(behind_card(clutter), ASIDE, fill=fill) for fill in ("background", "exemplar"))
    assert np.abs(after.color.astype(int) - before.color)[~after.valid].mean() < 6


def test_a_layer_continues_stripes():
    view, errors = behind_card(wallpaper(0)), []
    for fill in ("background", "exemplar"):
        layer = ibr.background_layer(view, ASIDE, fill=fill)
        x, y = (layer.camera.K[:2, 2] - CAMERA.K[:2, 2]).astype(int)
        here = np.s_[y : y + 97, x : x + 150]
        hidden = (layer.depth[here] > 3) & (view.depth == 2)
        errors.append(np.abs(layer.color[here].astype(int) - wallpaper(0))[hidden].mean())
    assert errors[1] < 0.25 * errors[0]


@LANES
@pytest.mark.parametrize("mask", MASKS)
@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_any_picture_is_filled_within_the_range_of_what_is_seen(projection, mask, lanes):
    skip_where_unused(lanes)
    for size, dtype in (((1, 1), np.uint8), ((7, 13), np.float32), ((60, 1), np.uint8), ((97, 75), np.float32)):
        color, depth, valid = images(size, mask, dtype)
        with one_lane() if lanes == 1 else nullcontext():
            target = target_of(color, depth, valid, projection)
            push_and_pull(target, None)
            continue_texture(target, lambda marked: push_and_pull(marked, None))
            made = target.color.to_host()
        np.testing.assert_array_equal(made[valid], color[valid])
        known = color[valid] if valid.any() else made
        assert known.min() - 1e-6 <= made.min() and made.max() <= known.max() + 1e-6


def flip_ratio(view: ibr.DepthImage, camera: ibr.Camera, truth: np.ndarray) -> float:
    """FLIP in the holes between surfaces, relative to the background fill's."""
    bare = ibr.warp(view, camera, classes=True)
    between = ~bare.valid & (bare.classes != ibr.PixelClass.OUTSIDE)
    frames = (ibr.warp(view, camera, fill=fill) for fill in ("background", "exemplar"))
    before, after = (metrics.flip(np.ascontiguousarray(truth), frame.color, valid=between) for frame in frames)
    return after / before


@pytest.mark.thorough
@pytest.mark.parametrize("name", PAIRED)
def test_clutter_is_hardly_farther_from_photographs(name):
    assert flip_ratio(*pair(name)) < 1.05


@pytest.mark.thorough
def test_a_rendered_room_is_closer_to_the_truth(monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "docs/gallery"))
    scene = pytest.importorskip("room", exc_type=ImportError)
    things, view = list(scene.room()), scene.photograph()
    for moved in ((0.25, -0.08, 0.1), (-0.25, -0.05, 0.1), (0.2, 0.1, 0.0)):
        camera = scene.CAMERA.moved(*moved)
        assert flip_ratio(view, camera, ibr.render(things, camera, scene.LIGHT, samples=4).color) < 0.85
