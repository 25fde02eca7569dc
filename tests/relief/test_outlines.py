"""Outlines of reliefs, compared with cast rays; they are so distant that pixels use coarser levels of the heights."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import pyibr as ibr
from pyibr.core.camera import Camera
from pyibr.relief.levels import height_levels
from tests.reference.heights import bilinear_height
from tests.relief.solids import Carved, cylinder, grid
from tests.relief.test_truth import WHITE, bricks, spikes

TILES, SCALE = (12, 5), 0.15


def ridges() -> np.ndarray:
    """Heights with ridges one texel wide along v, the direction of the tube's axis."""
    height = np.full((64, 64), 0.1, np.float32)
    height[:, 5::32] = 1
    return height


MAPS = {"bricks": bricks, "spikes": spikes, "ridges": ridges}


@cache
def carved(name: str) -> Carved:
    return Carved(cylinder, MAPS[name](), SCALE, TILES)


def edges(covered: np.ndarray) -> np.ndarray:
    """(H, 2) columns of the first and of the last covered pixel of each row."""
    assert covered.any(axis=1).all()
    return np.stack([covered.argmax(axis=1), covered.shape[1] - 1 - covered[:, ::-1].argmax(axis=1)], axis=1)


@pytest.mark.thorough
@pytest.mark.parametrize("level", [1, 2, 3, 4])
@pytest.mark.parametrize("name", MAPS)
def test_outlines_stay_where_coarser_levels_would_do(name, level):
    """A tube is seen from the side, its ends outside of the picture, so that each row contains two outline pixels.

    Exact distances are precise on a tube, so that only coarser levels could move its outline.
    """
    texel = 2 * np.pi / (TILES[0] * 64)
    across = 1.2 * 2**level * texel  # width of a pixel
    size = int(2.3 / across), int(1.8 / across)
    camera = Camera.look_at((0.9, -3, 0), (0, 0, 0), (0, 0, 1), size, projection="orthographic", height=1.8)
    truth = edges(np.isfinite(carved(name).depth(camera)))
    relief = ibr.ReliefSurface(grid(cylinder, 96, 8), MAPS[name](), WHITE, SCALE, tiles=TILES, distance="exact")
    off = np.abs(edges(ibr.render(relief, camera).valid) - truth)
    assert off.max() <= 1


@pytest.mark.parametrize("shape", [(1, 1), (1, 6), (16, 16), (21, 34)])
def test_a_level_tells_how_much_it_has_lost(shape):
    height = np.random.default_rng(3).random(shape, np.float32)
    made = height_levels(height, 2, ("repeat", "repeat"))
    v, u = ((np.indices(shape) + 0.5).T / shape).T
    for width, tall, start, lost in made.table[:, [0, 1, 2, -1]]:
        level = (made.texels[start : start + width * tall] & 65535).reshape(tall, width) / 65535
        off = np.abs(bilinear_height(level, u.ravel(), v.ravel()) - height.ravel()).max()
        assert off <= lost / 65535 + 1e-4  # heights have 16 bits
    assert made.table[0, -1] == 0
