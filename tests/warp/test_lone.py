"""The sweep and the search agree on isolated samples, which may lie between the sweep's lines."""

from __future__ import annotations

from functools import partial
from itertools import product
from typing import Any

import numpy as np
import pytest

import pyibr as ibr
from pyibr.core.camera import Camera, Projection
from pyibr.opencl.device import one_call
from pyibr.picture.surface import surface_of
from tests.exact import off, ties
from tests.one_lane import both_forms

SIZE = (123, 91)
MOVES = {
    "aside": (0.4, 0.33, 0.0),
    "aslant": (-0.7, 0.45, 0.1),
    "forward": (0.03, -0.02, 0.6),
    "back": (0.1, 0.0, -0.5),
}
LIMIT = 0.001
"""Fraction of the pixels that may differ: the sweep cannot show objects that none of its lines meets."""


def pins(rng: np.random.Generator) -> np.ndarray:
    """Single samples and pairs of samples, in front of or behind an oblique wall."""
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    depth = 4.0 + 0.004 * x - 0.003 * y
    for step, wide in ((-1.3, 1), (-0.7, 2), (0.6, 1)):
        at = rng.random(depth.shape) < 0.006
        for k in range(wide):
            depth[:, k:][at[:, : SIZE[0] - k]] += step
    return np.clip(depth, 2.0, 6.0)


def crumbs(rng: np.random.Generator) -> np.ndarray:
    """A wall in pieces one to three samples wide, as from a depth camera."""
    depth = 3.5 + 0.5 * np.sin(np.arange(SIZE[0]) / 9.0) + np.zeros((SIZE[1], 1))
    depth += rng.normal(0, 0.004, depth.shape)
    depth[rng.random(depth.shape) < 0.25] = np.nan
    depth[::4] = depth[:, ::3] = np.nan
    return depth


def grains(rng: np.random.Generator) -> np.ndarray:
    """White noise, which a cut ratio tears into single triangles."""
    return rng.uniform(2.5, 4.0, SIZE[::-1])


def tongues(rng: np.random.Generator) -> np.ndarray:
    """Bars along rows, columns and diagonals, one sample wide, in front of a wall and connected with it."""
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    depth = np.full(SIZE[::-1], 4.5)
    for bar in (y % 23 == 11, x % 29 == 7, (x + y) % 41 == 3, (x - y) % 37 == 5):
        depth[bar & (rng.random(SIZE[::-1]) < 0.9)] = 3.0
    return depth


SCENES = {"pins": pins, "crumbs": crumbs, "grains": grains, "tongues": tongues}


def camera(projection: Projection) -> Camera:
    f = 110.0 if projection == "perspective" else 28.0  # the same field of view at distance 4
    return Camera([[f, 0, 61.2], [0, f, 44.7], [0, 0, 1]], SIZE, projection=projection)


def differing(view: ibr.DepthImage, target: Camera, **options: Any) -> np.ndarray:
    """(H, W) bool: pixels where sweep and search differ, except where rays pass an end of the surface."""
    seen = partial(ibr.warp, view, method="search", **options)
    wrong = off(ibr.warp(view, target, **options).depth, seen(target).depth)
    return wrong & ~ties(lambda other: seen(other).depth, target) if wrong.any() else wrong


def scene_of(name: str, projection: Projection) -> ibr.DepthImage:
    depth = SCENES[name](np.random.default_rng(len(name))).astype(np.float32)
    return ibr.DepthImage(None, depth, camera(projection))


@pytest.mark.parametrize("move", MOVES)
@pytest.mark.parametrize("target", ["perspective", "orthographic"])
@pytest.mark.parametrize("source", ["perspective", "orthographic"])
@pytest.mark.parametrize(
    ("scene", "options"),
    [
        *product(("pins", "crumbs"), ({"edges": "connect"}, {"cut_ratio": 1.05}, {})),
        *product(("tongues",), ({"edges": "connect"}, {"cut_ratio": 1.05})),
        ("grains", {"cut_ratio": 1.05}),
    ],
    ids=str,
)
def test_sweep_sees_what_search_sees(scene, options, source, target, move):
    view, there = scene_of(scene, source), camera(target).moved(*MOVES[move])
    wrong = differing(view, there, **options)
    assert wrong.mean() <= LIMIT, f"{wrong.sum()} pixels: {np.argwhere(wrong)[:10].tolist()}"


@pytest.mark.filterwarnings("ignore:warp. the target camera sees nothing")
@pytest.mark.parametrize("side", ["back", "both"])
@pytest.mark.parametrize("scene", SCENES)
def test_whichever_side_is_shown(scene, side):
    view = scene_of(scene, "perspective")
    there = camera("perspective").moved(*MOVES["aslant"])
    wrong = differing(view, there, edges="cut", cut_ratio=1.05, side=side)
    assert wrong.mean() <= LIMIT, f"{wrong.sum()} pixels: {np.argwhere(wrong)[:10].tolist()}"


@pytest.mark.thorough
@pytest.mark.parametrize(("scene", "move"), [*zip(SCENES, MOVES, strict=True)])
def test_one_lane_sees_what_sixteen_see(scene, move):
    there = camera("perspective").moved(*MOVES[move])
    options: dict[str, Any] = {"cut_ratio": 1.05} if scene == "grains" else {"edges": "connect"}
    wide, one = both_forms(lambda: ibr.warp(scene_of(scene, "perspective"), there, **options).depth)
    assert off(one, wide).mean() <= LIMIT


def test_rays_along_edges_of_no_triangle_see_them():
    """From a target on the source's axis, rays along a diagonal of samples see the edges between samples."""
    depth = np.full((31, 31), np.nan, np.float32)
    steps = np.arange(4, 28)
    depth[steps, 30 - steps] = 3.0 + 0.01 * steps
    here = Camera([[30, 0, 15], [0, 30, 15], [0, 0, 1]], (31, 31))
    there = here.moved(0, 0, 0.5)
    seen = [ibr.warp(ibr.DepthImage(None, depth, here), there, method=m).depth for m in ("epipolar", "search")]
    assert np.isfinite(seen[1]).sum() > 20
    np.testing.assert_allclose(seen[0], seen[1], rtol=1e-5)


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_noise_does_not_stand_out_and_spikes_in_it_do(projection):
    rng = np.random.default_rng(5)
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    deviation = 0.01
    depth = 4.0 + 0.004 * x - 0.003 * y + rng.normal(0, deviation, x.shape)
    rows, columns = np.arange(5, 85, 8), np.arange(24, 104, 8)
    depth[rows, columns] -= 0.5
    view = ibr.DepthImage(None, depth.astype(np.float32), camera(projection))
    with one_call():
        front = surface_of(view, None).prominence.to_host()[..., 0]
    spiked = np.zeros(front.shape, bool)
    spiked[rows, columns // 16] = True
    assert (front[spiked] == np.inf).all()
    # By noise, one sample in 1e8 stands out by 5.7 deviations. Samples at borders, with fewer neighbours, do not count.
    within = (slice(2, -2), slice(1, -1))
    assert (front[within][~spiked[within]] == -np.inf).all()


def test_what_stands_out_hidden_behind_a_wall_changes_nothing():
    rng = np.random.default_rng(4)
    depth = pins(rng).astype(np.float32)
    depth[:, 40:80] = 1.9
    view, there = ibr.DepthImage(None, depth, camera("perspective")), camera("perspective").moved(0.5, 0.35, 0)
    wall = differing(view, there) & (ibr.warp(view, there).depth < 1.95)
    assert not wall.any()
