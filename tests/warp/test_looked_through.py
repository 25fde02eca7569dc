"""Several views correct one another: what one view has looked through is removed from the others' surfaces.

These parts are margins, half a sample wide beyond the outermost samples, and sheets across depth steps (bridges).
"""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest

import pyibr as ibr
from pyibr.opencl.watch import Traffic, watching
from tests import embree
from tests.exact import same_bits

SIZE = (61, 47)
TARGET = (183, 141)  # size of the target, which has three pixels per sample in x and in y
CARD = np.array([0.45, 0.35, 0.0])  # half of the card's extent in x, y and z


def rays_of(camera):
    """Rays: origins and directions, (H, W, 3). A point at planar depth t is origin + t * direction."""
    return np.split(embree.rays_of(camera).reshape(camera.height, camera.width, 6), 2, axis=2)


def textured(camera, depth, **options):
    origins, directions = rays_of(camera)
    with np.errstate(invalid="ignore"):
        points = origins + directions * np.nan_to_num(depth, posinf=0)[..., None]
        color = np.rint(128 + 100 * np.sin(points @ [[9, 4, -3], [2, 11, 5], [-6, 3, 8.0]])).astype(np.uint8)
    return ibr.DepthImage(color, depth.astype(np.float32), camera, **options)


def camera_at(eye, size=SIZE, *, projection="perspective", target=(0.0, 0.0, 0.0)):
    camera = ibr.Camera.look_at(eye, target, (0.1, -1.0, 0.2), size, fov_y=40)
    if projection == "perspective":
        return camera
    scale = camera.K[0, 0] / np.linalg.norm(np.subtract(eye, target))  # things at the target point look as large
    K = [[scale, 0, camera.K[0, 2]], [0, scale, camera.K[1, 2]], [0, 0, 1]]
    return ibr.Camera(K, size, camera.world_from_camera, projection="orthographic")


def card_at(camera, background):
    """Depth of a card at z = 0 in front of a background, and the mask of the card's pixels."""
    origins, directions = rays_of(camera)
    depth = -origins[..., 2] / directions[..., 2]
    on_card = (np.abs(origins + depth[..., None] * directions) <= CARD + 1e-9).all(axis=-1)
    return np.where(on_card, depth, background), on_card


def balls_at(camera, balls, background=np.inf):
    """Depth of balls, each given as (x, y, z, radius)."""
    origins, directions = rays_of(camera)
    nearest = np.full(origins.shape[:2], np.inf)
    for *centre, radius in balls:
        to = origins - centre
        a, b = (directions**2).sum(-1), (directions * to).sum(-1)
        root = b**2 - a * ((to**2).sum(-1) - radius**2)
        with np.errstate(invalid="ignore"):
            nearest = np.fmin(nearest, np.where(root > 0, (-b - np.sqrt(root)) / a, np.inf))
    return np.where(np.isfinite(nearest), nearest, background)


EYES = [(-0.7, 0.3, -2.0), (0.6, 0.5, -1.9), (0.1, -0.8, -2.1)]
BETWEEN = (0.05, 0.1, -2.0)


def sticking_out(views, **options):
    """Count the pixels of a finer picture that show margins beside the card, and its holes on the card."""
    camera = camera_at(BETWEEN, TARGET)
    _, on_card = card_at(camera, np.inf)
    frame = ibr.warp(views, camera, **options)
    return int((frame.valid & (frame.depth < 3) & ~on_card).sum()), int((~frame.valid & on_card).sum())


@pytest.mark.parametrize("blend", ["quality", "nearest"])
@pytest.mark.parametrize("projections", [("perspective",) * 3, ("orthographic", "perspective", "orthographic")])
def test_margins_yield_where_space_is_known_to_be_empty(projections, blend):
    cameras = [camera_at(eye, projection=kind) for eye, kind in zip(EYES, projections, strict=True)]
    before, open_before = sticking_out(
        [textured(camera, card_at(camera, np.nan)[0]) for camera in cameras], blend=blend
    )
    for background, far in ((np.inf, np.inf), (9.0, 5.0), (5.0, np.inf)):
        views = [textured(camera, card_at(camera, background)[0], far=far) for camera in cameras]
        outside, uncovered = sticking_out(views, blend=blend)
        # Margins stay where no ray of another view passes through them.
        assert outside < 0.2 * before, (background, far)
        assert uncovered - open_before < before - outside


@pytest.mark.parametrize("background", [np.nan, 0.0, -1.0])
def test_what_is_unknown_tells_nothing(background):
    # The cameras are parallel, so that all margins lie in the card's plane: none hides the card from a camera.
    camera = camera_at(BETWEEN, TARGET, target=(0.05, 0.1, 0.0))
    cameras = [camera_at((x, y, -2.0), target=(x, y, 0.0)) for x, y, _ in EYES]
    views = [textured(one, card_at(one, background)[0]) for one in cameras]
    alone = [ibr.warp(view, camera).valid for view in views]
    np.testing.assert_array_equal(ibr.warp(views, camera).valid, np.any(alone, axis=0))


def test_a_ball_is_as_large_as_it_is():
    ball = [(0.05, -0.1, 0.0, 0.6)]
    directions = np.random.default_rng(4).normal(size=(9, 3))
    eyes = 2.4 * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    views = [textured(camera, balls_at(camera, ball)) for camera in map(camera_at, eyes)]
    outside = fat = lost = 0
    for eye in -eyes[:4] + [0.3, 0.1, -0.2]:
        camera = camera_at(eye, TARGET)
        there = np.isfinite(balls_at(camera, ball))
        valid, alone = ibr.warp(views, camera).valid, np.any([ibr.warp(view, camera).valid for view in views], axis=0)
        outside, fat = outside + (valid & ~there).sum(), fat + (alone & ~there).sum()
        lost += (alone & there & ~valid).sum()
    # 0.6: the views' pixels show the position of the outline only to half a sample.
    assert outside < 0.6 * fat
    assert lost < fat - outside


def ramp_views():
    """Views of a box and a wall: from the front, with a ramp between them as at soft edges; twice from the side."""
    front, near, far = camera_at((0.0, 0.0, -2.0)), 1 / 1.6, 1 / 3.0
    ramp = np.clip((31 - np.arange(SIZE[0])) / 3, 0, 1)  # three samples wide; rays meet it at less than 5 degrees
    nearness = far + (near - far) * ramp
    soft = textured(front, np.tile(1 / nearness, (SIZE[1], 1)))
    views = [soft]
    edge = front.unproject([[27.5, 20.0]], [1.6])[0] @ front.world_from_camera[:3, 0]
    right, ahead = front.world_from_camera[:3, 0], front.world_from_camera[:3, 2]
    for aside in (0.55, 0.7):
        camera = front.moved(aside, 0.02, 0.0)
        origins, directions = rays_of(camera)
        to_wall = (3.0 - (origins - front.center) @ ahead) / (directions @ ahead)
        to_box = (1.6 - (origins - front.center) @ ahead) / (directions @ ahead)
        on_box = (origins + to_box[..., None] * directions) @ right < edge
        views.append(textured(camera, np.where(on_box, to_box, to_wall)))
    return views


def test_sheets_that_others_looked_through_are_torn():
    views = ramp_views()
    target = views[0].camera.moved(0.4, 0.0, 0.0)

    def between(several):
        depth = ibr.warp(several, target, blend="nearest").depth
        return int(((depth > 1.75) & (depth < 2.8)).sum())

    alone = between(views[0])
    assert alone > 100
    assert between(views) < 0.05 * alone


def test_floors_that_recede_stay():
    rows = np.arange(SIZE[1])[:, None]
    views = []
    for x in (-0.3, 0.0, 0.4):
        camera = ibr.Camera([[70, 0, 30], [0, 70, 9.3], [0, 0, 1]], SIZE).moved(x, 0.0, 0.0)
        floor = np.where(rows > 9.3, 0.25 * 70 / np.maximum(rows - 9.3, 0.1), np.inf)
        views.append(textured(camera, np.tile(floor, SIZE[0])))
    camera = ibr.Camera([[210, 0, 91], [0, 210, 28.9], [0, 0, 1]], TARGET).moved(0.1, 0.02, 0.1)
    alone = np.any([ibr.warp(view, camera).valid for view in views], axis=0)
    lost = alone & ~ibr.warp(views, camera).valid
    assert lost[32:].sum() == 0  # row 32 is just below the horizon, where samples are metres apart


@pytest.mark.parametrize("fault", ["none", "noise", "holes", "off", "too near", "all"])
def test_faults_of_views_carve_nothing_away(fault):
    balls = [(0.0, 0.1, 0.0, 0.5), (0.5, -0.3, 0.4, 0.35), (-0.6, -0.2, 0.6, 0.3)]
    rng = np.random.default_rng(6)
    views = []
    for number, eye in enumerate(EYES):
        camera = camera_at(eye, (97, 71))
        origins, directions = rays_of(camera)
        depth = balls_at(camera, balls, (2.0 - origins[..., 2]) / directions[..., 2])  # a wall behind them
        if fault in ("noise", "all"):
            depth = depth + rng.normal(size=depth.shape) * 0.002 * depth**2
        if fault in ("holes", "all"):
            depth[rng.random(depth.shape) < 0.4] = np.nan
        if fault in ("too near", "all"):
            depth = depth * (0.995, 1.0, 1.005)[number]
        K = np.array(camera.K)
        if fault in ("off", "all"):
            K[:2, 2] += rng.uniform(-2, 2, 2)
        views.append(textured(ibr.Camera(K, camera.size, camera.world_from_camera), depth))
    camera = camera_at(BETWEEN, (151, 113))
    alone = np.any([ibr.warp(view, camera).valid for view in views], axis=0)
    valid = ibr.warp(views, camera).valid
    assert valid.sum() > 0.985 * alone.sum()


def rods_seen(camera, background=np.inf):
    """Depth of four upright rods, each 1.3 samples wide."""
    return balls_at(camera, [(x, y, z, 0.02) for x, z in RODS for y in np.arange(-0.5, 0.5, 0.01)], background)


RODS = [(-0.5, 0.1), (-0.2, -0.3), (0.15, 0.3), (0.45, -0.1)]


def test_rods_one_sample_thin_stay():
    views = [textured(camera, rods_seen(camera)) for camera in map(camera_at, EYES)]
    camera = camera_at(BETWEEN, TARGET)
    there = np.isfinite(rods_seen(camera))
    alone = np.any([ibr.warp(view, camera).valid for view in views], axis=0)
    valid = ibr.warp(views, camera).valid
    assert (valid & there).sum() > 0.9 * (alone & there).sum()
    assert (valid & ~there).sum() < (alone & ~there).sum()


def test_a_coarse_view_takes_no_detail_away():
    camera = camera_at(EYES[0])
    fine = textured(camera, rods_seen(camera))
    small = camera_at(EYES[1], (15, 12))  # a quarter of the resolution: its samples miss most rods
    coarse = textured(small, rods_seen(small))
    camera = camera_at(EYES[0], TARGET)
    there = np.isfinite(rods_seen(camera))
    covered = [int((ibr.warp(views, camera).valid & there).sum()) for views in (fine, [fine, coarse])]
    assert covered[1] > 0.98 * covered[0]


def test_options_that_ask_for_whole_surfaces_have_them():
    cameras = [camera_at(eye) for eye in EYES]
    views = [textured(camera, card_at(camera, np.inf)[0]) for camera in cameras]
    camera = camera_at(BETWEEN, TARGET)
    alone = np.any([ibr.warp(view, camera, edges="connect").valid for view in views], axis=0)
    np.testing.assert_array_equal(ibr.warp(views, camera, edges="connect").valid, alone)
    by_ratio, by_shape = (sticking_out(views, cut_ratio=ratio)[0] for ratio in (1.05, None))
    assert by_ratio == by_shape  # the card's views contain no bridges, which a cut ratio would keep


def test_bridges_by_number_stay():
    views = ramp_views()
    target = views[0].camera.moved(0.4, 0.0, 0.0)
    depth = ibr.warp(views, target, blend="nearest", cut_ratio=1.5).depth
    assert ((depth > 1.75) & (depth < 2.8)).sum() > 100


@pytest.mark.usefixtures("lanes")
def test_the_order_of_views_changes_no_bit():
    views = [textured(camera, card_at(camera, np.inf)[0]) for camera in map(camera_at, EYES)] + ramp_views()[:1]
    camera = camera_at(BETWEEN, TARGET)
    first, *others = (ibr.warp(order, camera) for order in list(permutations(views))[::7])
    for other in others:
        same_bits(first, other)


def test_it_is_found_once_for_a_set():
    views = [textured(camera, card_at(camera, np.inf)[0]) for camera in map(camera_at, EYES)]
    camera = camera_at(BETWEEN, TARGET)
    with watching(Traffic()) as fresh:
        ibr.warp(views, camera)
    with watching(Traffic()) as kept:
        ibr.warp(views[::-1], camera.moved(0.1, 0, 0))
    looks = [sum(name == "look_through" for _, name, _ in traffic.of) for traffic in (fresh, kept)]
    assert looks == [len(views), 0]
