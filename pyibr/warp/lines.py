"""Layout of a target image's epipolar lines, which the sweep walks.

The epipole may lie in any of nine regions in and around the image, or at infinity (Schaufler & Priglinger 1999, table 1
and figure 7). The lines form at most four fans: they advance mainly in x or mainly in y, on either side of the epipole.
The paper starts lines at as many borders. A fan's lines are one pixel apart at the end that is far from the epipole.
Each time the distance to the epipole halves, every second line ends, so that pixels near the epipole are not visited
much more often than others (the squares around the epipole that the paper proposes in section 8).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.core.checks import Float64
from pyibr.core.pixelspace import Rectangle
from pyibr.opencl.headers import struct

_LEVELS_MAX = 4  # halvings of the distance to the epipole; the innermost ring is 1/16 of the fan's length
_ROUNDING = 4e-7  # relative error of float32: a pixel so close to a diagonal may go to either fan, so both reach it
_OFFSET = 0.137  # pixels: moves lines off the borders of pixels, where rounding would decide which pixel gets a hit


@dataclass(frozen=True)
class _Fan:
    """Lines on one side of the epipole that advance along `axis`; `distance` is D of kernels/warp/epipolar.cl."""

    axis: int
    side: int
    along: tuple[int, int]  # first and last pixel of the area along `axis`
    across: tuple[int, int]
    e_along: float
    e_across: float
    w: float

    def distance(self, pixel: float) -> float:
        """Distance to the epipole along the axis (times |w|): positive on this side."""
        return (pixel * self.w - self.e_along) * self.side

    @cached_property
    def reference(self) -> int:
        """The pixel along the axis that is farthest from the epipole."""
        return self.along[1] if self.w * self.side > 0.0 else self.along[0]

    @cached_property
    def nearest(self) -> float:
        """Least distance in the area, relative to the reference's; <= 0 if the area extends to or past the epipole."""
        return min(map(self.distance, self.along)) / self.distance(self.reference)

    @property
    def is_diagonal(self) -> bool:
        """True if lines run along the image's diagonals: a line through one pixel's centre passes through many."""
        return self.w == 0.0 and math.isclose(abs(self.e_across), abs(self.e_along), rel_tol=_ROUNDING)

    def reach(self) -> tuple[float, float]:
        """Range of the lines' positions across the axis, at the pixel `reference`.

        Only lines that cross the area within 45 degrees of `axis` count.
        """
        low, high = -math.inf, math.inf
        if self.nearest > 0.0:
            cuts = [
                c + (c * self.w - self.e_across) * self.side / self.distance(a) * (self.reference - a)
                for a in self.along
                for c in self.across
            ]
            low, high = min(cuts), max(cuts)
        if self.w != 0.0:
            middle, half = self.e_across / self.w, self.distance(self.reference) / abs(self.w)
            if self.nearest > 0.0:  # `cuts` bounds the range as well
                half += _ROUNDING * max(abs(self.e_along), abs(self.e_across)) / abs(self.w)
            low, high = max(low, middle - half), min(high, middle + half)
        elif abs(self.e_across) > abs(self.e_along) * (1.0 + _ROUNDING):
            return math.inf, -math.inf
        return low, high

    def extent(self, least: float) -> tuple[int, int]:
        """First and last pixel along the axis at a distance of at least `least` times the reference's."""
        if self.w == 0.0:
            return self.along
        end = (self.e_along + least * self.distance(self.reference) * self.side) / self.w
        low, high = sorted((float(self.reference), end))
        return max(self.along[0], math.floor(low) - 2), min(self.along[1], math.ceil(high) + 2)


def line_groups(
    epipole: Float64, area: Rectangle, lanes: int, through_pixels: bool = False, segment: int = 0
) -> tuple[NDArray[Any], int]:
    """Lay epipolar lines over ``area``.

    Parameters
    ----------
    epipole : (3,) float64
        Image of the source's centre: homogeneous, and the sign counts; (x, y, 0) is a direction.
    area : Rectangle
        Pixels to cover.
    lanes : int
        Lines per work-item.
    through_pixels : bool
        Whether lines along rows or columns run through the pixels' centres; otherwise they run beside the centres.
    segment : int
        Pixels of a line that one work-item processes; 0: all.

    Returns
    -------
    groups : array of the kernels' struct LineGroup
    packets : int
        Work-items needed for all groups.
    """
    return _laid((float(epipole[0]), float(epipole[1]), float(epipole[2])), area, lanes, through_pixels, segment)


@lru_cache(maxsize=64)
def _laid(
    epipole: tuple[float, float, float], area: Rectangle, lanes: int, through_pixels: bool, segment: int
) -> tuple[NDArray[Any], int]:
    groups: list[dict[str, float]] = []
    packets = 0
    ends = (area.low_x, area.high_x - 1), (area.low_y, area.high_y - 1)
    *e, w = epipole
    for axis in () if area.empty else (0, 1):
        for side in (1, -1):
            fan = _Fan(axis, side, ends[axis], ends[1 - axis], e[axis], e[1 - axis], w)
            farthest = fan.distance(fan.reference)
            if farthest <= 0.0:
                continue
            low, high = fan.reach()
            if low > high:
                continue
            levels = min(_LEVELS_MAX, max(0, int(-math.log2(max(fan.nearest, 1e-9)))))
            # Lines through pixels start at the first pixel; sloping lines also enter from outside the area.
            beyond = 0 if through_pixels else 2**levels
            first = math.floor(low) - beyond + (0.0 if through_pixels or fan.is_diagonal else _OFFSET)
            # Lines with odd indices end at half the distance, odd multiples of two at a quarter, ...
            for level in range(levels + 1):
                goes_on = level == levels
                spacing = 2**level if goes_on else 2 ** (level + 1)
                start = first if goes_on else first + 2**level
                count = int((high + beyond - start) // spacing) + 1
                least = 0.0 if goes_on else 0.5 ** (level + 1)
                group: dict[str, float] = {"axis": axis, "side": side, "first_packet": packets, "count": count}
                group["low"], group["high"] = fan.extent(least)
                group["cross_low"], group["cross_high"] = fan.across
                group |= {"levels": levels, "reference": fan.reference, "first": start, "spacing": spacing}
                group |= {"distance": -fan.e_along * side / farthest, "distance_step": w * side / farthest}
                groups.append({**group, "least": least})
                pixels = int(group["high"] - group["low"]) + 1
                packets += -(-count // lanes) * (-(-pixels // segment) if segment else 1)
    kind = struct("warp/lines.h", "LineGroup")
    laid = np.array([tuple(group[name] for name in kind.names or ()) for group in groups], kind)
    laid.flags.writeable = False
    return laid, packets
