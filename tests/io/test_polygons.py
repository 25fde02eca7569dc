"""Triangulated polygons: the triangles' total area is the polygon's area by the shoelace formula."""

from __future__ import annotations

import numpy as np
import pytest

from pyibr.io.polygons import triangles

U = np.array([[0, 0], [4, 0], [4, 3], [3, 3], [3, 1], [1, 1], [1, 3], [0, 3.0]])
ARROW = np.array([[0, 0], [2, -1], [1, 0], [2, 1.0]])
KEYHOLE = np.array([[0, 0], [4, 0], [4, 4], [0, 4], [0, 0], [1, 1], [1, 3], [3, 3], [3, 1], [1, 1.0]])
"""A square with a hole; a bridge joins the two outlines."""


def comb(count: int) -> np.ndarray:
    """A zigzag polygon, whose teeth hide each other."""
    x = np.arange(count)
    return np.vstack([np.column_stack([x, 1 + 9 * (x % 2)]), np.column_stack([x, 9 * (x % 2)])[::-1]]).astype(float)


def turned(flat: np.ndarray, seed: int) -> np.ndarray:
    """Place a polygon in space at random."""
    axes, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return flat @ axes[:2] + axes[2]


def area(points: np.ndarray) -> np.ndarray:
    """Add up the areas of triangles (M, 3, 3)."""
    return np.linalg.norm(np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]), axis=1).sum() / 2


@pytest.mark.parametrize("flat", [U, ARROW, KEYHOLE, comb(30)], ids=["U", "arrow", "keyhole", "comb"])
@pytest.mark.parametrize("seed", range(5))
def test_concave_polygons_keep_their_area_from_any_corner_either_way_round(flat, seed):
    points = turned(np.roll(flat, seed, axis=0)[:: (-1) ** seed], seed)
    found = triangles(np.array([len(flat)]), points)
    x, y = flat.T
    shoelace = abs((x * np.roll(y, -1) - y * np.roll(x, -1)).sum()) / 2
    assert found.shape == (len(flat) - 2, 3) and area(points[found]) == pytest.approx(shoelace, rel=1e-9)
    across = np.cross(points[found[:, 1]] - points[found[:, 0]], points[found[:, 2]] - points[found[:, 0]])
    assert ((across @ across[np.linalg.norm(across, axis=1).argmax()]) >= -1e-12).all()  # all face the same way


def test_convex_polygons_are_fans_and_what_has_no_area_is_none():
    six = np.column_stack([np.cos(np.arange(6)), np.sin(np.arange(6)), np.zeros(6)])
    found = triangles(np.array([6, 2, 0, 3]), np.vstack([six, six[:2], six[:3]]))
    np.testing.assert_array_equal(found, [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5], [8, 9, 10]])
    assert triangles(np.array([5]), np.zeros((5, 3))).shape == (3, 3)
    assert triangles(np.array([9]), np.random.default_rng(0).random((9, 3))).shape == (7, 3)  # it crosses itself
