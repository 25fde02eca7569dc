"""Classes of a new view's pixels, and their origins in the sources, compared with rays cast at the whole scene.

The scene is a mesh: boxes and an octahedral ball in front of a wall that fills every view. So each target pixel shows a
known point of the scene, whose projection to the source shows whether the source saw it, or why not.
"""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

import pyibr as ibr
from pyibr.core.camera import Camera, Projection
from tests import scenes, truth
from tests.embree import pixels_of, rays_of
from tests.reference.edges import edges_of

pytest.importorskip("open3d")

SIZE = (170, 130)
ON_SURFACE = 0.01  # pixels: allowed error of (u, v)
AGREES = 0.999  # fraction of the pixels that must have the right class, more than two pixels from a change of class


@cache
def scene() -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices and faces: a wall at z = 6, and two boxes and an octahedral ball in front of it."""
    vertices, faces = (
        [np.array([[-40, -40, 6], [40, -40, 6], [-40, 40, 6], [40, 40, 6]], float)],
        [[0, 1, 2], [3, 2, 1]],
    )
    for low, high in (((-1.6, -0.9, 3.2), (-0.5, 0.8, 3.9)), ((0.4, 0.3, 2.6), (1.1, 1.2, 3.0))):
        corners = np.array(np.meshgrid(*zip(low, high, strict=True), indexing="ij")).reshape(3, -1).T
        start = sum(map(len, vertices))
        vertices.append(corners)
        for a, b, c, d in ((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 4, 5), (2, 3, 6, 7), (0, 2, 4, 6), (1, 3, 5, 7)):
            faces += [[start + a, start + b, start + c], [start + d, start + c, start + b]]
    ball = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]]) * 0.6 + [0.7, -0.7, 3.6]
    start = sum(map(len, vertices))
    vertices.append(ball)
    faces += [[start + x, start + 2 + y, start + 4 + z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    return np.concatenate(vertices), np.array(faces)


def cast(camera: Camera) -> NDArray[np.float64]:
    """(H, W) planar depth of the whole scene, whose triangles are visible from both sides."""
    from pyibr.capture import MeshScene

    return np.asarray(MeshScene(*scene()).capture(camera).depth, np.float64)


def source(projection: Projection, unobserved: bool = True) -> ibr.DepthImage:
    width, height = SIZE
    f = 110.0 if projection == "perspective" else 30.0
    camera = Camera([[f, 0, (width - 1) / 2], [0, f, (height - 1) / 2], [0, 0, 1]], SIZE, projection=projection)
    depth = cast(camera).astype(np.float32)
    if unobserved:
        depth[4:20, 40:80] = np.nan  # no depth in a part of the wall
    return ibr.DepthImage(scenes.texture(*scenes.image_coordinates(SIZE)), depth, camera)


def expected(view: ibr.DepthImage, target: Camera) -> NDArray[np.uint8]:
    """Classes of target pixels, found by projecting each pixel's point of the scene to the source."""
    points = target.unproject(pixels_of(target), cast(target).ravel())
    pixel, z = view.camera.project(points)
    width, height = view.camera.size
    inside = (z > 0) & (pixel >= 0).all(axis=1) & (pixel[:, 0] <= width - 1) & (pixel[:, 1] <= height - 1)
    classes = np.full(len(pixel), ibr.PixelClass.OUTSIDE, np.uint8)
    at = np.clip(np.rint(np.where(inside[:, None], pixel, 0)).astype(int), 0, (width - 1, height - 1))
    known = view.valid[at[:, 1], at[:, 0]]
    hidden = z > 1.02 * cast(view.camera)[at[:, 1], at[:, 0]]  # 2 %: less than between any two surfaces here
    classes[inside] = ibr.PixelClass.SEEN
    classes[inside & ~known] = ibr.PixelClass.UNOBSERVED
    classes[inside & hidden] = ibr.PixelClass.HIDDEN
    classes[inside & hidden & ~known] = ibr.PixelClass.UNOBSERVED
    return classes.reshape(target.height, target.width)


def away_from_changes(classes: NDArray[np.uint8], depth: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(H, W) bool: pixels with neither a change of class nor a depth edge within two pixels."""
    around = np.ones((5, 5), np.uint8)
    near, far = (f(depth.astype(np.float32), around) for f in (cv2.erode, cv2.dilate))
    return (cv2.erode(classes, around) == cv2.dilate(classes, around)) & (far < 1.05 * near)


MOVES = {
    "sideways": scenes.pose(center=(0.5, 0, 0)),
    "up": scenes.pose(center=(0, -0.4, 0)),
    "diagonal": scenes.pose(center=(-0.3, 0.3, 0)),
    "forward": scenes.pose(center=(0.1, 0, 0.8)),
    "back": scenes.pose(center=(0, 0.1, -0.7)),
    "round": scenes.pose(yaw=-18, center=(1.3, 0, 0.3)),
    "turned": scenes.pose(yaw=9, pitch=-6, roll=4),
}


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
@pytest.mark.parametrize("move", MOVES)
def test_classes_and_origins_are_the_truths(projection, move):
    view = source(projection)
    target = Camera(source("perspective").camera.K, (150, 120), MOVES[move])
    frame = ibr.warp(view, target, edges="cut", classes=True)
    classes = expected(view, target)
    clear = away_from_changes(classes, cast(target))
    assert clear.mean() > 0.5
    assert (frame.classes == classes)[clear].mean() >= AGREES
    surface = truth.Surface(view, "cut").cast(target)
    assert np.abs(frame.source - surface.source)[surface.interior() & frame.valid].max() <= ON_SURFACE


def test_all_classes_occur():
    """The test above alone would not notice a class that never occurs."""
    view = source("perspective")
    found = [np.unique(expected(view, Camera(view.camera.K, SIZE, pose))) for pose in MOVES.values()]
    assert set(np.concatenate(found)) == set(ibr.PixelClass)


@pytest.mark.parametrize("count", [1, 2])
def test_what_shows_its_back_is_hidden(count):
    """A target behind a patch of surface sees only its back: the rays end at the patch, between it and the source."""
    view = source("perspective")
    depth = np.full_like(view.depth, np.nan)
    depth[40:90, 60:110] = 3.0
    views = [ibr.DepthImage(view.color, depth, view.camera.moved(0.05 * i, 0, 0)) for i in range(count)]
    target = Camera(view.camera.K, SIZE, scenes.pose(yaw=180, center=(0.1, 0.1, 6)))
    with pytest.warns(UserWarning, match="nothing"):
        frame = ibr.warp(views, target, classes=True)
    back = np.logical_or.reduce([ibr.warp(one, target, side="back").valid for one in views])
    assert not frame.valid.any() and back.mean() > 0.1
    hidden = frame.classes[back] == ibr.PixelClass.HIDDEN
    assert np.count_nonzero(~hidden) <= 1  # 1: at the epipole, no line of the sweep meets anything


@pytest.mark.parametrize("sample", ["linear", "nearest"])
@pytest.mark.parametrize("method", ["epipolar", "search"])
def test_the_frame_is_the_same_with_classes(method, sample):
    view = source("perspective")
    target = view.camera.moved(0.3, 0.1, 0.2)
    plain = ibr.warp(view, target, method=method, interpolation=sample, edges="cut")
    frame = ibr.warp(view, target, method=method, interpolation=sample, edges="cut", classes=True)
    np.testing.assert_array_equal(frame.color, plain.color)
    np.testing.assert_array_equal(frame.depth, plain.depth)
    np.testing.assert_array_equal(frame.classes == ibr.PixelClass.SEEN, plain.valid)
    np.testing.assert_array_equal(np.isfinite(frame.source).all(axis=-1), plain.valid)


def test_what_belongs_to_the_source_is_carried_over_by_a_gather():
    view = source("perspective")
    frame = ibr.warp(view, view.camera.moved(0.3, 0.1, 0.2), edges="cut", classes=True)
    across, down = np.ascontiguousarray(np.moveaxis(frame.source, -1, 0))
    carried = cv2.remap(view.color, across, down, cv2.INTER_LINEAR)
    # 3 levels of 255: cv2 interpolates four samples, the warp three, and cv2 rounds positions to 1/32 of a pixel. Torn
    # cells are left out: there cv2 mixes both sides of the edge, and the warp does not.
    torn = edges_of(view)
    whole = ~(torn.right[:-1, :-1] | torn.right[1:, :-1] | torn.below[:-1, :-1] | torn.below[:-1, 1:])
    x, y = (
        np.clip(np.nan_to_num(a).astype(int), 0, n - 2) for a, n in zip((across, down), view.camera.size, strict=True)
    )
    compared = frame.valid & whole[y, x]
    assert compared.sum() > 0.95 * frame.valid.sum()
    assert np.abs(carried.astype(int) - frame.color)[compared].max() <= 3


def test_of_several_views_the_one_that_shows_is_told_and_holes_are_what_knows_most():
    first = source("perspective", unobserved=False)
    camera = first.camera.moved(0.8, 0, 0)
    second = ibr.DepthImage(255 - first.color, cast(camera).astype(np.float32), camera)
    target = first.camera.moved(0.4, 0.3, 0.1)
    both = ibr.warp([first, second], target, edges="cut", classes=True, blend="nearest")
    alone = [ibr.warp(view, target, edges="cut", classes=True) for view in (first, second)]
    np.testing.assert_array_equal(both.classes, np.minimum(alone[0].classes, alone[1].classes))
    assert set(np.unique(both.view)) >= {0, 1}
    for number, frame in enumerate(alone):
        shown = both.view == number
        # Margins through which the other view has looked are removed, so that a few pixels show what is behind them.
        is_same = (both.source[shown] == frame.source[shown]).all(axis=1)
        assert is_same.mean() > 0.995
        np.testing.assert_array_equal(both.color[shown][is_same], frame.color[shown][is_same])
    np.testing.assert_array_equal(both.view >= 0, both.valid)


@pytest.mark.parametrize("method", ["epipolar", "search"])
@pytest.mark.parametrize("number", [1, 2])
def test_origins_alone_are_those_that_come_with_classes(method, number):
    view = source("perspective")
    views = [view, ibr.DepthImage(view.color, view.depth, view.camera.moved(0.2, 0, 0))][:number]
    target = view.camera.moved(0.3, 0.1, 0.2)
    alone, plain = (ibr.warp(views, target, method=method, origins=asked) for asked in (True, False))
    both = ibr.warp(views, target, method=method, origins=True, classes=True)
    assert alone.classes is None
    np.testing.assert_array_equal(alone.color, plain.color)
    np.testing.assert_array_equal(alone.source, both.source)
    np.testing.assert_array_equal(alone.view, both.view)
    np.testing.assert_array_equal(alone.view >= 0, alone.valid)
    assert alone.source.dtype == np.float32 and alone.view.dtype == np.int32


def test_frames_that_are_given_forget_classes_that_are_not_asked_for():
    view = source("perspective")
    kept = ibr.warp(view, view.camera.moved(0.3, 0, 0), classes=True)
    again = ibr.warp(view, view.camera.moved(0.1, 0, 0), out=kept)
    assert again.color is kept.color
    assert again.classes is again.source is again.view is None


def messy(size: tuple[int, int], projection: Projection, seed: int) -> ibr.DepthImage:
    """A slope with objects in front. Depth is noisy for odd seeds; no, some or most samples are missing by seed % 3."""
    rng = np.random.default_rng(seed)
    x, y = scenes.image_coordinates(size)
    depth = 4 + 1.5 * rng.standard_normal() * x + 1.5 * rng.standard_normal() * y
    for _ in range(rng.integers(2, 9)):
        at, radius = rng.uniform(-1, 1, 2), rng.uniform(0.05, 0.5)
        thing = np.maximum(np.abs(x - at[0]), np.abs(y - at[1])) < radius
        depth[thing] = rng.uniform(1, 3) + 0.4 * rng.standard_normal() * (x - at[0])[thing]
    depth += (seed % 2) * 0.02 * rng.standard_normal(depth.shape)
    depth[rng.random(depth.shape) < (0.0, 0.02, 0.6)[seed % 3]] = np.nan
    camera = scenes.source_camera(size, projection)
    return ibr.DepthImage(scenes.texture(x, y), np.maximum(depth, 0.3).astype(np.float32), camera)


def by_own_rays(view: ibr.DepthImage, target: Camera) -> NDArray[np.int64]:
    """(H, W) classes of holes: each pixel's ray is followed in float64, and compared with the nearest samples."""
    origin, ahead = np.split(rays_of(target), 2, axis=1)
    points = origin + (1 / np.linspace(20, 0.01, 500))[:, None, None] * ahead
    place, z = view.camera.project(points.reshape(-1, 3))
    size = np.array(view.camera.size)
    inside = (z > 0) & ((place >= -0.5) & (place <= size - 0.5)).all(axis=1)
    at = tuple(np.clip(np.rint(np.where(inside[:, None], place, 0)).astype(int), 0, size - 1).T[::-1])
    state = np.where(
        inside, np.where(view.valid[at], ibr.PixelClass.HIDDEN, ibr.PixelClass.UNOBSERVED), ibr.PixelClass.OUTSIDE
    )
    free = inside & (z < np.where(view.valid, view.depth, view.depth[view.valid].min())[at])
    free, state = (a.reshape(len(points), -1) for a in (free, state))
    begins = np.where(free.any(axis=0), len(free) - np.argmax(free[::-1], axis=0), 0)
    found = state[np.minimum(begins, len(free) - 1), np.arange(len(ahead))]
    return found.reshape(target.height, target.width)


@pytest.mark.parametrize("seed", [60, 61, 98])  # no samples are missing; single samples; most of them
def test_classes_of_messy_depth_are_those_of_the_pixels_own_rays(seed):
    size = (61, 37)
    view = messy(size, "perspective", seed)
    targets = [Camera(scenes.target_intrinsics(size), size, MOVES[move]) for move in ("forward", "round")]
    frames = ibr.warp(view, targets, classes=True)
    holes = ~np.array([frame.valid for frame in frames])
    found, rays = np.array([frame.classes for frame in frames]), np.array([by_own_rays(view, t) for t in targets])
    # The sweep's lines pass up to half a pixel beside the pixels' rays, and test one position per column. Among
    # scattered samples this gives other classes.
    assert (found == rays)[holes].mean() >= (0.9 if seed == 98 else 0.98)
