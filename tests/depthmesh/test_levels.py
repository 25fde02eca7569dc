"""Coarser levels of a view's colours: each texel holds the mean of its valid samples, and their fraction."""

from __future__ import annotations

import numpy as np
import pytest

import pyibr as ibr
from pyibr.depthmesh.levels import color_levels


def halved(image: np.ndarray) -> np.ndarray:
    """Means of 2 x 2 elements; the last row is repeated if the number of rows is odd, likewise the last column."""
    even = np.pad(image, [(0, image.shape[0] % 2), (0, image.shape[1] % 2), (0, 0)], mode="edge")
    return 0.25 * (even[::2, ::2] + even[1::2, ::2] + even[::2, 1::2] + even[1::2, 1::2])


@pytest.mark.parametrize("size", [(1, 1), (6, 1), (4, 5), (5, 4), (16, 16), (13, 7)])
def test_levels_are_means_of_valid_samples(size):
    rng = np.random.default_rng(0)
    color = rng.integers(0, 256, (*size[::-1], 3), dtype=np.uint8)
    depth = np.where(rng.random(size[::-1]) < 0.6, np.float32(2), np.float32(np.nan))
    depth[0, 0] = 2
    view = ibr.DepthImage(color, depth, ibr.Camera([[9, 0, 0], [0, 9, 0], [0, 0, 1]], size))
    there, feather = view.valid[..., None].astype(np.float64), rng.integers(0, 256, size[::-1], dtype=np.uint8)
    sums, levels = np.concatenate([there * color, there], axis=-1), list(color_levels(view, feather))
    assert levels[-1].shape == (1, 1)
    for number, level in enumerate(levels):
        assert level.shape == sums.shape[:2]
        found = np.ascontiguousarray(level).view(np.uint8).reshape(*level.shape, 4)
        part = sums[..., 3:]
        # The fraction is rounded up, so that a texel with a few valid samples is not taken to be empty.
        np.testing.assert_array_equal(found[..., 3], np.ceil(255 * part[..., 0]) if number else feather)
        seen = np.broadcast_to(part > 0, found[..., :3].shape)
        expected = (sums[..., :3] / np.maximum(part, 1e-9))[seen]
        assert np.abs(found[..., :3][seen] - expected).max() <= 0.5 + 1e-3
        assert number == 0 or (found[..., :3][~seen] == 0).all()
        sums = halved(sums)
