"""The benchmark of depth edges: its solids, true edges, noises and counts, and its section of the report."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import pyibr as ibr
from benchmarks.cases import QUICK
from benchmarks.results import Record, Result, Skip
from benchmarks.warp import edges
from benchmarks.warp.edge_noises import FOCAL_BASELINE, NOISES, noisy
from benchmarks.warp.edge_scenes import SCENES, Scene
from benchmarks.warp.solids import (
    ONE_SURFACE,
    TWO_SURFACES,
    UNJUDGED,
    Ball,
    Cone,
    Part,
    Polytope,
    Rays,
    Rod,
    Sheet,
    Squares,
    box,
    cast,
    sampled,
)
from tests.benchmarks.test_report import ENVIRONMENT, reported

Array = NDArray[Any]

W, H = 52, 39
CAMERA = ibr.Camera([[47, 0, 25.5], [0, 47, 19], [0, 0, 1]], (W, H))
A, B = np.array([-0.3, -0.2, 1.6]), np.array([0.4, 0.3, 2.3])
WALL = box((-9, -9, 3), (9, 9, 4))


def in_rod(point: Array, round_ends: bool = False) -> Array:
    along = (point - A) @ (B - A) / ((B - A) @ (B - A))
    nearest = A + np.clip(along, 0, 1)[:, None] * (B - A)
    within = np.linalg.norm(point - nearest, axis=1) <= 0.25
    return within if round_ends else within & (along >= 0) & (along <= 1)


def in_cone(point: Array) -> Array:
    along = (point - A) @ (B - A) / ((B - A) @ (B - A))
    away = np.linalg.norm(point - A - along[:, None] * (B - A), axis=1)
    return (along >= 0) & (along <= 1) & (away <= 0.5 * along)


SOLIDS: dict[str, tuple[Part, Callable[[Array], Array]]] = {
    "box": (box(A, B), lambda p: ((p >= A) & (p <= B)).all(1)),
    "hollow": (box((-0.9, -0.8, -1), (0.9, 0.8, 3), hollow=True), lambda p: ~(np.abs(p) <= (0.9, 0.8, 3)).all(1)),
    "ball": (Ball(A, 0.5), lambda p: np.linalg.norm(p - A, axis=1) <= 0.5),
    "rod": (Rod(A, B, 0.25), in_rod),
    "round rod": (Rod(A, B, 0.25, round_ends=True), lambda p: in_rod(p, round_ends=True)),
    "cone": (Cone(A, B, 0.5), in_cone),
    "cone from behind": (Cone(B, A, 0.5), lambda p: in_cone(A + B - p)),
}


def rays_of(camera: ibr.Camera) -> Rays:
    v, u = np.mgrid[: camera.size[1], : camera.size[0]].astype(float)
    return Rays.of(camera, u.ravel(), v.ravel())


@pytest.mark.parametrize("name", SOLIDS)
def test_rays_end_at_the_first_point_within(name: str) -> None:
    """The first of points 2 mm apart on the ray that is inside the solid is at most one step behind the hit."""
    solid, is_within = SOLIDS[name]
    rays, step = rays_of(CAMERA), 0.002
    found = solid.depth(rays)
    assert np.isfinite(found).mean() > 0.05
    first = np.full(found.shape, np.inf)
    for t in np.arange(4, 0.1, -step):
        first[is_within(rays.origin + t * rays.direction)] = t
    both = np.isfinite(found) & np.isfinite(first)
    assert (both == np.isfinite(first)).all()
    assert ((first[both] >= found[both] - 1e-9) & (first[both] <= found[both] + step)).all()
    missed = np.isfinite(found) & ~both  # the ray leaves a corner within a step
    ends = found[missed] + 1e-9
    assert is_within(rays.origin[missed] + ends[:, None] * rays.direction[missed]).all() and missed.mean() < 0.01


def test_flat_parts_lie_in_their_planes() -> None:
    center, along, across = np.array([-0.1, 0, 2]), np.array([0.6, 0.1, 0.3]), np.array([-0.05, 0.3, 0])
    camera = ibr.Camera([[470, 0, 259.5], [0, 470, 194.5], [0, 0, 1]], (10 * W, 10 * H))
    rays, normal = rays_of(camera), np.cross(along, across)
    for blade, area in ((False, np.pi), (True, 1)):
        found = Sheet(center, along, across, blade).depth(rays)
        hit = np.isfinite(found)
        point = rays.origin[hit] + found[hit][:, None] * rays.direction[hit]
        np.testing.assert_allclose((point - center) @ normal, 0, atol=1e-12)
        # A plane passes through c and has a normal n, whose length is the sheet's unit of area. A pixel at depth z sees
        # z^3 / (f^2 |c n|) units of it. Outlines add an error of at most 1 %.
        assert (found[hit] ** 3 / abs(center @ normal) / 470**2).sum() == pytest.approx(area, rel=0.01)
    squares = Squares(A, np.eye(3), 0.2).depth(rays_of(CAMERA))
    assert np.isfinite(squares).mean() == pytest.approx(0.5, abs=0.03)
    assert (squares[np.isfinite(squares)] == A[2]).all()


def test_truth_of_a_ball_before_a_wall_is_its_outline() -> None:
    depth, right, below = sampled([[Ball(A, 0.5)], [WALL]], CAMERA)
    on_ball = depth < 2.9
    assert np.array_equal(right == TWO_SURFACES, on_ball[:, 1:] != on_ball[:, :-1])
    assert np.array_equal(below == TWO_SURFACES, on_ball[1:] != on_ball[:-1])
    assert not (right == UNJUDGED).any() and not (below == UNJUDGED).any()


def test_truth_knows_seams_limbs_small_steps_and_what_is_missing() -> None:
    """The scenes are a box on a floor, a rod bent in front of itself, a step of 1 %, and a ball without background."""
    floor = Polytope(np.array([[0.0, -1, 0]]), np.array([-0.4]))
    stands = box((-0.3, 0, 2), (0.3, 0.4, 2.5))
    _, right, below = sampled([[stands], [floor], [WALL]], CAMERA)
    is_box = np.isfinite(stands.depth(rays_of(CAMERA))).reshape(H, W)
    foot, top = is_box[:-1] & ~is_box[1:], ~is_box[:-1] & is_box[1:]
    assert foot.any() and (below[foot] == ONE_SURFACE).all()
    assert top.any() and (below[top] == TWO_SURFACES).all()
    assert ((right == TWO_SURFACES) == (is_box[:, 1:] != is_box[:, :-1]))[: H // 2].all()

    bend = [Rod(np.array([-0.5, 0, 2]), np.array(end), 0.12) for end in ((0.5, 0, 2), (0.4, 0.1, 1.5))]
    _, right, below = sampled([bend], CAMERA)
    assert (below == TWO_SURFACES).any() and (below == ONE_SURFACE).any() and (below == UNJUDGED).any()

    _, right, below = sampled([[box((-9, -9, 2.97), (0, 9, 5))], [WALL]], CAMERA)
    assert (right == TWO_SURFACES).sum() == H and (below == ONE_SURFACE).all()
    _, right, below = sampled([[Ball(A, 0.5)]], CAMERA)
    assert set(np.unique(right)) == {UNJUDGED, ONE_SURFACE}


def test_what_stands_between_samples_hides_no_surface_and_no_gap_of_one_depth_is_an_edge() -> None:
    """Between samples there is a hair in front of a wall, then a slit between two plates of equal depth."""
    hair = [Rod(np.array([0.5 / 47, -2, 2]), np.array([0.5 / 47, 2, 2]), 0.001)]
    slit = 0.5 * 2 / 47
    plates = [[box((-9, -9, 2), (slit - 0.005, 9, 2.1))], [box((slit + 0.005, -9, 2), (9, 9, 2.1))]]
    camera = ibr.Camera([[47, 0, 25], [0, 47, 19], [0, 0, 1]], (W, H))
    _, right, _ = sampled([hair, [WALL]], camera)
    assert (right == ONE_SURFACE).all()
    _, right, _ = sampled([*plates, [WALL]], camera)
    assert (right[:, 25] == UNJUDGED).all() and (np.delete(right, 25, 1) == ONE_SURFACE).all()


@pytest.mark.parametrize("scene", SCENES, ids=[scene.name for scene in SCENES])
def test_scenes_are_resolved_and_the_same_each_time(scene: Scene) -> None:
    camera = scene.camera(W, H)
    depth, part = cast(scene.build(), rays_of(camera))
    again, _ = cast(scene.build(), rays_of(camera))
    assert np.array_equal(depth, again)
    assert (part >= 0).mean() > 0.2 and (depth > 0.5).all()
    assert scene.is_resolved(320)


def test_there_are_scenes_of_each_kind_and_each_name_is_one() -> None:
    assert len({scene.name for scene in SCENES}) == len(SCENES) >= 28
    assert {scene.across > 0 for scene in SCENES} == {True, False}
    assert len(NOISES) == 9


@pytest.mark.parametrize("noise", NOISES)
def test_noise_is_what_its_name_says(noise: str) -> None:
    """Noise has the named steps, or the named standard deviation, which 40,000 samples show to 1 %."""
    rng = np.random.default_rng(5)
    depth = rng.uniform(1, 4, (163, 251))
    made = noisy(depth, noise, 7)
    assert np.array_equal(made, noisy(depth, noise, 7))
    assert noise == "none" or not np.array_equal(made, depth.astype(np.float32))
    off, far = made - depth, np.abs(1 / made - 1 / depth)
    steps = {"none": 0, "millimetres": 0.0005, "centimetres": 0.005}
    deviations: dict[str, tuple[Array, float]] = {
        "3 mm": (off, 0.003),
        "0.1 px of disparity": (FOCAL_BASELINE * (1 / made - 1 / depth), 0.1),
        "0.5 % of depth": (off / depth, 0.005),
        "blurred": (off / depth, 0.01),
    }
    if noise in steps:
        assert np.abs(off).max() <= steps[noise] + 1e-6
    elif noise in deviations:
        values, deviation = deviations[noise]
        assert values.std() == pytest.approx(deviation, rel=0.02)
        beside = np.corrcoef(values[:, :-1].ravel(), values[:, 1:].ravel())[0, 1]
        assert beside > 0.95 if noise == "blurred" else abs(beside) < 0.02
    else:
        step = 0.25 / FOCAL_BASELINE if noise == "quarter-pixel disparity" else np.ptp(1 / depth) / 255
        assert 0.49 * step < far.max() <= 0.5 * step + 1e-6
        assert len(np.unique(made)) <= np.ptp(1 / depth) / step + 2


def test_counts_are_those_of_pairs_that_are_known() -> None:
    """One plate is twice as far away as the other: a ratio below 2 tears the edge, and a ratio above 2 bridges it."""
    things = [[box((-9, -9, 2), (0.01, 9, 2.1))], [box((-9, -9, 4), (9, 9, 4.1))]]
    depth, right, below = sampled(things, CAMERA)
    view = edges.view_of(depth, CAMERA, "two plates", "none")
    assert edges.torn_and_sheets(view, 1.5, right, below) == (0, 0)
    assert edges.torn_and_sheets(view, 2.5, right, below) == (0, H)
    is_one = np.full_like(right, ONE_SURFACE)
    assert edges.torn_and_sheets(view, 1.5, is_one, below) == (H, 0)
    across = edges.view_of(depth[:, :H].T.copy(), ibr.Camera(np.eye(3), (H, H)), "two plates", "none")
    edge_below = np.ascontiguousarray(right[:, : H - 1].T)
    assert edges.torn_and_sheets(across, 2.5, np.zeros((H, H - 1), np.int8), edge_below) == (0, H)


def test_cases_are_of_all_noises_and_ways() -> None:
    case, *others = edges.cases(QUICK)
    work = case.prepare()
    assert not isinstance(work, Skip) and work.read is not None
    records = list(work.read())
    assert {record.subject for record in records} == set(edges.WAYS)
    assert all(len(record.values) == len(NOISES) for record in records) and len(records) == 2 * len(edges.WAYS)
    every = list(edges.cases(replace(QUICK, edge_scenes=1)))
    small = {case.parameters["scene"] for case in every}
    assert 0 < len(others) < len(every) - 1
    assert "fine chequer" not in small and "grid" in small


def canned(size: str, scene: str, counts: dict[str, tuple[list[float], list[float]]]) -> list[Record]:
    parameters = {"size": size, "scene": scene, "noises": "none, blurred"}
    return [
        Record(way, quantity, "samples", parameters, values)
        for way, both in counts.items()
        for quantity, values in zip((edges.TORN, edges.SHEETS), both, strict=True)
    ]


def test_section_judges_totals_and_shows_losses(tmp_path: Path) -> None:
    result = Result("edges", ENVIRONMENT)
    for size in ("320 x 240", "60 x 45"):
        for scene, sheets in (("a", 4.0), ("b", 1100.0)):
            counts = {edges.AUTOMATIC: ([15.0, 5.0], [sheets, 0.0]), edges.BASE: ([50.0, 7.0], [500.0, 3.0])}
            counts["cut_ratio=1.02"] = ([80.0, 90.0], [1.0, 1.0])
            result.records += canned(size, scene, counts)
    text = reported(result, tmp_path)
    assert "images of 2 scenes" in text
    assert "| 320 x 240 | none | 30 / 1,104 | 160 / 2 | 100 / 1,000 | met | met |" in text
    assert "| 320 x 240 | blurred | 10 / 0 | 180 / 2 | 14 / 6 | **not met** | met |" in text
    assert "| 60 x 45 | none | 30 / 1,104 | 160 / 2 | 100 / 1,000 | met | **not met** |" in text
    assert "8 in all. In 0 rows the default test tears more samples" in text
    assert "| 320 x 240 | b | none | 15 / 1,100 | 80 / 1 | 50 / 500 |" in text
    assert "| 320 x 240 | a | none |" not in text


def test_section_without_losses_shows_none(tmp_path: Path) -> None:
    result = Result("edges", ENVIRONMENT)
    same = ([2.0, 3.0], [4.0, 5.0])
    result.records += canned("320 x 240", "a", {way: same for way in edges.WAYS})
    text = reported(result, tmp_path)
    assert "| 320 x 240 | none | 2 / 4 | 2 / 4 | 2 / 4 | **not met** | met |" in text
    assert "Where the ratio is better" not in text
