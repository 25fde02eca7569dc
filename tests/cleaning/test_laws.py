"""Laws of cleaned depth: inputs that stay unchanged, places where depth may be invented, and extreme values."""

from __future__ import annotations

import numpy as np
import pytest

import pyibr as ibr


def nearness_plane(size: tuple[int, int], across: float, down: float) -> np.ndarray:
    y, x = np.mgrid[: size[0], : size[1]]
    return (1 / (0.5 + across * x + down * y)).astype(np.float32)


def test_what_is_level_stays_to_the_bit():
    for depth in (0.3, 2.0, 1234.5):
        level = np.full((37, 61), depth, np.float32)
        np.testing.assert_array_equal(ibr.clean_depth(level).depth, level)


@pytest.mark.parametrize(("across", "down"), [(0.002, 0.0), (0.0005, 0.001), (-0.0015, 0.0003)])
def test_a_plane_stays_a_plane(across, down):
    """Planes change by at most 0.005 % of the depth, a tenth of the least noise, since depth's scale is curved."""
    plane = nearness_plane((61, 97), across, down)
    np.testing.assert_allclose(ibr.clean_depth(plane).depth[8:-8, 8:-8], plane[8:-8, 8:-8], rtol=5e-5)


def test_without_strength_what_is_kept_is_to_the_bit_what_was_measured():
    rng = np.random.default_rng(1)
    depth = (nearness_plane((61, 97), 0.001, 0.001) + rng.normal(0, 0.01, (61, 97))).astype(np.float32)
    depth[rng.random(depth.shape) < 0.2] = np.nan
    cleaned, invented = ibr.clean_depth(depth, strength=0)
    kept = np.isfinite(cleaned) & ~invented
    assert kept.sum() > 0.75 * depth.size
    np.testing.assert_array_equal(cleaned[kept], depth[kept])
    assert np.isin(cleaned[invented], depth).all()  # each is the depth of a sample


@pytest.mark.parametrize("every", [2, 3, 4])
@pytest.mark.parametrize("axis", [0, 1])
def test_samples_of_a_steep_surface_stay_beside_missing_ones(axis, every):
    """Each sample lies between its neighbours, as a flying pixel does, but on a line through them."""
    place = np.mgrid[:61, :83][axis]
    depth = (2 + 0.15 * place).astype(np.float32)
    depth[place % every == 0] = np.nan
    cleaned, invented = ibr.clean_depth(depth, strength=0, holes=0)
    inside = np.s_[8:-8, 8:-8]
    np.testing.assert_array_equal((np.isfinite(cleaned) & ~invented)[inside], np.isfinite(depth)[inside])


def test_nothing_is_invented_outside_of_the_hull_that_discs_leave():
    rng = np.random.default_rng(2)
    depth = np.full((61, 97), np.nan, np.float32)
    depth[rng.random(depth.shape) < 0.01] = 2
    y, x = np.mgrid[:61, :97]
    seeds = np.argwhere(np.isfinite(depth))
    away = np.sqrt(((np.stack([y, x])[..., None] - seeds.T[:, None, None]) ** 2).sum(axis=0).min(axis=-1))
    for holes in (2, 5, 12):
        invented = ibr.clean_depth(depth, holes=holes).invented
        # A disc of radius `holes` around a pixel that is farther from all samples is empty: the pixel is not filled.
        assert not (invented & (away > holes + 0.5)).any() and invented.any() == (holes > 2)


def test_depth_and_noise_in_another_unit_are_cleaned_alike():
    rng = np.random.default_rng(3)
    depth = (nearness_plane((61, 97), 0.001, 0.0) + rng.normal(0, 0.01, (61, 97))).astype(np.float32)
    depth[20:30, 20:26] = np.nan
    one, other = ibr.clean_depth(depth), ibr.clean_depth(depth * np.float32(1024))  # a power of two keeps mantissas
    np.testing.assert_array_equal(other.invented, one.invented)
    np.testing.assert_allclose(other.depth, one.depth * 1024, rtol=1e-6)


def test_a_long_way_round_is_grown_through():
    """A corridor of one colour, with eight turns, is filled from the samples at one end."""
    size = (61, 97)
    walls = np.zeros(size, bool)
    walls[4::8] = True
    walls[4::16, -3:] = walls[12::16, :3] = False  # openings in turns at the right and at the left
    color = np.where(walls, 255, 0).astype(np.uint8)[..., None].repeat(3, axis=2)
    depth = np.where(walls, np.float32(3), np.float32(np.nan))
    depth[0] = 1
    cleaned = ibr.clean_depth(depth, color, holes=100, strength=0).depth
    np.testing.assert_array_equal(cleaned, np.where(walls, np.float32(3), np.float32(1)))


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, -1.0, 0.0, 1e-38, 1e-31])
def test_what_is_no_depth_is_none(value):
    depth = np.full((7, 13), value, np.float32)
    nothing = ibr.clean_depth(depth, np.zeros((7, 13, 3), np.uint8))
    assert np.isnan(nothing.depth).all() and not nothing.invented.any()
    depth[3, 6] = 2.0
    alone = ibr.clean_depth(depth, before=np.full((7, 13), value, np.float32), holes=0)
    np.testing.assert_array_equal(np.isfinite(alone.depth), depth == 2)


@pytest.mark.parametrize("strength", [0, 1e-30, 1, 10])
def test_depths_of_all_magnitudes_give_depths_within_them(strength):
    rng = np.random.default_rng(4)
    depth = (10.0 ** rng.uniform(-28, 28, (37, 61))).astype(np.float32)
    depth[10:20, 10:40] = rng.uniform(1, 1.01, (10, 30))
    before = np.roll(depth, 1, axis=1)
    for last in (None, before):
        found = ibr.clean_depth(depth, before=last, strength=strength).depth
        known = found[np.isfinite(found)]
        assert known.size and known.min() >= depth.min() * 0.99 and known.max() <= depth.max() * 1.01
