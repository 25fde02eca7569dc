"""Holes filled from behind, against the plain rule in float64, on masks of all kinds and lines of all directions."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import nullcontext
from functools import cache

import numpy as np
import pytest

from pyibr.core.camera import Camera
from pyibr.opencl.device import current
from pyibr.opencl.memory import copy, upload
from pyibr.picture.target import Target
from pyibr.warp.launches import fill_holes
from tests import scenes
from tests.one_lane import one_lane
from tests.reference.fill import fill_reference

Epipole = tuple[float, float, float]

SIZES: tuple[scenes.Size, ...] = ((1, 1), (7, 13), (61, 37), (1, 60), (60, 1), (131, 101))
MASKS = ("dots", "patches", "few valid", "half", "no hole", "all holes")
DTYPES = (np.uint8, np.float32)
STRAIGHT: dict[str, Epipole] = {
    "right": (300.0, 0.0, 0.0),
    "left": (-300.0, 0.0, 0.0),
    "down": (0.0, 1.0, 0.0),
    "up": (0.0, -7.0, 0.0),
    "down right": (40.0, 40.0, 0.0),
    "up right": (3.0, -3.0, 0.0),
    "none": (0.0, 0.0, 0.0),
}
OTHER: dict[str, Epipole] = {
    "slanted": (1.0, 0.3717, 0.0),
    "nearly a row": (-1.0, 0.00213, 0.0),
    "nearly a column": (0.0213, 1.0, 1e-5),
    "inside": (31.4, 22.7, 1.0),
    "on a pixel": (6.0, 6.0, 1.0),
    "beside": (-403.3, 51.9, 1.0),
    "antipode": (-22.2, -18.9, -1.0),
}


@pytest.fixture(params=[16, 1], ids=["wide", "one lane"])
def lanes(request: pytest.FixtureRequest) -> Iterator[int]:
    with one_lane() if request.param == 1 else nullcontext():
        if current().profile.lanes != request.param:
            pytest.skip("the device is no CPU")
        yield request.param


@cache
def images(size: scenes.Size, mask: str, dtype: type) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Colour, depth and valid. Neighbours' depths are the same background's, in between, and others'."""
    width, height = size
    rng = np.random.default_rng([width, height, MASKS.index(mask)])
    y, x = np.mgrid[:height, :width]
    noise = rng.random((height, width))
    waves = np.sin(0.31 * x + 1.0) + np.sin(0.23 * y + 0.07 * x + 2.0)
    valid = {
        "dots": noise > 0.1,
        "patches": waves + 0.2 * noise > -0.3,
        "few valid": noise < 0.004,
        "half": x + 0.3 * y + 3 * noise < 0.6 * width,
        "no hole": noise >= 0,
        "all holes": noise < 0,
    }[mask]
    depth = np.where(valid, 2.0 + (waves > 0.5) + 0.1 * rng.random((height, width)), np.nan).astype(np.float32)
    color = rng.random((height, width, 3)) * valid[..., None]
    return (color * 255).astype(np.uint8) if dtype is np.uint8 else color.astype(np.float32), depth, valid


def filled(color: np.ndarray, depth: np.ndarray, valid: np.ndarray, epipole: Epipole) -> tuple[np.ndarray, np.ndarray]:
    """Colour and depth by the kernels."""
    height, width = valid.shape
    target = Target(Camera([[50, 0, 0], [0, 50, 0], [0, 0, 1]], (width, height)), color.dtype)
    given = color, depth, valid.astype(np.uint8)
    for array, into in zip(given, (target.color, target.depth, target.valid), strict=True):
        copy(upload(array), into)
    fill_holes(target, np.array(epipole), "background")
    frame = target.frame()
    np.testing.assert_array_equal(frame.valid, valid)
    return frame.color.copy(), frame.depth.copy()


@pytest.mark.parametrize("place", [*STRAIGHT, *OTHER])
@pytest.mark.parametrize("mask", MASKS)
def test_the_farther_end_is_what_fills(place, mask, lanes):
    epipole = (STRAIGHT | OTHER)[place]
    for size in SIZES:
        for dtype in DTYPES:
            given = images(size, mask, dtype)
            expected = fill_reference(*given, epipole)
            assert expected.decided.mean() >= (0.6 if place in OTHER else 1.0)
            color, depth = filled(*given, epipole)
            sure, valid = expected.decided, given[2]
            np.testing.assert_allclose(depth[sure], expected.depth[sure], rtol=2e-6)
            limit = 0.501 if dtype is np.uint8 else 2e-6
            assert np.abs(color[sure] - expected.color[sure]).max(initial=0) <= limit, (size, dtype)
            np.testing.assert_array_equal(color[valid], given[0][valid])
            np.testing.assert_array_equal(depth[valid], given[1][valid])


@pytest.mark.parametrize("place", STRAIGHT)
def test_shared_lines_give_what_each_hole_finds_for_itself(place, lanes):
    """Of an epipole so far away that its direction rounds to the same one, to the bit."""
    x, y, _ = STRAIGHT[place] if any(STRAIGHT[place]) else (-1.0, 0.0, 0.0)
    far = x, y, 1e-20
    for size in SIZES:
        for mask in MASKS:
            for dtype in DTYPES:
                given = images(size, mask, dtype)
                shared, own = filled(*given, STRAIGHT[place]), filled(*given, far)
                for one, other in zip(shared, own, strict=True):
                    np.testing.assert_array_equal(one, other)
