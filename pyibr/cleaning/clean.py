"""Depth as cameras deliver it, made fit for new views: flying pixels, speckle, small holes and noise."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pyibr.cleaning.scale import Scale, scale_of
from pyibr.cleaning.stages import Image, Placed
from pyibr.core.checks import Float64, checked_colors, integer_from, number_from
from pyibr.images.depth_image import Color, Depth, checked_depth
from pyibr.images.noise import DepthNoise, Noise, checked_noise
from pyibr.opencl.device import one_call

Mask = NDArray[np.bool_]

_NOISE_MIN = 5e-4  # of the depth: what is less is none
_CELLS = 20_000  # that tell the noise, while the device works: it is right to 3 %
_GIVEN = 64  # places of nearness at which noise that was given is looked at
_NOISE_MAX = 1e30  # of nearness: the scales stay finite
_APART, _LEAST_APART = 5.0, 0.02  # deviations, and a share of depth: two surfaces are at least that far apart


class CleanedDepth(NamedTuple):
    """Result of `clean_depth`.

    Attributes
    ----------
    depth : (H, W) float32
        Planar z in scene units; NaN where there is none.
    invented : (H, W) bool
        Where it was not measured: holes that were filled, flying pixels and speckle that were replaced.

    Examples
    --------
    >>> import pyibr as ibr
    >>> ibr.CleanedDepth._fields
    ('depth', 'invented')
    """

    depth: Depth
    invented: Mask


def clean_depth(
    depth: Depth,
    color: Color | None = None,
    *,
    before: Depth | None = None,
    noise: Noise | None = None,
    holes: int = 8,
    strength: float = 1.0,
) -> CleanedDepth:
    """Clean the depth that a camera delivers: flying pixels, speckle, small holes and noise.

    How much noise there is at which depth is found from the samples themselves, unless it is given, so that structured
    light, stereo and time of flight are treated alike. Samples between two surfaces go, which are half of each, and
    islands of a few samples. Small holes are filled from their edges inwards, where colours are alike first, so that
    depth edges follow those of the colour. Then a bilateral filter around each sample's own plane smooths what differs
    from it by no more than noise does: edges stay as sharp as they are. It works on nearness (1 / depth), in which
    planes are linear.

    Frame by frame, what is left of the noise flickers, and so does what is filled. With `before` the depth is steady:
    where the last frame's and this one's agree within the noise, most of the last one's stays, and so do wires that
    break into pieces; where they do not, something has moved, and this frame's counts alone. What moves slowly is
    behind by at most 0.55 `strength` of the noise's standard deviation.

    Parameters
    ----------
    depth : (H, W) float32
        Planar z in scene units; NaN, infinite or <= 0 where there is none.
    color : (H, W, 3) uint8, or float32 in [0, 1], optional
        Registered to the depth: what it guides is which side of an edge a filled sample belongs to.
    before : (H, W) float32, optional
        In a sequence, the last frame's cleaned depth as this frame's camera sees it, NaN where unknown: as it was
        returned, if the camera stands still; else carried over, see the example.
    noise : float, (a, b, c) or callable, optional
        The depth's noise, as `DepthImage` takes it: the standard deviation of 1 / depth (`disparity_noise`); three
        numbers: at depth z it is a z^2 + b z + c; or a function of depths. By default it is found from the samples.
    holes : int
        0 to 1000 pixels: gaps up to twice as wide are filled, if there is depth around them.
    strength : float
        0 to 10: how much of the noise is smoothed away. 0: samples that stay keep their depth.

    Returns
    -------
    CleanedDepth
        The depth, and which of it is invented. Nothing is invented outside of the hull that discs of radius `holes`
        leave of the valid samples, and of those that are taken from `before` within 2 pixels of them.

    Raises
    ------
    ArgumentError
        If shapes, dtypes or ranges do not fit, or there are more pixels than kernels can number.

    Examples
    --------
    >>> import numpy as np
    >>> import pyibr as ibr
    >>> depth = np.full((30, 40), 2, np.float32)
    >>> depth[10:14, 20] = np.nan
    >>> cleaned = ibr.clean_depth(depth)
    >>> float(cleaned.depth[12, 20]), int(cleaned.invented.sum())
    (2.0, 4)

    The next frame, of a camera that has moved:

    >>> camera = ibr.Camera([[50, 0, 20], [0, 50, 15], [0, 0, 1]], (40, 30))
    >>> moved = camera.moved(0.01, 0, 0)
    >>> before = ibr.warp(ibr.DepthImage(None, cleaned.depth, camera), moved).depth
    >>> float(ibr.clean_depth(depth, before=before).depth[12, 20])
    2.0
    """
    measured = checked_depth(depth, (None, None))
    height, width = measured.shape
    colors = None if color is None else checked_colors("color", color, (height, width, 3))
    known = None if before is None else checked_depth(before, measured.shape, "before")
    reach = integer_from("holes", holes, 0, 1000)
    told = None if noise is None else checked_noise(noise, measured)
    share = number_from("strength", strength, 0.0, 10.0, "a number from 0 to 10")
    with one_call():
        image = Image(width, height)
        placed, last = image.place(measured), None if known is None else image.place(known)
        image.place_colors(colors)
        told = told or DepthNoise(measured, cells=_CELLS).deviation
        if placed.is_empty:
            return CleanedDepth(np.full_like(measured, np.nan), np.zeros(measured.shape, np.bool_))
        last = None if last is None or last.is_empty else last
        seen = [placed] if last is None else [placed, last]
        nearest, farthest = min(one.nearest for one in seen), max(one.farthest for one in seen)
        at, deviations = _noise_at(told, nearest, farthest)
        apart = scale_of(nearest, farthest, at, _APART * deviations, _LEAST_APART)
        _settle(image, placed, last, apart, reach)
        alike = scale_of(nearest, farthest, at, deviations, _NOISE_MIN)
        cleaned, invented = image.smooth(last, alike, share)
        return CleanedDepth(cleaned, invented.view(np.bool_))


def _noise_at(noise: tuple[float, float, float], nearest: float, farthest: float) -> tuple[Float64, Float64]:
    """Nearness (1 / depth) from the farthest to the nearest depth, growing, and the noise of nearness there."""
    at = np.geomspace(1 / farthest, 1 / nearest, _GIVEN)
    a, b, c = noise
    with np.errstate(over="ignore"):
        return at, np.minimum(a + (b + c * at) * at, _NOISE_MAX)


def _settle(image: Image, placed: Placed, last: Placed | None, apart: Scale, reach: int) -> None:
    """Depth all over the area: from samples that are no flying pixels, and once more without those that are speckle."""
    values = image.on_scale(placed.depth, apart)
    known = None if last is None else image.on_scale(last.depth, apart)
    image.keep(values, known if reach > 0 else None)
    image.fill(placed, last, reach)
    if image.drop_speckle(image.on_scale(image.grown, apart), values, known):
        image.fill(placed, last, reach)
