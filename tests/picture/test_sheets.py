"""No sheet spans empty space: beside thin things without noise, at outlines of round things, in small images."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import pyibr as ibr
from pyibr.opencl.device import one_call
from pyibr.picture.surface import surface_of
from tests.embree import points_of

Array = NDArray[Any]
RIGHT, BELOW = 1, 2


def camera_of(width: int, height: int, focal: float = 0.9) -> ibr.Camera:
    f = focal * width
    return ibr.Camera([[f, 0, width / 2 - 0.5], [0, f, height / 2 - 0.5], [0, 0, 1]], (width, height))


def torn(view: ibr.DepthImage) -> tuple[Array, Array]:
    """(H, W - 1) and (H - 1, W) bool: samples that are torn from their right, and from their lower neighbour."""
    width, height = view.camera.size
    with one_call():
        bits = surface_of(view, None).nearness.to_host()[1 : height + 1, 1 : width + 1].copy().view(np.int32)
    return (bits[:, :-1] & RIGHT) != 0, (bits[:-1] & BELOW) != 0


def bridged(depth: Array, surface: Array, camera: ibr.Camera) -> int:
    """Count pairs of neighbours that are not torn apart although their numbers in `surface` differ."""
    right, below = torn(ibr.DepthImage(None, depth.astype(np.float32), camera))
    sheets = ~right & (surface[:, 1:] != surface[:, :-1])
    return int(sheets.sum() + (~below & (surface[1:] != surface[:-1])).sum())


def grass(size: tuple[int, int], rng: np.random.Generator, widths: tuple[float, float]) -> tuple[Array, Array]:
    """Depth of leaning blades before a wall, and the number of the surface that each pixel shows.

    Each blade lies in its own plane. Blades do not overlap, so all of them show their full width.
    """
    width, height = size
    y, x = np.mgrid[:height, :width].astype(float)
    depth = 4.0 / (1 + 0.1 * (x / width - 0.5) + rng.uniform(-0.1, 0.1) * (y / height - 0.5))
    surface = np.zeros((height, width), int)
    lean = rng.uniform(-0.5, 0.5)
    for number in range(1, 9):
        at = width * (number + rng.uniform(0, 0.5)) / 9
        blade = np.abs(x - at - lean * (y - height / 2)) < 0.5 * rng.uniform(*widths)
        near = 1.2 * 1.12**number * (1 + rng.uniform(-0.02, 0.02) * y / height)  # neighbours differ by over 8 %
        nearer = blade & (near < depth)
        depth, surface = np.where(nearer, near, depth), np.where(nearer, number, surface)
    return depth, surface


@pytest.mark.parametrize("size", [(160, 121), (333, 250)])
@pytest.mark.parametrize("rounding", ["none", "millimetres", "half precision"])
def test_no_sheet_hangs_between_thin_things(size, rounding):
    for seed in range(6):
        depth, surface = grass(size, np.random.default_rng(seed), (2.0, 4.0))
        if rounding == "millimetres":
            depth = np.rint(1000 * depth) / 1000
        elif rounding == "half precision":
            depth = depth.astype(np.float16)
        assert (surface > 0).sum() > 1000  # samples on blades
        assert bridged(depth, surface, camera_of(*size)) == 0, seed


@pytest.mark.parametrize("size", [(7, 5), (11, 9), (16, 12), (33, 25), (48, 37), (64, 48)])
@pytest.mark.parametrize("gap", [0.15, 0.3, 0.9])
def test_no_sheet_joins_a_box_to_its_wall_in_images_of_few_samples(size, gap):
    width, height = size
    y, x = np.mgrid[:height, :width]
    box = (np.abs(x - width / 2 + 0.5) < 0.21 * width) & (np.abs(y - height / 2 + 0.5) < 0.26 * height)
    assert box.any()
    for wall in (np.full((height, width), 2.0), 2.0 / (1 + 0.2 * (x / width - 0.5))):
        assert bridged(np.where(box, wall - gap, wall), box.astype(int), camera_of(*size)) == 0


def ring(camera: ibr.Camera, radius: float = 0.18) -> tuple[Array, Array]:
    """Spheres that touch, in a row away from the camera: each outline occludes a part of the next sphere."""
    width, height = camera.size
    y, x = np.mgrid[:height, :width].astype(float)
    rays = np.stack([(x - camera.K[0, 2]) / camera.K[0, 0], (y - camera.K[1, 2]) / camera.K[1, 1], np.ones_like(x)], -1)
    depth, surface = np.full((height, width), np.inf), np.zeros((height, width), int)
    for number in range(1, 8):
        center = np.array([0.22 * number - 0.9, 0.1 * np.sin(number), 1.2 + 0.3 * number])
        a, b = (rays**2).sum(-1), rays @ center
        root = b * b - a * (center @ center - radius**2)
        z = np.where(root > 0, (b - np.sqrt(np.maximum(root, 0))) / a, np.inf)
        depth, surface = np.where(z < depth, z, depth), np.where(z < depth, number, surface)
    return depth, surface


@pytest.mark.parametrize(("size", "most"), [((97, 71), 0.04), ((240, 181), 0.002)])
def test_limbs_are_torn_and_round_surfaces_are_whole(size, most):
    camera = camera_of(*size)
    depth, surface = ring(camera)
    assert bridged(depth, surface, camera) == 0
    right, below = torn(ibr.DepthImage(None, depth.astype(np.float32), camera))
    lost = (right & (surface[:, 1:] == surface[:, :-1]) & (surface[:, 1:] > 0)).sum()
    lost += (below & (surface[1:] == surface[:-1]) & (surface[1:] > 0)).sum()
    # With 14 samples across a sphere, the last pair of samples beside a nearer sphere is over 1.5 times as steep as the
    # pair before it.
    assert lost <= most * (surface > 0).sum()


def test_margins_at_limbs_stay_within_the_size_of_a_sample():
    """Margins do not continue the steep slope of an outline: seen from the side, all pixels lie near the spheres."""
    camera = camera_of(181, 140)
    depth, _ = ring(camera)
    view = ibr.DepthImage(None, depth.astype(np.float32), camera)
    aside = ibr.Camera.look_at((2.4, 0.1, 2.2), (-0.1, 0, 2.2), (0, -1, 0), (160, 123), fov_y=40)
    points = points_of(ibr.warp(view, aside, side="both"))
    centers = np.array([[0.22 * k - 0.9, 0.1 * np.sin(k), 1.2 + 0.3 * k] for k in range(1, 8)])
    off = np.abs(np.linalg.norm(points[:, None] - centers, axis=-1) - 0.18).min(axis=1)
    assert len(points) > 500
    # On a slope of 83 degrees, half a sample sideways is 4 samples of depth, or 0.06 units at the farthest sphere.
    assert (off < 0.06).all()
