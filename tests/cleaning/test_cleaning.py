"""Cleaned depth: most of the error that noise causes is gone, and edges stay in place."""

from __future__ import annotations

import numpy as np
import pytest

import pyibr as ibr
from benchmarks import scenes
from tests.data import shared

SIZE = (97, 131)
FOCAL, BASELINE = 525.0, 0.075


def room() -> np.ndarray:
    """Depth of a slanted floor, of a box in front of it, and of a wire in front of both."""
    y, x = np.mgrid[: SIZE[0], : SIZE[1]]
    depth = 1 / (0.25 + 0.002 * y + 0.0004 * x)
    depth[30:70, 40:90] = 1 / (0.6 + 0.001 * x[30:70, 40:90])
    depth[:, 110] = 1.2
    return depth.astype(np.float32)


def with_noise(depth: np.ndarray, rng: np.random.Generator, kind: str) -> np.ndarray:
    if kind == "disparity":
        disparity = FOCAL * BASELINE / depth + rng.normal(0, 0.3, depth.shape)
        return (FOCAL * BASELINE / (np.round(disparity * 8) / 8)).astype(np.float32)
    return (depth + rng.normal(0, 0.006, depth.shape)).astype(np.float32)  # time of flight


def edges_stay(depth: np.ndarray) -> bool:
    """Tell whether depth shows the room's box where it is, up to 1 % of its samples."""
    box = np.zeros(SIZE, bool)
    box[30:70, 40:90] = True
    return ((depth < 1 / (0.6 - 0.05)) != box)[20:80, 30:100].sum() <= 0.01 * box.sum()


@pytest.mark.parametrize("kind", ["disparity", "flight"])
def test_noise_is_smoothed_and_edges_stay(kind):
    rng = np.random.default_rng(1)
    truth = room()
    noisy = with_noise(truth, rng, kind)
    noisy[rng.random(SIZE) < 0.05] = np.nan
    cleaned = ibr.clean_depth(noisy)
    measured = np.isfinite(noisy)
    before, after = (np.abs(d / truth - 1)[measured] for d in (noisy, cleaned.depth))
    # A Gaussian of 3 pixels leaves 1 / (2 sqrt(pi) 3) = 9 % of independent noise; edges and the wire keep their noise.
    assert after.mean() < 0.4 * before.mean()
    assert edges_stay(cleaned.depth)
    assert np.median(np.abs(cleaned.depth[:, 110] / 1.2 - 1)) < 0.02, "the wire, one sample thin, is still there"
    assert np.isfinite(cleaned.depth).all()
    np.testing.assert_array_equal(cleaned.invented[~measured], True)


@pytest.mark.parametrize("kind", ["disparity", "flight"])
def test_given_noise_is_as_good_as_what_is_found_and_tells_how_much_is_smoothed(kind):
    truth = room()
    noisy = with_noise(truth, np.random.default_rng(1), kind)
    one = ibr.disparity_noise(0.3, FOCAL, BASELINE) if kind == "disparity" else (0.0, 0.0, 0.006)
    a, b, c = (one, 0.0, 0.0) if isinstance(one, float) else one

    def off(**given) -> float:
        return float(np.abs(ibr.clean_depth(noisy, **given).depth / truth - 1).mean())

    assert off(noise=one) == pytest.approx(off(), rel=0.1)
    depths = [ibr.clean_depth(noisy, noise=given).depth for given in (one, (a, b, c))]
    np.testing.assert_array_equal(*depths)
    assert off(noise=lambda z: (a * z + b) * z + c) == pytest.approx(off(noise=one), rel=1e-3)
    assert off(noise=(0.3 * a, 0.3 * b, 0.3 * c)) > 1.2 * off(noise=one)


def test_without_noise_no_shape_is_taken_for_it():
    y, x = np.mgrid[:120, :160]
    ripples = (2 + 0.01 * np.sin(2.1 * x + 1.3 * y)).astype(np.float32)
    np.testing.assert_allclose(ibr.clean_depth(ripples, noise=0.0).depth, ripples, rtol=3.3 * 5e-4)
    assert np.abs(ibr.clean_depth(ripples).depth - ripples).mean() > 0.003


def test_what_has_no_noise_stays():
    truth = room()
    cleaned = ibr.clean_depth(truth)
    # Noise is assumed to be at least 0.05 % of the depth. Smoothing changes depth by up to 3.3 times the noise.
    np.testing.assert_allclose(cleaned.depth, truth, rtol=3.3 * 5e-4)
    assert not cleaned.invented.any()
    np.testing.assert_array_equal(ibr.clean_depth(truth, strength=0).depth, truth)


def test_coarse_steps_are_smoothed():
    """Depth by quantised disparity, with almost no other noise, turns every slope into stairs."""
    truth = room()
    steps = FOCAL * BASELINE / truth + np.random.default_rng(8).normal(0, 0.01, SIZE)
    coarse = (FOCAL * BASELINE / (np.round(steps * 8) / 8)).astype(np.float32)
    cleaned = ibr.clean_depth(coarse).depth
    before, after = (np.abs(d / truth - 1) for d in (coarse, cleaned))
    assert after.mean() < 0.4 * before.mean()
    assert edges_stay(cleaned)


def test_planes_at_few_depths_are_no_steps_of_a_scale():
    depth = np.full(SIZE, 2, np.float32)
    depth[30:70, 40:90] = 1.98
    depth[40:60, 50:80] = 1.96
    np.testing.assert_allclose(ibr.clean_depth(depth).depth[45:55, 55:75], 1.96, rtol=1e-6)
    np.testing.assert_allclose(ibr.clean_depth(depth).depth[31:39, 45:85], 1.98, rtol=2 * 5e-4)


def test_flying_pixels_and_speckle_are_replaced():
    truth = room()
    depth = truth.copy()
    depth[30:70, 40] = 0.5 * (truth[30:70, 39] + truth[30:70, 41])  # mean of box and floor
    depth[10:12, 10:13] = 0.3
    cleaned = ibr.clean_depth(depth)
    assert cleaned.invented[31:69, 40].mean() > 0.95 and cleaned.invented[10:12, 10:13].all()
    either = np.minimum(np.abs(cleaned.depth / truth - 1), np.abs(cleaned.depth / np.roll(truth, 1, axis=1) - 1))
    assert np.nanmax(either[32:68, 40]) < 0.03, "each depth is the box's or the floor's, not in between"
    np.testing.assert_allclose(cleaned.depth[10:12, 10:13], truth[10:12, 10:13], rtol=0.05)


def test_edges_of_filled_holes_follow_the_colours():
    depth = np.full(SIZE, 2, np.float32)
    depth[:, 60:] = 1
    color = np.zeros((*SIZE, 3), np.uint8)
    color[:, 60:] = 200
    torn = depth.copy()
    torn[20:80, 54:63] = np.nan  # the colours' edge at 60 is not the middle of the hole
    np.testing.assert_allclose(ibr.clean_depth(torn, color).depth, depth, rtol=1e-6)
    assert not np.allclose(ibr.clean_depth(torn).depth, depth, rtol=1e-6)


def test_only_holes_of_the_given_width_are_filled():
    depth = np.full(SIZE, 2, np.float32)
    depth[40:44, 20:60] = depth[60:90, 20:60] = np.nan
    narrow = ibr.clean_depth(depth, holes=4)
    assert np.isfinite(narrow.depth[40:44]).all() and np.isnan(narrow.depth[66:84, 26:54]).all()
    assert np.isfinite(ibr.clean_depth(depth, holes=20).depth).all()
    np.testing.assert_array_equal(np.isfinite(ibr.clean_depth(depth, holes=0).depth), np.isfinite(depth))


@pytest.mark.parametrize("size", [(1, 1), (1, 9), (9, 1), (2, 2), (3, 5)])
def test_small_images(size):
    depth = np.full(size, 2, np.float32)
    np.testing.assert_array_equal(ibr.clean_depth(depth).depth, depth)
    np.testing.assert_array_equal(ibr.clean_depth(depth, before=depth).depth, depth)
    for before in (None, depth):
        nothing = ibr.clean_depth(np.full(size, np.nan, np.float32), before=before)
        assert np.isnan(nothing.depth).all() and not nothing.invented.any()


def test_the_input_stays_as_it_is_and_the_answer_is_the_same_again():
    rng = np.random.default_rng(4)
    depth = with_noise(room(), rng, "disparity")
    depth[::3] = 0
    copy = depth.copy()
    first, second = ibr.clean_depth(depth), ibr.clean_depth(depth)
    np.testing.assert_array_equal(depth, copy)
    np.testing.assert_array_equal(first.depth, second.depth)


# ---- sequences


def sequence(truths: list[np.ndarray], kind: str = "disparity", steady: bool = True) -> list[np.ndarray]:
    """Cleaned depth of a sequence of noisy frames, in which 5 % of the samples are missing."""
    cleaned: list[np.ndarray] = []
    for number, truth in enumerate(truths):
        rng = np.random.default_rng(number)
        noisy = with_noise(truth, rng, kind)
        noisy[rng.random(SIZE) < 0.05] = np.nan
        cleaned.append(ibr.clean_depth(noisy, before=cleaned[-1] if steady and cleaned else None).depth)
    return cleaned


@pytest.mark.parametrize("kind", ["disparity", "flight"])
def test_what_is_at_rest_is_steady_and_nearer_to_the_truth(kind):
    """Missing samples break a wire into pieces, which a frame cleaned alone loses as speckle. The wire is steady."""
    truth = room()
    measured = np.stack([with_noise(truth, np.random.default_rng(number), kind) for number in range(30)])
    steady, single = (np.stack(sequence(30 * [truth], kind, steady)) for steady in (True, False))
    changes = [frames[8:16].std(axis=0) for frames in (steady, single)]
    # If each frame took nine tenths of the previous value, sqrt(0.1 / 1.9) = 0.23 of the deviation would remain.
    assert changes[0].mean() < 0.4 * changes[1].mean()
    assert np.quantile(changes[0], 0.99) < np.quantile(changes[1], 0.99)
    errors = [np.abs(frames[8:16] / truth - 1).mean() for frames in (steady, single)]
    assert errors[0] < 0.8 * errors[1]
    assert (steady.std(axis=0) <= measured.std(axis=0)).mean() >= 0.99
    wall = 1.5  # the wire is at 1.2
    torn = [(frames[1:, :, 110] > wall).any(axis=1).sum() for frames in (steady, single)]  # frame 0 has no `before`
    assert torn[0] == 0 and torn[1] >= 3


def test_what_moves_leaves_nothing_behind():
    """A box in front of a wall, a fifth nearer, moves by 3 pixels from frame to frame."""
    truths: list[np.ndarray] = []
    for number in range(12):
        truths.append(np.full(SIZE, 2.5, np.float32))
        truths[-1][20:70, 3 * number + 10 : 3 * number + 50] = 2
    steady, single = (sequence(truths, steady=steady) for steady in (True, False))
    wrong = np.zeros((2, *SIZE), int)
    for truth, *cleaned in zip(truths[1:], steady[1:], single[1:], strict=True):
        for count, depth in zip(wrong, cleaned, strict=True):
            count += (depth < 2.2) != (truth < 2.2)
    # 11: some samples along the box's sides are missing in each of 11 frames, and are filled from either surface.
    assert wrong[0].sum() <= 1.1 * wrong[1].sum() + 11
    inside = [np.abs(d - t)[t > 2.2].mean() for cleaned in (steady, single) for d, t in [(cleaned[-1], truths[-1])]]
    assert inside[0] < inside[1]


def test_what_moves_is_not_smeared_over_its_shadow():
    """A structured-light camera has no depth in a shadow 7 pixels wide beside the box, which moves with the box."""
    before = None
    for number in range(8):
        left = 20 + 3 * number
        depth = np.full(SIZE, 2.5, np.float32)
        depth[20:70, left : left + 40] = 2
        color = np.where(depth < 2.2, 200, 50).astype(np.uint8)[..., None].repeat(3, axis=2)
        torn = depth.copy()
        torn[20:70, left - 7 : left] = np.nan
        before = ibr.clean_depth(torn, color, before=before).depth
        assert np.abs(before - depth)[:, : left - 2].max() < 0.02, "the wall up to 2 pixels from the box"


@pytest.mark.parametrize(
    "step", [0.03, 0.3, 3.0, *(pytest.param(step, marks=pytest.mark.thorough) for step in (0.1, 1.0))]
)
def test_what_drifts_is_behind_by_half_of_the_noise_at_most(step):
    """`step`: change of nearness from frame to frame, in standard deviations of the noise."""
    deviation = np.hypot(0.3, 0.125 / np.sqrt(12)) / (FOCAL * BASELINE)  # nearness, including quantisation
    truths = [np.full(SIZE, 1 / (0.5 + number * step * deviation), np.float32) for number in range(25)]
    behind = [(1 / d - 1 / t).mean() / deviation for d, t in zip(sequence(truths), truths, strict=True)]
    # The lag is 0.55 of the estimated noise, and single frames estimate noise to a tenth.
    assert min(behind) > -0.62 and max(behind) < 0.05
    if step == 0.3:
        assert behind[-1] < -0.3, "depth must lag behind, or nothing is tested"


def test_missing_samples_are_those_of_before_if_their_surface_is_still_beside():
    wall = np.full(SIZE, 2, np.float32)
    wall[:, :50] = 1
    torn = wall.copy()
    torn[30:60, 49:51] = np.nan
    for edge in (49, 50, 51):
        before = wall.copy()
        before[30:60, :edge], before[30:60, edge:] = 1, 2
        cleaned = ibr.clean_depth(torn, before=before)
        np.testing.assert_allclose(cleaned.depth, before, rtol=1e-6)
        assert cleaned.invented[30:60, 49:51].all() and cleaned.invented.sum() == 60

    gone = np.full(SIZE, 3, np.float32)
    gone[40:60, 60:80] = 1  # a box that is gone in the current frame
    now = np.full(SIZE, 3, np.float32)
    now[38:62, 58:82][::2, ::2] = np.nan
    np.testing.assert_allclose(ibr.clean_depth(now, before=gone).depth, 3, rtol=1e-6)


@pytest.mark.parametrize("choices", [{"holes": 0}, {"strength": 0}])
def test_before_does_not_do_what_is_switched_off(choices):
    truth = room()
    noisy = with_noise(truth, np.random.default_rng(7), "disparity")
    noisy[10:20, 10:20] = np.nan
    alone, after = (ibr.clean_depth(noisy, before=before, **choices) for before in (None, truth))
    where = np.isfinite(noisy) & ~after.invented
    if "holes" in choices:
        assert np.isnan(after.depth[11:19, 11:19]).all() and (after.depth != alone.depth)[where].any()
    else:
        np.testing.assert_array_equal(after.depth[where], noisy[where])


@pytest.mark.thorough
def test_a_camera_that_moves_takes_along_what_it_knows():
    """In five frames of a real camera path, the previous cleaned depth is warped to each next camera."""
    folder = shared("rgbd_livingroom1")
    camera = scenes.depth_camera(scenes.LIVINGROOM, 0, (640, 480))
    poses = np.loadtxt(folder / "poses_gt_cam_to_frame0.txt")
    errors: dict[bool, list[float]] = {True: [], False: []}
    last = None
    for number in range(5):
        pose = poses[poses[:, 0] == number][0, 1:].reshape(4, 4)
        now = ibr.Camera(camera.K, camera.size, pose)
        truth = ibr.read_depth(folder / f"depth/{number:05d}.png", depth_scale=1000)
        disparity = ibr.disparity_from_depth(truth, FOCAL, BASELINE)
        rng = np.random.default_rng(number)
        disparity = np.round((disparity + rng.normal(0, 0.3, truth.shape)) * 8) / 8
        noisy = ibr.depth_from_disparity(disparity.astype(np.float32), FOCAL, BASELINE)
        before = None if last is None else ibr.warp(last, now).depth
        for steady in errors:
            depth = ibr.clean_depth(noisy, before=before if steady else None).depth
            errors[steady].append(float(np.nanmean(np.abs(depth - truth))))
            if steady:
                last = ibr.DepthImage(None, depth, now)
    assert errors[True][0] == errors[False][0]
    assert errors[True][4] < 0.8 * errors[False][4]


@pytest.mark.thorough
def test_a_real_camera_at_rest_is_steady():
    """An Asus Xtion at rest, whose depth jumps between coarse steps, takes ten frames of a static scene."""
    folder = shared("formats/asus_xtion_unregistered")
    files = [folder / f"depth1_{number:02d}.png" for number in range(1, 11)]
    frames = np.stack([ibr.read_depth(file, depth_scale=1000) for file in files])
    cleaned: list[np.ndarray] = []
    for depth in frames:
        cleaned.append(ibr.clean_depth(depth, before=cleaned[-1] if cleaned else None).depth)
    at_rest = np.isfinite(frames).all(axis=0) & (np.ptp(frames, axis=0) < 0.15)
    assert at_rest.mean() > 0.8
    changes = [np.stack(depths[5:]).std(axis=0)[at_rest] for depths in (frames, cleaned)]
    assert changes[1].mean() < 0.5 * changes[0].mean()
    assert np.quantile(changes[1], 0.99) < np.quantile(changes[0], 0.99)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"depth": np.zeros((3, 4), np.uint16)}, "depth: expected float32"),
        ({"holes": -1}, "holes: expected a whole number from 0 to 1000"),
        ({"noise": -1.0}, "noise: expected a number >= 0"),
        ({"noise": lambda z: z[:2]}, "noise: expected a function of"),
        ({"strength": np.nan}, "strength: expected a number from 0 to 10"),
        ({"color": np.zeros((4, 3, 3), np.uint8)}, "color: expected uint8"),
        ({"before": np.ones((4, 3), np.float32)}, r"before: expected float32 of shape \(3, 4\)"),
        ({"before": np.ones((3, 4), np.uint16)}, "before: expected float32"),
        ({"depth": np.broadcast_to(np.float32(1), (1 << 24, 1))}, "depth: expected at most 536870912 pixels"),
    ],
)
def test_wrong_arguments(arguments, message):
    with pytest.raises(ibr.ArgumentError, match=message):
        ibr.clean_depth(**{"depth": np.ones((3, 4), np.float32), **arguments})


@pytest.mark.thorough
@pytest.mark.parametrize("motion", [(50, 0), (4, 0)])
def test_most_of_what_noise_costs_a_new_view_comes_back(motion):
    """A new view regains over 60 % of the depth and PSNR that 0.3 pixels of disparity noise cost."""
    shared("rgbd_livingroom1")
    source, target = motion
    size = (640, 480)
    clean, noisy = (scenes.rgbd(scenes.LIVINGROOM, source, size, noise) for noise in (0.0, 0.3))
    seen = scenes.rgbd(scenes.LIVINGROOM, target, size)
    lost = np.array(noisy.depth)
    lost[np.random.default_rng(5).random(lost.shape) < 0.05] = np.nan
    cleaned = ibr.clean_depth(lost, clean.color).depth
    depths = {"clean": clean.depth, "noisy": lost, "cleaned": cleaned}
    frames = {name: ibr.warp(ibr.DepthImage(clean.color, d, clean.camera), seen.camera) for name, d in depths.items()}
    both = np.isfinite(seen.depth) & np.logical_and.reduce([frame.valid for frame in frames.values()])
    error = {name: np.abs(frame.depth - seen.depth)[both].mean() for name, frame in frames.items()}
    squares = {name: ((frame.color.astype(float) - seen.color)[both] ** 2).mean() for name, frame in frames.items()}
    assert error["noisy"] - error["cleaned"] > 0.6 * (error["noisy"] - error["clean"])
    assert np.log(squares["noisy"] / squares["cleaned"]) > 0.6 * np.log(squares["noisy"] / squares["clean"])

    # Foreground at edges: where depth varies by over a quarter within 7 pixels, depths nearer than the middle of these.
    import cv2

    lowest, highest = (f(np.nan_to_num(clean.depth), np.ones((15, 15))) for f in (cv2.erode, cv2.dilate))
    known = np.isfinite(clean.depth) & (highest > 1.25 * lowest)
    middle = 0.5 * (lowest + highest)
    true, found = (known & (d < middle) for d in (clean.depth, cleaned))
    assert (true & found).sum() >= 0.99 * (true | found).sum()


def test_strength_tells_how_much_is_smoothed_and_kept():
    """The larger the strength, the more noise is smoothed, and the more a step of two deviations is held back."""
    rng = np.random.default_rng(5)
    wall = np.full((80, 100), 2.0)
    noisy = (wall + rng.normal(0, 0.01, wall.shape)).astype(np.float32)
    before = np.full(wall.shape, 2.02, np.float32)
    spreads, steps = [], []
    for strength in (0.3, 1.0, 3.0):
        spreads.append(ibr.clean_depth(noisy, strength=strength).depth.std())
        steps.append(float(np.mean(ibr.clean_depth(noisy, strength=strength, before=before).depth)) - 2.0)
    assert spreads[0] > 1.2 * spreads[1] and spreads[1] >= spreads[2]
    assert steps[0] < 0.5 * steps[1] and steps[1] < 0.8 * steps[2] < 0.8 * 0.02
