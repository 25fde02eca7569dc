"""The epipolar warp, compared with rays cast at the surface that a depth image defines.

Sources and targets have both projections. The epipole lies in all nine regions, with all pairs of signs, or does not
exist.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import pyibr as ibr
from pyibr.core.camera import Camera, Projection
from pyibr.warp.view import Edges, Interpolation
from tests import scenes, truth
from tests.warp.test_special_positions import beside_border

pytest.importorskip("open3d")

PROJECTIONS: tuple[Projection, ...] = ("perspective", "orthographic")
WITH_EPIPOLES: list[tuple[Projection, Projection]] = [  # (two orthographic cameras have epipoles at infinity)
    ("perspective", "perspective"),
    ("perspective", "orthographic"),
    ("orthographic", "perspective"),
]
SCENES = ("smooth", "stepped")
PLACES = (*scenes.REGIONS, "special")  # special: identity, rotation alone, epipoles at infinity
SOURCE, TARGET = (160, 120), (150, 125)

DEPTH = 1e-3  # relative: the promised precision of the warp for linear samples
ROUNDING = 1e-5  # relative: float32 depth after a few dozen operations on pixels up to 256
RIGHT = 0.999  # fraction of `interior` that must be right: it excludes pixels near edges, but misses some at thin parts
COVERAGE = 0.005  # fraction of the image that may be a hole in one picture only: pixels at silhouettes
AGREEMENT = 0.995  # fraction of the image where the sweep and the search must agree; silhouettes may differ
COLUMNS = 512  # more than any image has columns or rows
TIE = 1 / 8  # source pixels: closer than this to the middle between two samples, either may be taken as the nearest
COLOR = 1.0  # levels of 255: half for rounding to bytes, half for the shift that a depth error of 0.1 % causes


@cache
def surface(scene: str, projection: Projection, edges: str = "connect", size: scenes.Size = SOURCE) -> truth.Surface:
    return truth.Surface(getattr(scenes, scene)(size, projection), edges)


def poses(view: ibr.DepthImage, target: Projection, place: str, size: scenes.Size = TARGET) -> list[scenes.Pose]:
    if place == "special":
        return scenes.special_cameras(view, size, target)
    found = scenes.target_cameras(view, place, size, target)
    assert found, f"no camera has its epipole in {place}"
    return found


def agreement(a: ibr.Frame, b: ibr.Frame, limit: np.ndarray | float = 0.0) -> float:
    """Fraction of the image where both frames have a hole, or depths that differ by at most `limit`."""
    same = np.abs(a.depth - b.depth) <= DEPTH * np.abs(b.depth) + limit
    return float(((a.valid == b.valid) & (~a.valid | same)).mean())


def check_linear(seen: truth.Truth, frame: ibr.Frame, name: str) -> None:
    interior = seen.interior()
    # With some 100 pixels, 99.9 % means that all are right.
    assert interior.sum() > 100, f"{name}: the truth consists of edges"
    right = frame.valid & np.isclose(frame.depth, seen.depth, rtol=DEPTH, atol=0)
    assert right[interior].mean() >= RIGHT, name
    assert (frame.valid != seen.valid).mean() <= COVERAGE, name
    off = np.abs(frame.color.astype(np.float64) - seen.color).max(axis=-1)
    assert off[interior & right].max() <= COLOR, name


def check_nearest(seen: truth.Truth, frame: ibr.Frame, view: ibr.DepthImage, name: str) -> None:
    interior = seen.interior()
    limit = truth.depth_change_one_pixel(seen, view, frame.camera) + ROUNDING * np.abs(seen.depth)
    right = frame.valid & (np.abs(frame.depth - seen.depth) <= limit)
    assert right[interior].mean() >= RIGHT, name
    assert (frame.valid != seen.valid).mean() <= COVERAGE, name
    off = np.abs(frame.color[..., :2] * COLUMNS - seen.source).max(axis=-1)  # the colours are the samples' positions
    assert (off[interior] <= 0.5 + TIE).mean() >= RIGHT, name


def colored_by_place(view: ibr.DepthImage) -> ibr.DepthImage:
    """The view's depth, with each sample's x and y, divided by `COLUMNS`, as colours."""
    y, x = np.indices(view.depth.shape, np.float32) / np.float32(COLUMNS)
    return ibr.DepthImage(np.stack([x, y, 0 * x], axis=-1), view.depth, view.camera)


@pytest.mark.parametrize("edges", ["connect", "cut"])
@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize(("source", "target"), WITH_EPIPOLES)
@pytest.mark.parametrize("place", PLACES)
def test_depth_color_and_coverage_are_the_truths(scene, source, target, place, edges):
    here = surface(scene, source, edges)
    places = colored_by_place(here.view)
    for pose in poses(here.view, target, place):
        seen = here.cast(pose.camera)
        check_linear(seen, ibr.warp(here.view, pose.camera, edges=edges), pose.name)
        nearest = ibr.warp(places, pose.camera, edges=edges, interpolation="nearest")
        check_nearest(seen, nearest, here.view, pose.name)


@pytest.mark.parametrize("edges", ["connect", "cut"])
@pytest.mark.parametrize("scene", SCENES)
def test_depth_color_and_coverage_without_epipoles(scene, edges):
    test_depth_color_and_coverage_are_the_truths(scene, "orthographic", "orthographic", "special", edges)


@pytest.mark.thorough
@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize(("source", "target"), WITH_EPIPOLES)
@pytest.mark.parametrize("place", PLACES)
def test_epipolar_is_search(scene, source, target, place):
    view = getattr(scenes, scene)(SOURCE, source)
    for number, pose in enumerate(poses(view, target, place)):
        edges: Edges = "cut" if number % 2 else "connect"
        sample: Interpolation = "nearest" if number // 2 % 2 else "linear"
        swept = ibr.warp(view, pose.camera, edges=edges, interpolation=sample)
        searched = ibr.warp(view, pose.camera, method="search", edges=edges, interpolation=sample)
        limit: np.ndarray | float = 0.0
        if sample == "nearest":  # near a tie between two samples, both are right
            seen = surface(scene, source, edges).cast(pose.camera)
            limit = np.nan_to_num(truth.depth_change_one_pixel(seen, view, pose.camera))
        assert agreement(swept, searched, limit) >= AGREEMENT, pose.name


@pytest.mark.thorough
@pytest.mark.parametrize("scene", SCENES)
def test_epipolar_is_search_without_epipoles(scene):
    test_epipolar_is_search(scene, "orthographic", "orthographic", "special")


def around(view: ibr.DepthImage, target: Projection) -> list[tuple[str, Camera]]:
    """Cameras behind the surface, which look straight and obliquely at its back, and two cameras in front of it."""
    K = scenes.target_intrinsics(TARGET, target)
    behind = {
        "behind": scenes.pose(yaw=180, center=(0, 0, 8)),
        "behind, askew": scenes.pose(yaw=150, pitch=15, roll=10, center=(-1.5, 0.8, 8.5)),
        "above and behind": scenes.pose(yaw=170, pitch=-35, center=(0.3, 3, 8)),
    }
    cameras = [(n, Camera(K, TARGET, view.camera.world_from_camera @ p, projection=target)) for n, p in behind.items()]
    return cameras + [(p.name, p.camera) for p in scenes.special_cameras(view, TARGET, target)[-2:]]


def test_sideways_motion_of_turned_cameras():
    """The epipole is at infinity; rounding alone would put it at a finite place, in a wrong direction."""
    scene = scenes.smooth((160, 120))
    rng = np.random.default_rng(0)
    for number in range(40):
        pose = scenes.pose(*rng.uniform(-60, 60, 3), center=tuple(rng.uniform(-2, 2, 3)))
        camera = Camera(scene.camera.K, (160, 120), pose)
        view = ibr.DepthImage(scene.color, scene.depth, camera)
        dx, dy = rng.uniform(-0.5, 0.5, 2) * ((1, 0), (0, 1), (1, 1))[number % 3]
        target = camera.moved(dx, dy, 0)
        assert agreement(ibr.warp(view, target), ibr.warp(view, target, method="search")) >= AGREEMENT, (
            number,
            dx,
            dy,
        )


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("source", PROJECTIONS)
@pytest.mark.parametrize("target", PROJECTIONS)
@pytest.mark.parametrize("edges", ["connect", "cut"])
@pytest.mark.filterwarnings("ignore:warp. the target camera sees nothing")
def test_the_back_and_both_sides(scene, source, target, edges):
    here = surface(scene, source, edges)
    for name, camera in around(here.view, target):
        for side in ("front", "back", "both"):
            seen = here.cast(camera, side)
            frame = ibr.warp(here.view, camera, edges=edges, side=side)
            if seen.interior().sum() > 100:
                check_linear(seen, frame, f"{name}, {side}")
            else:  # rounding decides which side of a step is seen along it
                assert (frame.valid != seen.valid).mean() <= COVERAGE, (name, side)


@pytest.mark.parametrize("size", [(60, 50), (31, 50), (320, 270), (500, 131)], ids=str)
@pytest.mark.parametrize("source", PROJECTIONS)
@pytest.mark.parametrize("target", PROJECTIONS)
def test_targets_much_smaller_and_larger_than_the_source(source, target, size):
    here = surface("stepped", source, size=(128, 96))
    places = ("special",) if source == target == "orthographic" else ("special", "B", "E", "I")
    cameras = [pose for place in places for pose in poses(here.view, target, place, (120, 100))[-2:]]
    for pose in cameras:
        camera = pose.camera.resized(size)
        seen = here.cast(camera)
        frame = ibr.warp(here.view, camera, edges="connect")
        assert (frame.valid != seen.valid).mean() <= COVERAGE, pose.name
        interior = seen.interior()
        right = frame.valid & np.isclose(frame.depth, seen.depth, rtol=DEPTH, atol=0)
        # One pixel may be more than 0.1 % of a small image.
        assert np.count_nonzero(~right[interior]) <= max(1, (1 - RIGHT) * interior.sum()), pose.name


@pytest.mark.parametrize("size", [(7, 13), (61, 37), (2, 2), (2, 9), (17, 2)], ids=str)
@pytest.mark.parametrize("source", PROJECTIONS)
@pytest.mark.parametrize("target", PROJECTIONS)
def test_awkward_sizes(size, source, target):
    here = surface("smooth", source, size=size)
    cameras = poses(here.view, target, "special", (61, 37)) + poses(here.view, target, "special", size)
    if "perspective" in (source, target):
        cameras += [p for place in "AEH" for p in poses(scenes.smooth((61, 37), source), target, place, (61, 37))]
    for pose in cameras:
        seen = here.cast(pose.camera)
        if not seen.valid.any():
            continue
        frame = ibr.warp(here.view, pose.camera, edges="connect")
        # 2: in a small image, two pixels may exceed the fraction. The surface's border may run along a row of pixels.
        differ = (frame.valid != seen.valid) & ~beside_border(seen.valid)
        assert np.count_nonzero(differ) <= max(2, COVERAGE * seen.valid.size), pose.name
        interior = seen.interior()
        right = frame.valid & np.isclose(frame.depth, seen.depth, rtol=DEPTH, atol=0)
        assert np.count_nonzero(~right[interior]) <= 1, pose.name


@pytest.mark.parametrize("size", [(1, 1), (1, 9), (5, 1)], ids=str)
@pytest.mark.parametrize("source", PROJECTIONS)
@pytest.mark.parametrize("target", PROJECTIONS)
@pytest.mark.parametrize("method", ["epipolar", "search", "forward"])
@pytest.mark.filterwarnings("ignore:warp. the target camera sees nothing")
def test_images_of_one_row_or_column_do_no_harm(size, source, target, method):
    view = scenes.smooth(size, source)
    middle = float(view.depth.mean())
    for target_size in ((61, 37), size):
        for pose in scenes.special_cameras(view, target_size, target):
            frame = ibr.warp(view, pose.camera, method=method)
            assert frame.color.shape == (target_size[1], target_size[0], 3)
            np.testing.assert_array_equal(np.isfinite(frame.depth), frame.valid)
            # A row of samples has no triangles. Pixels that are drawn must have about the samples' depths, 3 to 5.
            assert (np.abs(frame.depth[frame.valid] - middle) < 3).all(), pose.name


@pytest.mark.parametrize("target_size", [(1, 1), (1, 60), (60, 1)], ids=str)
@pytest.mark.parametrize("source", PROJECTIONS)
@pytest.mark.parametrize("target", PROJECTIONS)
def test_targets_of_one_row_or_column(target_size, source, target):
    here = surface("smooth", source, size=(61, 37))
    for pose in scenes.special_cameras(here.view, (60, 60), target):
        K = pose.camera.K.copy()
        K[:2, 2] = (target_size[0] - 1) / 2, (target_size[1] - 1) / 2
        camera = Camera(K, target_size, pose.camera.world_from_camera, projection=target)
        seen = here.cast(camera)
        assert seen.valid.any(), pose.name
        for sample in ("linear", "nearest"):
            frame = ibr.warp(here.view, camera, interpolation=sample, edges="connect")
            # 1: rounding decides whether a ray at a silhouette meets the surface.
            assert np.count_nonzero(frame.valid != seen.valid) <= (1 if seen.valid.size > 1 else 0), pose.name
            both = frame.valid & seen.valid
            limit = truth.depth_change_one_pixel(seen, here.view, camera) if sample == "nearest" else 0
            off = np.abs(frame.depth - seen.depth) - limit
            # At a hill's crest, rounding decides whether a ray meets the hill: one of all common pixels may be off.
            assert np.count_nonzero(off[both] > DEPTH * seen.depth[both]) <= 1, pose.name
