"""Layers of guessed background: which samples they hold, and how they appear in new views."""

from __future__ import annotations

import pickle
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

import pyibr as ibr
from pyibr.capture import sets
from pyibr.core.camera import Camera
from tests.data import shared
from tests.one_lane import one_lane

GALLERY = Path(__file__).parents[2] / "docs/gallery"
SIZE = 120, 90
FOCAL = 100.0
WALL, CARD = 4.0, 2.0
CAMERA = Camera([[FOCAL, 0, 60], [0, FOCAL, 45], [0, 0, 1]], SIZE)
ASIDE = [CAMERA.moved(0.04 * k, 0, 0) for k in range(1, 6)]  # the card is shifted by 10 pixels, the wall by 5


def card(projection: str = "perspective", dtype: type = np.uint8, colored: bool = True) -> ibr.DepthImage:
    """A red card in front of a blue wall with vertical stripes."""
    depth = np.full(SIZE[::-1], WALL, np.float32)
    depth[30:60, 40:80] = CARD
    color = np.zeros((*SIZE[::-1], 3), np.uint8)
    color[..., 2] = 100 + 100 * (np.arange(SIZE[0]) // 6 % 2)
    color[30:60, 40:80] = (250, 0, 0)
    K = CAMERA.K if projection == "perspective" else [[25, 0, 60], [0, 25, 45], [0, 0, 1]]
    shown = color if dtype == np.uint8 else (color / 255).astype(np.float32)
    return ibr.DepthImage(shown if colored else None, depth, Camera(K, SIZE, projection=projection))


def flicker(frames: Sequence[ibr.Frame], cameras: Sequence[Camera]) -> float:
    """Mean change of guessed colours from frame to frame, aligned by their depth."""
    total = count = 0.0
    for here, there, before, after in zip(cameras, cameras[1:], frames, frames[1:], strict=False):
        depth = np.where(before.valid, np.float32(np.nan), before.depth)
        moved = ibr.warp(ibr.DepthImage(before.color, depth, here, noise=0.0), there)
        both = moved.valid & ~after.valid
        total += float(np.abs(moved.color[both].astype(float) - after.color[both]).sum())
        count += both.sum()
    return total / count


def test_a_layer_holds_the_wall_that_the_cameras_uncover():
    """A camera to the right sees 5 columns of the wall that lie behind the card's right side."""
    layer = ibr.background_layer(card(), ASIDE)
    x, y = np.rint(layer.camera.K[:2, 2] - CAMERA.K[:2, 2]).astype(int)
    assert layer.guessed
    assert layer.camera.width - SIZE[0] in (11, 12) and layer.camera.height - SIZE[1] == 2  # beyond the right border
    known = np.isfinite(layer.depth)[y : y + SIZE[1], x : x + SIZE[0]]
    assert known[40, 75:80].all() and not known[40, 41:73].any()  # between them lies the rim
    assert not known[5:25, 5:110].any()
    np.testing.assert_allclose(layer.depth[y + 40, x + 75 : x + 80], WALL, rtol=0.05)
    assert layer.color[y + 40, x + 78, 0] < 60  # little of the card's red


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
@pytest.mark.parametrize("lanes", [16, 1])
def test_no_hole_is_left_and_seen_pixels_stay(projection: str, lanes: int):
    view = card(projection)
    path = ASIDE if projection == "perspective" else [view.camera.orbited(2.0 * k, (0, 0, 3)) for k in range(1, 5)]
    with one_lane() if lanes == 1 else pytest.MonkeyPatch.context():
        layer = ibr.background_layer(view, path)
        for alone, both in zip(ibr.warp(view, path), ibr.warp([view, layer], path), strict=True):
            np.testing.assert_array_equal(both.valid, alone.valid)
            np.testing.assert_array_equal(both.color[both.valid], alone.color[both.valid])
            assert not both.valid.all() and np.isfinite(both.depth).all()
            assert (both.color[~both.valid, 2] > 80).mean() > 0.9  # the wall's colour


@pytest.mark.parametrize(
    "options",
    [{"method": "search"}, {"method": "forward"}, {"thin": True}, {"interpolation": "nearest"}, {"edges": "connect"}],
    ids=str,
)
def test_all_ways_to_draw_a_view_draw_the_same_guesses(options: dict):
    view, aside = card(), ASIDE[-1]
    layer = ibr.background_layer(view, ASIDE)
    frame, usual = ibr.warp([layer, view], aside, **options), ibr.warp([view, layer], aside)
    both = ~frame.valid & ~usual.valid
    np.testing.assert_array_equal(frame.color[both], usual.color[both])
    np.testing.assert_array_equal(ibr.warp([view, layer], aside, **options).color, frame.color)


def test_classes_origins_and_samples_count_guesses_as_holes():
    view, aside = card(), ASIDE[-1]
    layer = ibr.background_layer(view, ASIDE)
    alone, both = (ibr.warp(views, aside, classes=True) for views in (view, [view, layer]))
    assert alone.classes is not None and both.classes is not None and both.view is not None
    np.testing.assert_array_equal(both.classes, alone.classes)
    assert both.view.max() == 0
    fine = ibr.warp([view, layer], aside, samples=4)
    assert 0.8 < fine.valid.mean() < 1 and np.isfinite(fine.depth).all()


def test_other_things_hide_guesses():
    view = card()
    layer = ibr.background_layer(view, ASIDE)
    behind = ibr.Mesh([[-40, -40, 9], [40, -40, 9], [0, 40, 9]], [[0, 1, 2]], colors=np.full((3, 3), 255, np.uint8))
    for things in ([view, layer, behind], [behind, layer, view], [ibr.WarpedView([view, layer]), behind]):
        frame = ibr.render(things, ASIDE[-1])
        assert frame.valid.all() and (frame.color[45, 60:95] == 255).all(axis=-1).sum() >= 4


def test_the_nearest_of_several_guesses_is_shown():
    view, shape = card(), SIZE[::-1]
    layers = [
        ibr.DepthImage(np.full((*shape, 3), 10 * z, np.uint8), np.full(shape, z, np.float32), CAMERA, guessed=True)
        for z in (5, 7, 6)
    ]
    nearest, first, last = (ibr.warp([view, *some], ASIDE[-1]) for some in (layers[:1], layers, layers[::-1]))
    shown = np.isfinite(nearest.depth) & ~nearest.valid
    assert shown.sum() > 100 and (first.color[shown] == 50).all()
    for one, other in (
        (first.depth[shown], nearest.depth[shown]),
        (first.color, last.color),
        (first.depth, last.depth),
    ):
        np.testing.assert_array_equal(one, other)


def test_guesses_are_lit_and_cast_no_shadows():
    view = card()
    layer = ibr.background_layer(view, ASIDE)
    light = ibr.Light(direction=(0, 0, 1), ambient=0.25, relight=True)
    lit, plain = ibr.render([view, layer], ASIDE[-1], light), ibr.render([view, layer], ASIDE[-1])
    np.testing.assert_array_equal(lit.valid, plain.valid)
    guessed = ~plain.valid
    assert np.abs(lit.color[guessed].astype(int) - plain.color[guessed]).max() <= 60  # facing the light, or in shadow
    assert (lit.color[guessed, 2] < 0.5 * plain.color[guessed, 2]).mean() < 0.5


@pytest.mark.parametrize(("dtype", "colored"), [(np.float32, True), (np.uint8, False)])
def test_kinds_of_colours(dtype: type, colored: bool):
    view = card(dtype=dtype, colored=colored)
    layer = ibr.background_layer(view, ASIDE)
    frame = ibr.warp([view, layer], ASIDE[-1])
    assert frame.color.dtype == dtype and np.isfinite(frame.depth).all()
    assert layer.has_color == colored


def test_the_border_reaches_half_the_views_size():
    turned = [Camera([[FOCAL, 0, 60 + x], [0, FOCAL, 45 + y], [0, 0, 1]], SIZE) for x, y in ((29.5, 8.5), (500, 400))]
    near, far = (ibr.background_layer(card(), camera).camera for camera in turned)
    assert near.size == (SIZE[0] + 31, SIZE[1] + 10)  # a pixel more on the other sides
    assert far.size == (SIZE[0] * 3 // 2 + 1, SIZE[1] * 3 // 2 + 1)


def test_cameras_without_parallax_see_only_the_border():
    turned = CAMERA.resized(SIZE)
    frame = ibr.warp([card(), ibr.background_layer(card(), turned)], turned)
    assert frame.valid.all()
    wide = Camera([[50, 0, 60], [0, 50, 45], [0, 0, 1]], SIZE)
    view = card()
    frame = ibr.warp([view, ibr.background_layer(view, wide)], wide)
    assert 0.2 < frame.valid.mean() < 0.3 and np.isfinite(frame.depth[25:65, 30:90]).all()


def test_empty_space_stays_empty():
    view = card()
    depth = np.where(view.depth == WALL, np.float32(np.inf), view.depth)
    ball = ibr.DepthImage(view.color, depth, CAMERA)
    frame = ibr.warp([ball, ibr.background_layer(ball, ASIDE)], ASIDE[-1], fill="background")
    assert not np.isfinite(frame.depth[5:25]).any()
    np.testing.assert_array_equal(frame.valid, ibr.warp(ball, ASIDE[-1]).valid)


def test_a_guess_stays_a_guess_in_files_and_processes(tmp_path: Path):
    layer = ibr.background_layer(card(), ASIDE)
    assert pickle.loads(pickle.dumps(layer)).guessed
    sets.save([card(), layer], tmp_path)
    assert [view.guessed for view in sets.load(tmp_path)] == [False, True]
    (tmp_path / "frusta.json").write_text((tmp_path / "frusta.json").read_text().replace("true", "1"))
    with pytest.raises(ibr.FileFormatError, match="guessed: expected true or false"):
        sets.load(tmp_path)


def test_mistakes():
    with pytest.raises(ibr.ArgumentError, match=r"^cameras: expected a pyibr.Camera or a sequence of them"):
        ibr.background_layer(card(), [])
    with pytest.raises(ibr.ArgumentError, match=r"^view: expected a pyibr.DepthImage"):
        ibr.background_layer([card()], ASIDE)  # pyright: ignore[reportArgumentType]
    with pytest.raises(ibr.ArgumentError, match=r"^fill: expected one of"):
        ibr.background_layer(card(), ASIDE, fill="none")  # pyright: ignore[reportArgumentType]


def test_a_guess_is_no_view_of_a_solid():
    layer = ibr.background_layer(card(), ASIDE)
    for make in (ibr.DepthObject, ibr.DepthMeshObject):
        with pytest.raises(
            ibr.ArgumentError, match=r"^views: expected views that saw the object, got a guess .* view 1"
        ):
            make([card(), layer])
    assert ibr.render(ibr.DepthMesh(layer), ASIDE[-1]).valid.any()  # a depth mesh shows it as any image


PATHS = {
    "aside": [(0.0375 * k, 0, 0) for k in range(1, 9)],
    "oblique": [(0.0375 * k, -0.011 * k, 0.0075 * k) for k in range(1, 9)],
    "up": [(0, -0.05 * k, 0) for k in range(1, 9)],
    "ahead": [(0, 0, 0.1 * k) for k in range(1, 9)],
    "back": [(0, 0, -0.1 * k) for k in range(1, 9)],
    "round": [(0.3 * np.cos(a), 0.3 * np.sin(a), 0) for a in np.linspace(0, 2 * np.pi, 8, endpoint=False)],
}


@pytest.mark.thorough
@pytest.mark.parametrize("path", PATHS)
def test_a_rooms_guesses_are_steady_and_as_near_the_truth_as_single_fills(path: str, monkeypatch: pytest.MonkeyPatch):
    """Colours of guesses, compared with rendered pictures: at most 1.03 times the error of a fill of each frame."""
    monkeypatch.syspath_prepend(GALLERY)
    room = import_module("room")
    view = room.photograph()
    cameras = [view.camera.moved(*step) for step in PATHS[path]]
    single = ibr.warp(view, cameras, fill="background")
    both = ibr.warp([view, ibr.background_layer(view, cameras)], cameras, fill="background")
    errors = np.zeros(2)
    for camera, *frames in zip(cameras, single, both, strict=True):
        truth = ibr.render(list(room.room()), camera, room.LIGHT, samples=4).color.astype(float)
        np.testing.assert_array_equal(frames[0].valid, frames[1].valid)
        errors += [np.abs(frame.color - truth)[~frame.valid].mean() for frame in frames]
    assert errors[1] <= 1.03 * errors[0]
    assert flicker(both, cameras) <= (0.5 if path == "ahead" else 0.35) * flicker(single, cameras)  # few guesses ahead


@pytest.mark.thorough
@pytest.mark.parametrize("scene", ["teddy", "cones"])
def test_guesses_of_photographs_are_steady(scene: str):
    folder = shared("stereo_middlebury") / scene
    color = ibr.read_color(folder / "im2.png")
    disparity = ibr.read_color(folder / "disp2.png")[..., 0] / np.float32(4)
    height, width = disparity.shape
    camera = Camera([[width, 0, width / 2], [0, width, height / 2], [0, 0, 1]], (width, height))
    with np.errstate(divide="ignore"):
        depth = np.where(disparity > 0, 0.16 * width / disparity, np.float32(np.nan))
    view = ibr.DepthImage(color, depth.astype(np.float32), camera)
    cameras = [camera.moved(0.015 * k, -0.0045 * k, 0.003 * k) for k in range(1, 9)]
    single = ibr.warp(view, cameras, fill="background")
    both = ibr.warp([view, ibr.background_layer(view, cameras)], cameras, fill="background")
    assert flicker(both, cameras) <= 0.35 * flicker(single, cameras)
