"""The relief kernels in their form for GPUs."""

from __future__ import annotations

import numpy as np
import pytest

import pyibr as ibr
from pyibr.capture import models
from pyibr.core.camera import Camera
from tests.one_lane import both_forms, unlike


@pytest.mark.thorough
@pytest.mark.parametrize("options", [{}, {"search": "linear"}, {"distance": "exact"}])
def test_one_lane_is_as_good_as_sixteen(options):
    rng = np.random.default_rng(3)
    height, color = rng.random((16, 32), np.float32), rng.integers(0, 256, (8, 8, 3)).astype(np.uint8)
    thing = ibr.ReliefSurface(models.donut(24), height, color, 0.1, tiles=(4, 2), **options)
    flat = {"projection": "orthographic", "height": 2.6} if "search" in options else {"fov_y": 45}
    camera = Camera.look_at((1.5, -2.4, 1.6), (0, 0, 0), (0, 0, 1), (101, 77), **flat)
    wide, one = both_forms(lambda: ibr.render(thing, camera))
    assert wide.valid.sum() > 2000
    # Rounding decides whether a grazing ray hits, or the pixel shows the surface behind.
    outlines, depths, colors = unlike(one, wide, levels=2)
    assert outlines <= 2e-3 and depths <= 0.01 and colors <= 0.02


@pytest.mark.thorough
@pytest.mark.parametrize("shadow", ["map", "search"])
def test_shadows_in_one_lane(shadow):
    height, color = np.kron(np.eye(4, dtype=np.float32), np.ones((4, 4))), np.full((1, 1, 3), 255, np.uint8)
    thing = ibr.ReliefSurface(models.donut(24), height, color, 0.1, tiles=(6, 3), shadow=shadow)
    camera = Camera.look_at((1.5, -2.4, 1.6), (0, 0, 0), (0, 0, 1), (101, 77), fov_y=45)
    light = ibr.Light(direction=(1, 0.3, -0.5), shadow_size=128)
    assert unlike(*both_forms(lambda: ibr.render(thing, camera, light)), levels=2)[2] <= 0.02
