"""The layout of epipolar lines, without a device: each pixel is written (owned) by one line, and crossed by few lines.

The test computes each pixel's owner anew, by the rules in kernels/warp/epipolar.cl. The larger component of D, the
pixel's offset from the epipole, and its sign choose one of four fans. In that fan the pixel belongs to the line that
passes it within half of the distance between lines.
"""

from __future__ import annotations

import numpy as np
import pytest

from pyibr.core.pixelspace import Rectangle
from pyibr.warp.lines import line_groups

LANES = 16
SIZES = ((64, 48), (61, 37), (7, 13), (1, 1), (1, 30), (40, 1), (200, 9))
REGIONS = [(column, row) for row in (-1, 0, 1) for column in (-1, 0, 1)]


def areas(size: tuple[int, int]) -> list[Rectangle]:
    """The whole image, and a part of it, as for a view that covers only that part."""
    width, height = size
    whole = Rectangle(0, width, 0, height)
    part = Rectangle(width // 3, max(width // 3 + 1, width - 2), height // 4, height)
    return [whole, part]


def finite_epipoles(size: tuple[int, int], region: tuple[int, int], seed: int) -> list[np.ndarray]:
    """Homogeneous epipoles, near and far, on pixel centres and off them, with both signs and several scales."""
    rng = np.random.default_rng(seed)
    extent = np.array(size, np.float64)
    found = []
    for distance in (0.02, 0.5, 3.0, 1000.0):
        at = np.where(
            np.array(region) < 0,
            -distance * extent * rng.uniform(0.5, 1, 2) - 0.5,
            np.where(
                np.array(region) > 0,
                extent - 0.5 + distance * extent * rng.uniform(0.5, 1, 2),
                rng.uniform(-0.4, extent - 0.6),
            ),
        )
        for x, y in (at, np.round(at)):
            for w in (1.0, -1.0, 0.03, -40.0):
                found.append(np.array([x * w, y * w, w]))
    return found


def check(epipole: np.ndarray, area: Rectangle) -> tuple[float, float]:
    """Check each pixel's owner. Returns the fraction of owned pixels, and the number of pixels that all lines pass."""
    groups, packets = line_groups(epipole, area, LANES)
    width, height = area.high_x - area.low_x, area.high_y - area.low_y
    y, x = np.mgrid[area.low_y : area.high_y, area.low_x : area.high_x].astype(np.float64)
    D = x * epipole[2] - epipole[0], y * epipole[2] - epipole[1]
    # Like the kernel, this test chooses the fan by the larger component of D in float32: on a diagonal, rounding
    # decides.
    x32, y32, e32 = x.astype(np.float32), y.astype(np.float32), epipole.astype(np.float32)
    rounded = x32 * e32[2] - e32[0], y32 * e32[2] - e32[1]
    owners = np.zeros((height, width), int)
    visits = 0.0
    first_packet = 0
    for g in groups:
        assert g["first_packet"] == first_packet
        first_packet += -(-int(g["count"]) // LANES)
        axis, side = int(g["axis"]), int(g["side"])
        pixel = (x, y)[axis]
        d_along, other = D[axis] * side, np.abs(rounded[1 - axis])
        mine = (rounded[axis] * side > other) if axis else (rounded[axis] * side >= other)
        mine &= (pixel >= g["low"]) & (pixel <= g["high"]) & (d_along > 0)
        reference = float(g["reference"])
        at_reference = (reference * epipole[2] - epipole[axis]) * side
        with np.errstate(divide="ignore", invalid="ignore"):
            # Position at which the line through the pixel and the epipole crosses the reference column or row.
            cut = (x, y)[1 - axis] + D[1 - axis] * side / d_along * (reference - pixel)
            # Distance at this pixel between lines that are one pixel apart at the reference.
            distance = d_along / at_reference
        apart = distance.copy()
        for level in range(1, int(g["levels"]) + 1):
            apart = np.where(distance <= 0.5**level, distance * 2**level, apart)
        with np.errstate(invalid="ignore"):
            nearest = np.clip(np.round((cut - g["first"]) / g["spacing"]), 0, int(g["count"]) - 1)
            off = np.abs(g["first"] + nearest * g["spacing"] - cut) * distance
            mine &= distance > g["least"]
            owners += mine & (off < (0.5 - 1e-6) * apart)  # as in the kernel, no pixel exactly between two lines
            assert not (mine & (off < 0.5 * apart) & (off > 0.5)).any(), "a line owns a pixel over half a pixel away"
        lines = g["first"] + g["spacing"] * np.arange(int(g["count"]))
        visits += steps(lines, g, epipole, reference)
    assert first_packet == packets
    assert owners.max(initial=0) <= 1, "two lines write one pixel: the later one wins"
    return coverage(owners, D), visits


def coverage(owners: np.ndarray, D: tuple[np.ndarray, np.ndarray]) -> float:
    """Fraction of the pixels that have an owner. The pixel at the epipole does not count: it has no line."""
    asked = np.maximum(np.abs(D[0]), np.abs(D[1])) > 0
    return float((owners > 0)[asked].mean()) if asked.any() else 1.0


def steps(lines: np.ndarray, group: np.void, epipole: np.ndarray, reference: float) -> float:
    """Number of pixels that the lines pass in the group's rectangle: low to high, and cross_low to cross_high."""
    axis = int(group["axis"])
    slope = (lines * epipole[2] - epipole[1 - axis]) / (reference * epipole[2] - epipole[axis])
    along = np.arange(int(group["low"]), int(group["high"]) + 1)
    across = lines[:, None] + slope[:, None] * (along - reference)
    return float(np.count_nonzero((across >= group["cross_low"] - 0.5) & (across <= group["cross_high"] + 0.5)))


@pytest.mark.parametrize("region", REGIONS, ids=str)
@pytest.mark.parametrize("size", SIZES, ids=str)
def test_every_pixel_has_a_line_within_half_a_pixel(size, region):
    for area in areas(size):
        pixels = (area.high_x - area.low_x) * (area.high_y - area.low_y)
        border = 2 * (area.high_x - area.low_x + area.high_y - area.low_y)
        for epipole in finite_epipoles(size, region, seed=1):
            covered, visits = check(epipole, area)
            assert covered == 1.0, (epipole, area)
            # 1.7: towards the epipole, lines come closer, and every other line ends wherever two would share a pixel.
            # So on average at most 1.5 lines cross a pixel. In addition, each of four fans has up to two more lines at
            # either end, for each of five spacings.
            assert visits <= 1.7 * pixels + 16 * border, (epipole, area)


@pytest.mark.parametrize("size", SIZES, ids=str)
def test_epipoles_at_infinity(size):
    for area in areas(size):
        for x, y in (
            (1, 0),
            (-1, 0),
            (0, 1),
            (0, -1),
            (3, 2),
            (-2, 3),
            (1, 1),
            (1, -1),
            (-500, 1),
            (1e-6, -7),
        ):
            covered, _ = check(np.array([x, y, 0.0], np.float64), area)
            assert covered == 1.0, (x, y)


@pytest.mark.parametrize("size", SIZES, ids=str)
def test_epipoles_all_but_at_infinity(size):
    """A sideways motion with rounding: the third coordinate is almost 0."""
    for area in areas(size):
        for x, y in ((30.0, 0.0), (-30.0, 1e-15), (1e-14, 25.0), (0.0, -25.0), (-20.0, 15.0), (17.0, 17.0)):
            for w in (1e-6, 1e-7, 1e-8, 1e-9, 1e-12, 1e-14, 1.1e-16, 3e-17, 1e-18, 1e-25):
                for sign in (1, -1):
                    covered, _ = check(np.array([x, y, sign * w]), area)
                    assert covered == 1.0, (x, y, sign * w, area)


def test_lines_near_the_epipole_are_thinned():
    """1024 lines end at the border of a 256 x 256 image, but only a few reach the epipole in its middle."""
    epipole = np.array([127.3, 120.8, 1.0])
    area = Rectangle(0, 256, 0, 256)
    _, visits = check(epipole, area)
    assert visits <= 1.7 * 256 * 256
    groups, _ = line_groups(epipole, area, LANES)
    near = [g for g in groups if g["low"] - 4 <= epipole[g["axis"]] <= g["high"] + 4]
    # 1024 lines halved four times are 64. Each of four fans adds up to three lines at either end.
    assert sum(int(g["count"]) for g in near) <= 64 + 4 * 6


def test_nothing_to_cover_needs_no_lines():
    groups, packets = line_groups(np.array([1.0, 2.0, 1.0]), Rectangle(5, 5, 0, 10), LANES)
    assert len(groups) == packets == 0
