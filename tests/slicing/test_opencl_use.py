"""The slicing kernels in their form for GPUs."""

from __future__ import annotations

import numpy as np
import pytest

import pyibr as ibr
from pyibr.capture import models
from pyibr.core.camera import Camera
from pyibr.images.metrics import silhouette_iou
from pyibr.opencl import device
from pyibr.opencl.watch import Traffic, watching
from tests.one_lane import both_forms, one_lane, unlike
from tests.slicing.solids import looking, torus, views_of_torus


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("slicing", "slices", "projection"),
    [("surface", 16, "orthographic"), ("orthogonal", 16, "perspective"), ("screen", "view", "perspective")],
)
def test_a_surface_in_one_lane(slicing, slices, projection):
    rng = np.random.default_rng(3)
    height, color = rng.random((16, 16), np.float32), rng.integers(0, 256, (8, 8, 3)).astype(np.uint8)
    thing = ibr.SlicedSurface(models.donut(12), height, color, 0.2, tiles=(4, 2), slices=slices, slicing=slicing)
    tall = {"height": 2.6} if projection == "orthographic" else {}
    camera = Camera.look_at((1.5, -2.4, 1.6), (0, 0, 0), (0, 0, 1), (101, 77), fov_y=45, projection=projection, **tall)
    light = ibr.Light(direction=(0.3, 1, -1), shadow_size=128)
    wide, one = both_forms(lambda: ibr.render(thing, camera, light))
    assert wide.valid.sum() > 2000
    # Where a slice just touches the surface, rounding decides whether the pixel shows it or the next slice.
    outlines, depths, colors = unlike(one, wide, rtol=1e-5)
    assert outlines <= 2e-3 and depths <= 0.01 and colors <= 0.01


@pytest.mark.thorough
@pytest.mark.parametrize("kind", ["perspective", "nine, anywhere"])
@pytest.mark.parametrize("make", [ibr.DepthObject, ibr.VisualHull])
def test_an_object_in_one_lane(make, kind):
    camera = looking(torus(), (0.5, 0.4, 1), (101, 77))
    wide, one = both_forms(lambda: ibr.render(make(views_of_torus(kind), slices=64), camera))
    assert silhouette_iou(one.valid, wide.valid) >= 0.999
    _, depths, colors = unlike(one, wide)
    assert depths <= 0.005 and colors <= 0.01


@pytest.mark.thorough
def test_a_work_item_is_a_pixel_in_one_lane_and_a_bin_or_a_block_in_sixteen():
    """This is what kernels/slicing/surface.cl and object.cl document."""
    camera = Camera.look_at((0, 1, 4), (0, 0, 0), (0, 1, 0), (101, 77), fov_y=45)
    surface = ibr.SlicedSurface(models.donut(6), np.ones((2, 2), np.float32), np.zeros((2, 2, 3), np.uint8), 0.1)
    thing = ibr.DepthObject(views_of_torus("four"), slices=16)

    def items() -> dict[str, int]:
        with watching(Traffic()) as seen:
            for made in (surface, thing):
                ibr.render(made, camera)
        return {name: count for _, name, count in seen.of}

    if device.current().profile.lanes == 16:
        wide = items()
        assert (wide["draw_surface"], wide["draw_object"]) == (4 * 3, 26 * 20)  # tiles of 32 x 32 and of 4 x 4 pixels
    with one_lane():
        one = items()
    assert one["draw_surface"] == one["draw_object"] == 101 * 77
