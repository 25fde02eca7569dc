"""The depth meshes' kernels in their form for GPUs."""

from __future__ import annotations

import numpy as np
import pytest

import pyibr as ibr
from pyibr.depthmesh import Segmentation
from pyibr.images import DepthImage
from tests import scenes
from tests.depthmesh.views import PROJECTIONS, TESTS, rough
from tests.one_lane import both_forms, unlike


@pytest.mark.thorough
@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("test", TESTS)
def test_trees_in_one_lane(test, projection):
    for size in ((2, 2), (7, 13), (65, 40)):
        view = rough(np.random.default_rng(0), size, projection, 0.05, 0.02)
        if size == (2, 2):
            view = scenes.flat(size, projection)
        rule = Segmentation(test, angle=20, depth_range=0.03, gap=0.03)
        camera = view.camera.moved(0.4, 0.1, -0.2)

        def made(view: DepthImage = view, rule: Segmentation = rule, camera: ibr.Camera = camera) -> list[np.ndarray]:
            thing = ibr.DepthMesh(DepthImage(view.color, view.depth, view.camera), segmentation=rule)
            tree, side = thing.tree, thing.tree.side
            known, *fields = (a.to_host()[:, : side + 1] for a in (*tree.errors.values(), tree.states))
            meshes = [thing.triangulate(camera, tolerance=t) for t in (0, 1.5)] + [
                thing.simplify(e) for e in (0.011, 0.2)
            ]
            return [known, *(np.where(known >= 0, f, 0) for f in fields), thing.normals, *(m.faces for m in meshes)]

        for a, b in zip(*both_forms(made), strict=True):
            if a.shape == b.shape:
                # Compilers fuse other products and sums: values of about 5 differ by a few roundings of 2^-24.
                assert np.isclose(a, b, rtol=1e-5, atol=1e-5).mean() >= 0.999
            else:  # triangles: rounding decides for errors just at the limit
                assert abs(len(a) - len(b)) <= 0.01 * len(a)


@pytest.mark.thorough
@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("blend", ["quality", "position", "nearest"])
def test_pictures_in_one_lane(blend, projection):
    def drawn() -> list[ibr.Frame | np.ndarray]:
        source = scenes.stepped((96, 128), projection)
        views = [
            DepthImage(source.color, source.depth, source.camera),
            DepthImage(source.color, source.depth + np.float32(0.001), source.camera.moved(0.02, 0, 0)),
        ]
        camera = source.camera.moved(0.3, 0.1, 0).resized((101, 77))
        thing = ibr.DepthMeshObject(views, tolerance=1.0, blend=blend)
        wall = ibr.Mesh([[-9, -9, 9], [9, -9, 9], [0, 9, 9]], [[0, 1, 2]])
        return [ibr.render(thing, camera), ibr.render([wall, thing.meshes[0]], camera), thing.occupancy(camera)]

    wide, one = both_forms(drawn)
    for a, b in zip(wide[:2], one[:2], strict=True):
        assert a.valid.sum() > 2000
        # Corners are rounded to 1/256 of a pixel relative to the region that a work-item draws. Pixels at outlines and
        # on edges between triangles may differ.
        outlines, depths, colors = unlike(a, b)
        assert outlines <= 5e-4 and depths <= 0.005 and colors <= 0.01
    assert (wide[2] != one[2]).mean() <= 0.01
