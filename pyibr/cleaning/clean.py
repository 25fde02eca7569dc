"""Cleaning of depth from cameras (flying pixels, speckle, small holes, noise), and of soft edges from networks."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pyibr.cleaning.stages import Image, Placed, Scale, scale_of
from pyibr.core.checks import Float64, checked_colors, integer_from, number_from
from pyibr.images.depth_image import Color, Depth, checked_depth
from pyibr.images.noise import DepthNoise, Noise, checked_noise
from pyibr.opencl.device import one_call

Mask = NDArray[np.bool_]

_NOISE_MIN = 5e-4  # relative to the depth: smaller noise is ignored
_CELLS = 20_000  # cells for the estimate of the noise, found while the device works: accurate to 3 %
_GIVEN = 64  # values of nearness at which the noise is sampled
_NOISE_MAX = 1e30  # noise of nearness: keeps the scales finite
_APART, _LEAST_APART = 5.0, 0.02  # least distance of two surfaces: standard deviations, and a fraction of the depth


class CleanedDepth(NamedTuple):
    """Result of `clean_depth`.

    Attributes
    ----------
    depth : (H, W) float32
        Planar z in scene units; NaN where there is no depth.
    invented : (H, W) bool
        Mask of pixels whose depth was not measured: filled holes, and replaced flying pixels and speckle.

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
    """Clean the depth of a camera: remove flying pixels and speckle, fill small holes, smooth noise.

    The noise at each depth is estimated from the samples unless it is given, so the function suits structured light,
    stereo and time of flight. It removes flying pixels (samples between two surfaces, mixed from both) and small
    islands of samples. It fills small holes from their edges inwards, between similar colours first, so depth edges
    follow colour edges. Then a bilateral filter around the local plane of each sample smooths deviations up to the
    size of the noise, and edges stay sharp. All steps work on nearness (1 / depth), in which planes are linear.

    If frames of a video are cleaned independently, remaining noise and filled holes flicker. `before` makes the depth
    steady: where the previous and the current frame agree within the noise, most of the previous depth stays, also on
    wires that break into pieces. Where they disagree, something has moved, and only the current frame counts. A slowly
    moving surface lags behind by at most 0.55 `strength` standard deviations of the noise.

    Parameters
    ----------
    depth : (H, W) float32
        Planar z in scene units; NaN, infinite or <= 0 where there is no depth.
    color : (H, W, 3) uint8, or float32 in [0, 1], optional
        Colours registered to the depth. They decide to which side of an edge a filled sample belongs.
    before : (H, W) float32, optional
        In a sequence, the cleaned depth of the previous frame as seen by the current camera, NaN where unknown. If the
        camera moves, warp the previous depth to the new camera as in the example.
    noise : float, (a, b, c) or callable, optional
        Noise of the depth, in the forms that `DepthImage` accepts. By default it is estimated from the samples.
    holes : int
        0 to 1000 pixels: gaps up to twice this width are filled if there is depth around them.
    strength : float
        Strength of the smoothing, 0 to 10. With 0, samples that are not removed keep their depth.

    Returns
    -------
    CleanedDepth
        The depth, and the mask of its invented samples. These lie only within a morphological closing, by a disc of
        radius `holes`. It closes the valid samples, and samples of `before` within 2 pixels of valid ones.

    Raises
    ------
    ArgumentError
        If shapes, dtypes or ranges do not fit, or there are more pixels than kernels can index.

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
        nearest, farthest = placed.range
        if nearest > farthest:
            return CleanedDepth(np.full_like(measured, np.nan), np.zeros(measured.shape, np.bool_))
        near, far = (np.inf, -np.inf) if last is None else last.range
        last = last if near <= far else None
        nearest, farthest = min(nearest, near), max(farthest, far)
        at, deviations = _noise_at(told, nearest, farthest)
        apart = scale_of(nearest, farthest, at, _APART * deviations, _LEAST_APART)
        _settle(image, placed, last, apart, reach)
        alike = scale_of(nearest, farthest, at, deviations, _NOISE_MIN)
        cleaned, invented = image.smooth(last, alike, share)
        return CleanedDepth(cleaned, invented.view(np.bool_))


def sharpen_depth(depth: Depth) -> Depth:
    """Sharpen the edges of depth that was estimated by a network or enlarged with interpolation.

    Such depth has ramps of several pixels between surfaces, and in new views surfaces smear along these ramps. Each
    sample of a ramp of up to 24 pixels is moved to the closer of the two surfaces, which is extrapolated to the sample,
    but not beyond the depths around it.
    All other samples keep their depth to the bit. Depth of cameras is noisy and needs `clean_depth` instead.

    Parameters
    ----------
    depth : (H, W) float32
        Planar z in scene units; NaN, infinite or <= 0 where there is no depth.

    Returns
    -------
    (H, W) float32
        Sharpened depth; NaN where there is no depth.

    Raises
    ------
    ArgumentError
        If shape or dtype do not fit, or there are more pixels than kernels can index.

    Examples
    --------
    >>> import numpy as np
    >>> import pyibr as ibr
    >>> ramp = np.interp(np.arange(20), [7, 12], [0.5, 0.25])  # nearness: from a depth of 2 to one of 4
    >>> soft = np.tile((1 / ramp).astype(np.float32), (15, 1))
    >>> ibr.sharpen_depth(soft)[7, 7:13].tolist()
    [2.0, 2.0, 2.0, 4.0, 4.0, 4.0]
    """
    given = checked_depth(depth, (None, None))
    known = (given > 0) & (given < np.inf)
    nearness = np.zeros(given.shape, np.float32)
    with np.errstate(over="ignore"):  # samples whose nearness exceeds float32 stay unchanged
        np.divide(1, given, out=nearness, where=known)
    with one_call():
        image = Image(given.shape[1], given.shape[0])
        sharp = image.sharpen(image.place(nearness))
    made = np.where(known, given, np.float32(np.nan))
    np.divide(1, sharp, out=made, where=sharp > 0)
    return made


def _noise_at(noise: tuple[float, float, float], nearest: float, farthest: float) -> tuple[Float64, Float64]:
    """Ascending nearness (1 / depth) from the farthest to the nearest depth, and the noise of nearness there."""
    at = np.geomspace(1 / farthest, 1 / nearest, _GIVEN)
    a, b, c = noise
    with np.errstate(over="ignore"):
        return at, np.minimum(a + (b + c * at) * at, _NOISE_MAX)


def _settle(image: Image, placed: Placed, last: Placed | None, apart: Scale, reach: int) -> None:
    """Fill the area with depth: first from all samples except flying pixels, then, if needed, again without speckle."""
    values = image.on_scale(placed.depth, apart)
    known = None if last is None else image.on_scale(last.depth, apart)
    image.keep(values, known if reach > 0 else None)
    image.fill(placed, last, reach)
    if image.drop_speckle(image.on_scale(image.grown, apart), values, known):
        image.fill(placed, last, reach)
