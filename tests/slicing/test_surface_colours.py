"""Colours and light of sliced surfaces: tiles, normal maps, and averages of distant texels."""

from __future__ import annotations

import numpy as np
import pytest

import pyibr as ibr
from pyibr.capture import models
from pyibr.core.camera import Camera
from tests.displaced import square
from tests.slicing.test_surfaces import SCALE, camera, ground


def test_colour_and_tiles():
    """Seen from above, a flat surface shows its colour image, repeated as tiles."""
    color = np.zeros((2, 2, 3), np.uint8)
    color[0, 0], color[1, 1] = (255, 0, 0), (0, 255, 0)
    flat = np.full((2, 2), 0.5, np.float32)
    thing = ibr.SlicedSurface(square(), flat, color, 1e-3, tiles=(4, 2), slices=4)
    cam = camera(90, 90, (96, 96))
    frame = ibr.render(thing, cam)
    point = ground(cam)
    for u, v, expected in ((1 / 16, 1 / 8, (255, 0, 0)), (3 / 16, 3 / 8, (0, 255, 0)), (5 / 16, 1 / 8, (255, 0, 0))):
        y, x = np.unravel_index(np.hypot(point[..., 0] - u, point[..., 1] - v).argmin(), frame.valid.shape)
        # Pixels are 1/60 of the square wide, so that the nearest one is up to 1/15 of a texel off the texel's centre.
        # Interpolation then changes its colour by up to 2/15 of the range.
        assert np.abs(frame.color[y, x].astype(int) - expected).max() <= 2 / 15 * 255


def test_shading_by_slopes_and_by_a_normal_map():
    """A ramp is lit by its known normal, whether by its slopes or by a normal map with that normal."""
    n = 64
    ramp = np.tile((np.arange(n) + 0.5) / n * 0.5 + 0.2, (n, 1)).astype(np.float32)
    color = np.full((1, 1, 3), 255, np.uint8)
    light = ibr.Light(direction=(-1, 0, -1), ambient=0.0)
    slope = 0.5 * SCALE
    normal = np.array([-slope, 0, 1]) / np.hypot(slope, 1)
    expected = 255 * normal @ np.array([1, 0, 1]) / np.sqrt(2)
    cam = camera(90, 90, (64, 64))
    point = ground(cam)
    inside = (np.abs(point[..., :2] - 0.5) < 0.4).all(axis=-1)
    maps = {"slopes": None, "map": np.tile(normal.astype(np.float32), (4, 4, 1))}
    for name, normal_map in maps.items():
        thing = ibr.SlicedSurface(square(), ramp, color, SCALE, slices=64, normal_map=normal_map)
        shaded = ibr.render(thing, cam, light).color[inside].astype(float)
        assert np.abs(shaded - expected).max() <= 1, name  # rounding to bytes, and float32


@pytest.mark.parametrize("make", [ibr.SlicedSurface, ibr.ReliefSurface])
def test_a_normal_map_of_bytes_is_decoded(make):
    """A normal map in bytes gives the picture of the same map in floats; x or y is 0 for both 127 and 128."""
    rng = np.random.default_rng(4)
    normals = rng.normal(size=(8, 8, 3)) * (0.4, 0.4, 0) + (0, 0, 1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    in_bytes = np.rint((normals + 1) * 127.5).astype(np.uint8)
    color, height = np.full((2, 2, 3), 255, np.uint8), np.full((4, 4), 0.5, np.float32)
    light, cam = ibr.Light(direction=(-1, -0.5, -1), shadow_size=0), camera(70, 40, (64, 64))
    frames = [
        ibr.render(make(square(), height, color, 0.01, normal_map=given), cam, light)
        for given in (normals.astype(np.float32), in_bytes)
    ]
    assert frames[0].color[frames[0].valid].std() > 20
    # Each of three components is off by half of 1/127.5, and so is the cosine to the light.
    assert np.abs(frames[0].color.astype(int) - frames[1].color).max() <= 3
    level = make(square(), height, color, 0.01, normal_map=np.array([[[255, 128, 127], [127, 127, 255]]], np.uint8))
    assert (level.normal_map[..., 2] > 0).all()


def test_flat_heights_are_lit_as_the_mesh():
    """Normals are interpolated over triangles, as for the mesh, so that no facets show."""
    base = models.donut(16)
    flat, color = np.full((4, 4), 0.999, np.float32), np.full((1, 1, 3), 204, np.uint8)
    light = ibr.Light(direction=(0.4, 0.8, -0.8), shadow_size=0)
    cam = Camera.look_at((1.5, -2.0, 2.5), (0, 0, 0), (0, 0, 1), (160, 120), fov_y=45)
    thing = ibr.SlicedSurface(base, flat, color, 0.001, slices=16)
    frame = ibr.render(thing, cam, light)
    mesh = ibr.render(ibr.Mesh(base.vertices, base.faces, normals=base.normals), cam, light)
    both = frame.valid & mesh.valid
    off = np.abs(frame.color.astype(int) - mesh.color)[both].max(axis=1)
    assert np.median(off) <= 1
    assert np.quantile(off, 0.98) <= 6  # 0.001 farther out, pixels at edges see other triangles


def test_colours_far_away_are_means():
    """From afar, each pixel covers many texels of a fine checkerboard."""
    checker = np.repeat((np.indices((128, 128)).sum(axis=0) % 2 * 255).astype(np.uint8)[..., None], 3, axis=2)
    flat = np.full((4, 4), 0.5, np.float32)
    cam = Camera.look_at((0.5, 0.5, 30), (0.5, 0.5, 0), (0, 1, 0), (61, 61), fov_y=2)
    frame = ibr.render(ibr.SlicedSurface(square(), flat, checker, 0.1, tiles=(4, 4), slices=16), cam)
    inner = frame.color[frame.valid][:, 0].astype(float)
    assert inner.std() <= 2
    assert abs(inner.mean() - 127.5) <= 2
