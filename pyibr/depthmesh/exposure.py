"""Views that have been exposed differently, matched where they saw the same surface."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pyibr.core.checks import Float64
from pyibr.images.depth_image import DepthImage
from pyibr.images.exposure import Overlap, matching_gains

_SAMPLES = 8_000  # of a view that are looked up in each other
_DEVIATIONS = 4.0  # of both views' noise, within which depths are one surface's
_SAME = 0.002  # of the extent: without noise


def gains_of(views: Sequence[DepthImage], extent: float) -> Float64:
    """(views, 3) what each view's colours are to be multiplied by; `extent`: of what they show, in scene units."""
    overlaps: list[Overlap] = []
    for first, view in enumerate(views):
        y, x = np.nonzero(view.valid)
        some = slice(None, None, max(len(y) // _SAMPLES, 1))
        y, x = y[some], x[some]
        points = view.camera.unproject(np.column_stack([x, y]), view.depth[y, x])
        colors = _shown(view, y, x)
        for second, other in enumerate(views):
            if other is not view:
                at, v, u = _seen_by(other, points, view, extent)
                overlaps.append(Overlap(first, second, colors[at], _shown(other, v, u)))
    return matching_gains(len(views), overlaps)


def _seen_by(
    other: DepthImage, points: Float64, view: DepthImage, extent: float
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Select the points of a view that another one saw, with the rows and columns where it did."""
    pixels, z = other.camera.project(points)
    width, height = other.camera.size
    with np.errstate(invalid="ignore"):
        inside = (
            np.isfinite(pixels).all(axis=1) & (z > 0) & ((pixels >= 0) & (pixels < (width - 1, height - 1))).all(axis=1)
        )
    at = np.flatnonzero(inside)
    u, v = np.rint(pixels[at]).astype(np.int64).T
    noise = [_DEVIATIONS * (one.noise[0] * z[at] ** 2 + one.noise[1] * z[at] + one.noise[2]) for one in (other, view)]
    same = other.valid[v, u] & (np.abs(other.depth[v, u] - z[at]) <= _SAME * extent + noise[0] + noise[1])
    return at[same], v[same], u[same]


def _shown(view: DepthImage, y: NDArray[np.int64], x: NDArray[np.int64]) -> NDArray[np.float32]:
    return (view.shown_color[y, x] / (255 if view.shown_color.dtype == np.uint8 else 1)).astype(np.float32)
