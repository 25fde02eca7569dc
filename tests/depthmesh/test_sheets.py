"""Holes closed as in the paper: by coarse meshes of the drawn views, which keep triangles across depth edges."""

from __future__ import annotations

import numpy as np
import pytest

import pyibr as ibr
from pyibr.depthmesh import Segmentation
from tests import scenes
from tests.depthmesh.views import DIRECTIONS, PROJECTIONS, six, target
from tests.exact import same_bits


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_sheets_show_in_holes_only(projection):
    view = scenes.stepped((96, 128), projection)
    camera = view.camera.moved(0.35, 0.1, 0)
    closed, bare = (ibr.render(ibr.DepthMeshObject([view], closed=c), camera) for c in ("sheets", False))
    whole = ibr.render(ibr.DepthMesh(view, tolerance=0, segmentation=Segmentation("none")), camera)
    assert closed.guessed is not None and closed.guessed.sum() > 50
    np.testing.assert_array_equal(closed.valid, bare.valid | closed.guessed)
    assert not (bare.valid & closed.guessed).any()
    np.testing.assert_array_equal(closed.depth[bare.valid], bare.depth[bare.valid])
    np.testing.assert_array_equal(closed.color[bare.valid], bare.color[bare.valid])
    # Holes show the view's whole grid, with stretched triangles; the coarse mesh differs from it at outlines.
    sheets = closed.guessed & whole.valid
    assert sheets.sum() >= 0.98 * closed.guessed.sum()
    assert np.isclose(closed.depth, whole.depth, rtol=0.005)[sheets].mean() >= 0.95
    assert (np.abs(closed.color.astype(int) - whole.color).max(axis=2)[sheets] <= 8).mean() >= 0.9


@pytest.mark.thorough
def test_sheets_of_several_views():
    views = six()
    thing, bare = (ibr.DepthMeshObject(views, closed=c) for c in ("sheets", False))
    for direction in DIRECTIONS:
        camera = target(direction)
        frame, without = ibr.render(thing, camera), ibr.render(bare, camera)
        assert frame.guessed is not None
        np.testing.assert_array_equal(frame.valid, without.valid | frame.guessed)
        same_bits(frame, ibr.render(ibr.DepthMeshObject(views, closed="sheets"), camera))
        np.testing.assert_array_equal(thing.occupancy(camera) > 0, frame.valid)
    lit = ibr.render(thing, camera, ibr.Light(direction=(0.2, 0.3, -1)))
    np.testing.assert_array_equal(lit.valid, frame.valid)
