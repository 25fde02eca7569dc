"""Feathers: towards the ends of its surface a view gets less weight, so that the blend has no seams there."""

from __future__ import annotations

import numpy as np
import pytest

import pyibr as ibr
from pyibr.depthmesh.levels import feathers_of
from tests.depthmesh.views import PROJECTIONS, cells_of, rough

FADED = 8  # samples over which the weight falls


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_samples_count_by_their_distance_to_the_ends(projection):
    size = (61, 47)
    view = rough(np.random.default_rng(0), size, projection, noise=0.002, holes=0.002)
    mesh = ibr.DepthMesh(view)
    found, drawn = feathers_of(mesh.tree), np.pad(cells_of(mesh).all(axis=2), 1)
    ends = np.argwhere(~(drawn[1:, 1:] & drawn[1:, :-1] & drawn[:-1, 1:] & drawn[:-1, :-1]))
    distance = np.abs(np.indices(size[::-1])[..., None] - ends.T[:, None, None]).max(axis=0).min(axis=-1)
    assert len(np.unique(distance)) > FADED and (~view.valid).any()
    expected = np.maximum(255 * np.minimum(distance, FADED) // FADED, 1)
    np.testing.assert_array_equal(found, np.where(view.valid, expected, 0))


@pytest.mark.parametrize("blend", ["quality", "position"])
def test_where_a_view_ends_the_other_has_all_weight(blend):
    """Two views show a wall from one place; the second view's image is the right half of the first view's."""
    whole = ibr.Camera([[60, 0, 40], [0, 60, 20], [0, 0, 1]], (81, 41))
    half = ibr.Camera([[60, 0, 0], [0, 60, 20], [0, 0, 1]], (41, 41))  # begins at column 40 of `whole`
    one, other = (
        ibr.DepthImage(np.full((41, camera.width, 3), gray, np.uint8), np.full((41, camera.width), 2.0), camera)
        for camera, gray in ((whole, 50), (half, 250))
    )
    frame = ibr.render(ibr.DepthMeshObject([one, other], blend=blend), whole)
    row = frame.color[20, :, 0].astype(float)
    x = np.arange(81)
    ends = [np.minimum(np.minimum(x, 80 - x), FADED), np.clip(np.minimum(x - 40, 80 - x), 0, FADED)]
    first, second = (np.maximum(255 * end // FADED, 1) * (x >= start) for end, start in zip(ends, (0, 40), strict=True))
    # 1: rounding by half a level, and weights of 8 bits.
    assert np.abs(row - (50 * first + 250 * second) / (first + second)).max() <= 1
    assert np.abs(np.diff(row[8:73])).max() <= 200 / FADED
