"""The forward warp and the search equal their float64 references in tests/reference, except for a few pixels."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest

import pyibr as ibr
from pyibr.core.camera import Camera, Projection
from tests import scenes
from tests.reference.warp import forward_reference, search_reference

PROJECTIONS = ("perspective", "orthographic")
SIZE, TARGET = (31, 22), (27, 24)
SCENES = {scenes.smooth: "AFH", scenes.stepped: "BDI", scenes.holed: "CEG"}  # and places of the epipole
ROUNDING = 2e-6  # relative: float32 depth after a few dozen operations


@cache
def poses_of(scene: Callable[..., ibr.DepthImage], source: Projection, target: Projection) -> list[scenes.Pose]:
    return scenes.some_cameras(scene(SIZE, source), SCENES[scene], TARGET, target)[PROJECTIONS.index(source) :: 2]


@pytest.mark.parametrize("splat", [1, 2, 3])
@pytest.mark.parametrize("source", PROJECTIONS)
@pytest.mark.parametrize("target", PROJECTIONS)
@pytest.mark.parametrize("scene", SCENES)
def test_forward_is_its_reference(scene, source, target, splat):
    view = scene(SIZE, source)
    drawn = 0
    for pose in poses_of(scene, source, target)[splat % 2 :: 2]:
        found = ibr.warp(view, pose.camera, method="forward", splat=splat)
        expected = forward_reference(view, pose.camera, splat)
        # Rounding decides which pixel gets a sample on a border between two, and which of two equal depths is nearer.
        same = found.valid == expected.valid
        assert np.count_nonzero(~same) <= 2, pose.name
        both = found.valid & expected.valid
        close = both & np.isclose(found.depth, expected.depth, rtol=ROUNDING, atol=0)
        assert np.count_nonzero(both & ~close) <= 2 * splat, pose.name
        # Two samples of one depth in float64 may differ in float32: then the two pictures may show different samples.
        assert (found.color == expected.color).all(axis=-1)[close].mean() >= 0.97, pose.name
        drawn += np.count_nonzero(both)
    assert drawn > 300


@pytest.mark.parametrize("scale", [0.5, 0.25])
@pytest.mark.parametrize("splat", [1, 2, 3])
def test_ties_go_to_the_earlier_sample(scale, splat):
    """A fronto-parallel wall, drawn smaller. All values are binary fractions, so samples on one pixel tie exactly."""
    camera = Camera([[16, 0, 7.5], [0, 16, 7.5], [0, 0, 1]], (16, 16))
    color = np.zeros((16, 16, 3), np.uint8)
    color[..., 0] = np.arange(256).reshape(16, 16)
    view = ibr.DepthImage(color, np.full((16, 16), 2, np.float32), camera)
    small = Camera([[16 * scale, 0, 3.8125], [0, 16 * scale, 3.9375], [0, 0, 1]], (8, 8))
    found = ibr.warp(view, small, method="forward", splat=splat)
    expected = forward_reference(view, small, splat)
    np.testing.assert_array_equal(found.valid, expected.valid)
    np.testing.assert_array_equal(found.color, expected.color)
    np.testing.assert_array_equal(found.depth, expected.depth.astype(np.float32))


def test_a_larger_splat_closes_gaps():
    view = scenes.smooth((64, 48))
    camera = view.camera.resized((160, 120)).moved(0.1, 0, 0)
    cover = [ibr.warp(view, camera, method="forward", splat=splat).valid for splat in (1, 2, 3)]
    assert cover[0].mean() < 0.3
    # Samples are 2.5 pixels apart, less than the splats' 3 pixels, so that the surface has no gap.
    middle = np.s_[10:-10, 20:-20]
    assert cover[2][middle].all()
    assert (cover[1] >= cover[0]).all()
    assert cover[0].sum() < cover[1].sum() < cover[2].sum()


@pytest.mark.parametrize("sample", ["linear", "nearest"])
@pytest.mark.parametrize("source", PROJECTIONS)
@pytest.mark.parametrize("target", PROJECTIONS)
@pytest.mark.parametrize("scene", SCENES)
def test_search_is_its_reference(scene, source, target, sample):
    view = scene(SIZE, source)
    compared = 0
    for number, pose in enumerate(poses_of(scene, source, target)[sample == "nearest" :: 2]):
        options: dict[str, Any] = {
            "edges": ("connect", "cut")[number % 2],
            "side": ("front", "both", "back")[number % 3],
        }
        expected = search_reference(view, pose.camera, sample=sample, **options)
        if not expected.valid.any():
            continue
        found = ibr.warp(view, pose.camera, method="search", interpolation=sample, **options)
        # Rounding decides for a ray that just touches a silhouette, or passes exactly between two samples.
        assert np.count_nonzero(found.valid != expected.valid) <= 3, (pose.name, options)
        both = found.valid & expected.valid
        close = np.isclose(found.depth, expected.depth, rtol=1e-4, atol=0)
        assert np.count_nonzero(both & ~close) <= 3, (pose.name, options)
        off = np.abs(found.color - expected.color).max(axis=-1)
        # 1 level of 255: half for rounding to bytes, half for a position error of a few thousandths of a pixel.
        off = np.where(both & close, off, 0)
        if np.count_nonzero(off > 1) > 1:  # half-way between torn samples, either may show
            for by in ((2e-3, 2e-3), (-2e-3, -2e-3)):
                beside = search_reference(view, scenes.moved_aside(pose.camera, *by), sample=sample, **options)
                off = np.minimum(off, np.abs(found.color - beside.color).max(axis=-1))
        assert np.count_nonzero(off > 1) <= 1, (pose.name, options)
        compared += np.count_nonzero(both)
    assert compared > 300
