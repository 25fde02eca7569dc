"""The benchmark of Gaussians: how it counts black tiles, its clouds, and what it says without a Vulkan driver."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pyibr as ibr
from benchmarks.gaussians import clouds, lavapipe
from benchmarks.gaussians.gaussians import black_tiles
from benchmarks.results import Skip


def test_tiles_are_black_if_half_of_their_pixels_should_not_be() -> None:
    right = np.full((50, 70, 3), 100, np.uint8)
    right[:16, :16] = 0  # black in both pictures
    made = right.copy()
    made[16:32, 16:24] = 0  # half of a tile
    made[32:48, 32:39] = 0  # less than half of one
    made[0:16, 48:64] = 30  # dark, not black
    assert black_tiles(made, right) == 1
    assert black_tiles(right, right) == 0


@pytest.mark.parametrize("kind", clouds.KINDS)
def test_clouds_fill_the_pictures(kind: str) -> None:
    cloud = clouds.cloud(kind, 3000, 3)
    assert 2900 < len(cloud) <= 3000 and cloud.sh.shape[1] == 16
    for camera in clouds.path(kind, (64, 48), 3):
        assert (ibr.render(cloud, camera).alpha > 0).mean() > 0.5


def test_quaternions_turn_the_third_axis_to_the_normal() -> None:
    normals = np.random.default_rng(0).normal(size=(50, 3))
    w, x, y, z = (q := clouds.turned_to(normals, np.linspace(0, 3, 50))).T / np.linalg.norm(q, axis=1)
    third = np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], axis=1)
    cosine = (third * normals).sum(axis=1) / np.linalg.norm(normals, axis=1)
    np.testing.assert_allclose(np.abs(cosine), 1)


def test_a_missing_driver_is_a_reason(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(lavapipe, "_DRIVERS", tmp_path)
    found = lavapipe.drawn(clouds.cloud("cloud", 10, 0), clouds.path("cloud", (64, 48), 1))
    assert isinstance(found, Skip) and "mesa-vulkan-drivers" in found.reason
