"""Levels of height maps: coarser levels are means, and bounds are upper bounds of the heights."""

from __future__ import annotations

import numpy as np
import pytest

from pyibr.relief.levels import height_levels
from tests.reference.heights import bilinear_height

SHAPES = [(1, 1), (1, 5), (7, 13), (16, 16), (64, 48)]


def random(shape: tuple[int, int]) -> np.ndarray:
    return (np.random.default_rng(0).integers(0, 256, shape) / np.float32(255)).astype(np.float32)


@pytest.mark.parametrize("height_bytes", [1, 2])
@pytest.mark.parametrize("shape", SHAPES)
def test_words_hold_a_texel_and_its_neighbours(shape, height_bytes):
    height = random(shape)
    made = height_levels(height, height_bytes, ("repeat", "repeat"))
    most = 255 if height_bytes == 1 else 65535
    words = made.texels[: height.size].reshape(shape)
    np.testing.assert_array_equal(words & most, np.rint(height * most))
    bits = 8 if height_bytes == 1 else 16
    np.testing.assert_array_equal(words >> bits & most, np.rint(np.roll(height, -1, axis=1) * most))
    if height_bytes == 1:
        np.testing.assert_array_equal(words >> 16 & most, np.rint(np.roll(height, -1, axis=0) * most))
        np.testing.assert_array_equal(words >> 24, np.rint(np.roll(height, -1, axis=(0, 1)) * most))


@pytest.mark.parametrize("shape", SHAPES)
def test_levels_halve_down_to_one_texel_and_keep_the_mean(shape):
    made = height_levels(random(shape), 2, ("repeat", "repeat"))
    sizes = made.table[:, :2]
    assert tuple(sizes[0]) == shape[::-1]
    np.testing.assert_array_equal(sizes[1:], np.maximum(sizes[:-1] // 2, 1))
    assert tuple(sizes[-1]) == (1, 1)
    last = made.texels[made.table[-1, 2]] & 65535
    assert abs(last / 65535 - random(shape).mean()) <= len(sizes) / 65535


@pytest.mark.parametrize("height_bytes", [1, 2])
@pytest.mark.parametrize("shape", SHAPES)
def test_no_height_is_above_its_bound(shape, height_bytes):
    height = random(shape)
    made = height_levels(height, height_bytes, ("repeat", "repeat"))
    rng = np.random.default_rng(1)
    rows, columns = shape
    x, y = rng.uniform(0, columns, 2000), rng.uniform(0, rows, 2000)  # in texels, from the first texel's centre
    truth = bilinear_height(height.astype(float), (x + 0.5) / columns, (y + 0.5) / rows)
    tiers, start, pitch, span = made.table[0, 3:7]
    for tier in range(tiers):
        corner = start + span - (span >> tier)
        bounds = made.bounds[corner + ((y.astype(int) >> tier) << pitch) + (x.astype(int) >> tier)]
        assert (bounds / 65535 >= truth - 1e-6).all()
    assert (bounds == np.rint(height.max() * 65535)).all()  # the last tier is one cell
    assert len(made.bounds) % 2 == 0


@pytest.mark.parametrize("shape", [*SHAPES, (1, 64), (64, 1), (65, 3), (3, 65)])
def test_no_bound_is_overwritten(shape):
    """Each cell of each level and tier has its own place in the array, with the greatest height of its texels."""
    height = random(shape)
    made = height_levels(height, 2, ("clamp", "clamp"))
    places: list[int] = []
    for width, tall, first, tiers, start, pitch, span, _ in made.table.tolist():
        heights = made.texels[first : first + width * tall].reshape(tall, width) & 65535
        corners = np.stack([np.pad(heights, 1, "edge")[y : y + tall, x : x + width] for y in (1, 2) for x in (1, 2)])
        for tier in range(tiers):
            side = 2**tier
            for y in range(-(-tall // side)):
                for x in range(-(-width // side)):
                    places.append(start + span - (span >> tier) + (y << pitch) + x)
                    most = corners[:, y * side : (y + 1) * side, x * side : (x + 1) * side].max()
                    assert made.bounds[places[-1]] == most
    assert len(set(places)) == len(places) and max(places) < len(made.bounds)
