"""Targets moved sideways along rows, columns or diagonals of samples, compared with the exact polyline of the surface.

After such a step, each ray projects to a line of the source that runs through samples, or half-way between them. This
decides which thin and torn parts the ray sees. `tests/reference/lines.py` computes the expected result.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import pyibr as ibr
from pyibr.core.camera import Camera
from pyibr.core.pixelspace import camera_pair
from pyibr.warp.view import Edges, Method
from tests import scenes
from tests.exact import off, ties
from tests.reference.lines import Sideways, sideways_reference
from tests.reference.warp import search_reference

METHODS: tuple[Method, ...] = ("epipolar", "search")
SIZE = (93, 79)
FOCAL = 80.0
NOISE = 0.005  # fraction of the pixels that may be wrong if every sample is an edge
TIE = 1 / 8  # source pixels: closer than this to the middle between two samples, either may be taken as the nearest

STEPS = {
    "right": (0.3, 0.0),
    "left": (-0.3, 0.0),
    "down": (0.0, 0.3),
    "up": (0.0, -0.23),
    "down right": (0.2, 0.2),
    "up left": (-0.2, -0.2),
    "up right": (0.2, -0.2),
    "down left": (-0.2, 0.2),
}
SCENES = (
    "steps in columns",
    "steps in rows",
    "checks",
    "stripes down left",
    "stripes down right",
    "one sample thin",
    "two samples thin",
    "holes",
    "whole disparities",
    "noise of 3 %",
    "noise of 6 %",
    "noise of 100 %",
)
COLUMNS = 1024  # more than any image has columns or rows


@cache
def depth_of(scene: str, size: scenes.Size = SIZE) -> np.ndarray:
    """(H, W) depths of 2 to 4.5."""
    y, x = np.mgrid[: size[1], : size[0]]
    near, far = 2.2, 4.5
    rng = np.random.default_rng(0)
    if scene == "holes":
        depth = np.where((y >= 30) & (y < 50) & (x >= 20) & (x < 60), 2.0, far)
        depth[(7 * x + 3 * y) % 29 == 0] = np.nan
    elif scene == "whole disparities":
        # All steps except "up" move these depths by whole pixels: a step of 0.3 by 6, 12 and 9, one of 0.2 by 4, 8, 6.
        depth = np.choose((x // 7 + y // 5) % 3, (4.0, 2.0, 2.0 / 0.75))
    elif scene.startswith("noise"):
        spread = {"noise of 3 %": 0.1, "noise of 6 %": 0.2, "noise of 100 %": 1.5}[scene]
        depth = rng.uniform(3 - spread / 2, 3 + spread / 2, (size[1], size[0]))
    else:
        before = {
            "steps in columns": x % 9 < 3,
            "steps in rows": y % 9 < 3,
            "checks": (x // 4 + y // 4) % 2 == 1,
            "stripes down left": (x + y) % 9 < 4,
            "stripes down right": (x - y) % 9 < 4,
            "one sample thin": (x % 13 == 5) | (y % 17 == 6),
            "two samples thin": (x % 13 < 2) | (y % 17 < 2),
        }[scene]
        depth = np.where(before, near, far)
    return depth.astype(np.float32)


@cache
def view_of(scene: str, size: scenes.Size = SIZE, turned: bool = False) -> ibr.DepthImage:
    """The scene, seen by a camera with an off-centre principal point; colours are the samples' x and y, divided by
    `COLUMNS`."""
    width, height = size
    K = [[FOCAL, 0, (width - 1) / 2 + 3.3], [0, FOCAL, (height - 1) / 2 - 1.7], [0, 0, 1]]
    pose = scenes.pose(yaw=33, pitch=-21, roll=48, center=(2.1, -3.4, 1.3)) if turned else np.eye(4)
    y, x = np.mgrid[:height, :width].astype(np.float32)
    color = np.dstack([x, y, 0 * x]) / np.float32(COLUMNS)
    # noise=0: otherwise such dense stripes would count as noise, and would not be torn.
    return ibr.DepthImage(color, depth_of(scene, size), Camera(K, size, pose), noise=0.0)


@cache
def seen_of(scene: str, step: tuple[float, float], edges: Edges, size: scenes.Size = SIZE) -> Sideways:
    return sideways_reference(view_of(scene, size), step, edges)


def limit_of(scene: str) -> float:
    return NOISE if scene.startswith("noise") else 0.0


@pytest.mark.parametrize("edges", ["connect", "cut"])
@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("step", STEPS.values(), ids=STEPS.keys())
def test_depth_coverage_and_nearest_samples_are_those_of_the_polylines(step, scene, edges):
    """The nearest sample is the one next to the place where the ray meets the surface."""
    view, seen = view_of(scene), seen_of(scene, step, edges)
    for method in METHODS:
        frame = ibr.warp(view, view.camera.moved(*step, 0), method=method, edges=edges)
        wrong = off(frame.depth, seen.depth) & ~seen.on_end
        assert wrong.mean() <= limit_of(scene), (method, wrong.sum())
        frame = ibr.warp(view, view.camera.moved(*step, 0), method=method, interpolation="nearest", edges=edges)
        away = np.abs(frame.color[..., :2] * COLUMNS - seen.source).max(axis=-1)
        wrong = (frame.valid != np.isfinite(seen.depth)) | (away > 0.5 + TIE)
        assert (wrong & ~seen.on_end).mean() <= limit_of(scene), (method, np.count_nonzero(wrong & ~seen.on_end))
        x, y = np.nan_to_num(frame.color[..., :2] * COLUMNS).astype(int).transpose(2, 0, 1)
        # A step sideways keeps each sample's depth, except for float32's rounding in a dozen operations.
        np.testing.assert_allclose(frame.depth[frame.valid], view.depth[y, x][frame.valid], rtol=2e-6)


@pytest.mark.thorough
@pytest.mark.parametrize("edges", ["connect", "cut"])
@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("step", ["right", "up", "down right", "up right"])
def test_cameras_that_are_turned_in_the_world_step_as_exactly(step, scene, edges):
    view, seen = view_of(scene, turned=True), seen_of(scene, STEPS[step], edges)
    target = view.camera.moved(*STEPS[step], 0)
    along_axis = 0.0 in STEPS[step]
    assert camera_pair(view.camera, target).aligned == along_axis  # lines follow rows in spite of rounding in the poses
    for method in METHODS:
        wrong = off(ibr.warp(view, target, method=method, edges=edges).depth, seen.depth) & ~seen.on_end
        assert wrong.mean() <= limit_of(scene), (method, wrong.sum())


@pytest.mark.parametrize("step", [(0.3, 0.0), (-0.3, 0.0), (0.0, 0.25), (0.0, -0.25)], ids=str)
@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("edges", ["connect", "cut"])
@pytest.mark.parametrize("target", ["shifted", "smaller", "larger"])
def test_rows_between_the_sources_rows(step, scene, edges, target):
    """Stereo pairs whose epipolar lines run between rows of samples: sweep and search agree."""
    view = view_of(scene)
    camera = between(view.camera, target).moved(*step, 0)
    assert camera_pair(view.camera, camera).aligned
    swept, searched = (ibr.warp(view, camera, method=method, edges=edges) for method in METHODS)
    wrong = off(swept.depth, searched.depth)
    wrong &= ~passes_ends(view, camera, edges)
    assert wrong.mean() <= limit_of(scene), wrong.sum()


@pytest.mark.parametrize("scene", ["steps in rows", "checks", "one sample thin", "holes", "noise of 100 %"])
@pytest.mark.parametrize("edges", ["connect", "cut"])
@pytest.mark.parametrize("target", ["shifted", "larger"])
def test_rows_between_the_sources_rows_are_the_references(scene, edges, target):
    view = view_of(scene, (23, 19))
    for step in ((0.3, 0.0), (0.0, -0.25)):
        camera = between(view.camera, target).moved(*step, 0)
        seen = search_reference(view, camera, edges=edges)
        for method in METHODS:
            wrong = off(ibr.warp(view, camera, method=method, edges=edges).depth, seen.depth)
            wrong &= ~passes_ends(view, camera, edges)
            assert wrong.mean() <= limit_of(scene), (method, step, wrong.sum())


def between(camera: Camera, target: str) -> Camera:
    """The camera with other pixels, whose rows and columns lie between the original ones."""
    if target == "shifted":
        return scenes.moved_aside(camera, 0.43, -0.29)
    width, height = camera.size
    return camera.resized(
        (width * 5 // 7, height * 5 // 7) if target == "smaller" else (width * 9 // 5, height * 9 // 5)
    )


def passes_ends(view: ibr.DepthImage, camera: Camera, edges: Edges) -> np.ndarray:
    """(H, W) bool: pixels whose rays pass within a hair of an end of the surface."""
    return ties(lambda target: ibr.warp(view, target, method="search", edges=edges).depth, camera)


def test_nothing_is_nearer_than_the_nearest_sample():
    """Stripes in front of a wall: no depth is nearer than the stripes or farther than the wall."""
    camera = Camera([[80, 0, 47.5], [0, 80, 47.5], [0, 0, 1]], (96, 95))
    depth = np.where(np.arange(96) % 9 < 3, 2.2, 4.5)[None].repeat(95, 0).astype(np.float32)
    view = ibr.DepthImage(np.zeros((95, 96, 3), np.uint8), depth, camera)
    for edges in ("connect", "cut"):
        frame = ibr.warp(view, camera.moved(0.3, 0, 0), edges=edges)
        assert frame.depth[frame.valid].min() >= 2.19, edges
        assert frame.depth[frame.valid].max() <= 4.51, edges
