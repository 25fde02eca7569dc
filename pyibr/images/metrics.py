"""Differences of two pictures: small measures for tests and benchmarks.

Each says which pixels it counts. Where no pixel counts there is no answer: ArgumentError, not a NaN.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.core.checks import Float64, describe, plain_array
from pyibr.core.errors import ArgumentError

Mask = NDArray[np.bool_]
Image = NDArray[np.number[Any]]


def psnr(a: Image, b: Image, *, valid: Mask | None = None) -> float:
    """Peak signal-to-noise ratio of two images.

    Parameters
    ----------
    a, b : (H, W) or (H, W, C), both uint8 (the peak is 255) or both floats (the peak is 1)
    valid : (H, W) bool, optional
        The pixels that count; all if not given.

    Returns
    -------
    float
        10 log10(peak^2 / mean squared difference) over all channels of the pixels that count, in dB;
        infinite where they are equal.

    Raises
    ------
    ArgumentError
        If shapes or dtypes do not fit together, or no pixel counts.

    Examples
    --------
    >>> import numpy as np
    >>> from pyibr.images import metrics
    >>> round(metrics.psnr(np.zeros((2, 2)), np.full((2, 2), 0.1)), 6)
    20.0
    """
    a, b = _image("a", a), _image("b", b)
    if not a.dtype == b.dtype == np.uint8 and {a.dtype.kind, b.dtype.kind} != {"f"}:
        raise ArgumentError("b", "uint8 as a, or floats as a", f"{b.dtype}, and a is {a.dtype}")
    peak = 255.0 if a.dtype == np.uint8 else 1.0
    error = float(np.mean(np.square(_differences(a, b, valid))))
    return 10 * math.log10(peak**2 / error) if error > 0 else math.inf


def median_color_error(a: Image, b: Image, *, valid: Mask | None = None) -> float:
    """Median absolute difference of two images, over all channels of what counts, in their units.

    Parameters
    ----------
    a, b : (H, W) or (H, W, C)
    valid : (H, W) bool, optional
        The pixels that count; all if not given.

    Examples
    --------
    >>> import numpy as np
    >>> from pyibr.images import metrics
    >>> metrics.median_color_error(np.full((3, 4, 3), 100, np.uint8), np.full((3, 4, 3), 90, np.uint8))
    10.0
    """
    return float(np.median(np.abs(_differences(a, b, valid))))


def depth_rmse(depth: Image, truth: Image, *, valid: Mask | None = None) -> float:
    """Root of the mean squared difference of two depth images, in scene units.

    Parameters
    ----------
    depth, truth : (H, W)
    valid : (H, W) bool, optional
        Pixels count if both depths are finite and > 0, and `valid` is True there if it is given. Holes
        therefore cost nothing: see `hole_ratio` for them.

    Examples
    --------
    >>> import numpy as np
    >>> from pyibr.images import metrics
    >>> metrics.depth_rmse(np.array([[1.0, 2.0, np.nan]]), np.array([[4.0, 5.0, 1.0]]))
    3.0
    """
    return math.sqrt(float(np.mean(np.square(_depth_differences(depth, truth, valid)))))


def median_depth_error(depth: Image, truth: Image, *, valid: Mask | None = None) -> float:
    """Median absolute difference of two depth images, in scene units; the pixels of `depth_rmse` count.

    Examples
    --------
    >>> import numpy as np
    >>> from pyibr.images import metrics
    >>> metrics.median_depth_error(np.full((3, 4), 2.5, np.float32), np.full((3, 4), 2, np.float32))
    0.5
    """
    return float(np.median(np.abs(_depth_differences(depth, truth, valid))))


def hole_ratio(valid: Mask, *, expected: Mask | None = None) -> float:
    """Share of the pixels that are holes.

    Parameters
    ----------
    valid : (H, W) bool
        Where something was seen, as `Frame.valid`.
    expected : (H, W) bool, optional
        The pixels that count: those where something can be seen. All if not given.

    Examples
    --------
    >>> import numpy as np
    >>> from pyibr.images import metrics
    >>> metrics.hole_ratio(np.array([[True, True, True, False]]))
    0.25
    """
    valid = _checked_mask("valid", valid)
    counts = _counting("expected", expected, valid.shape)
    return float(np.mean(~valid[counts]))


def silhouette_iou(a: Mask, b: Mask) -> float:
    """Pixels in both silhouettes over pixels in either, 0 to 1; all pixels of the image count.

    Parameters
    ----------
    a, b : (H, W) bool
        True inside.

    Examples
    --------
    >>> import numpy as np
    >>> from pyibr.images import metrics
    >>> metrics.silhouette_iou(np.array([[True, True, False]]), np.array([[True, False, False]]))
    0.5
    """
    a = _checked_mask("a", a)
    b = _checked_mask("b", b, a.shape)
    either = np.count_nonzero(a | b)
    if either == 0:
        raise ArgumentError("a", "a pixel inside of a or b", "none")
    return float(np.count_nonzero(a & b) / either)


def _differences(a: Image, b: Image, valid: Mask | None) -> Float64:
    a, b = _image("a", a), _image("b", b)
    if a.shape != b.shape:
        raise ArgumentError("b", f"the shape of a, {a.shape}", describe(b))
    difference = a.astype(np.float64) - b.astype(np.float64)
    return difference[_counting("valid", valid, a.shape[:2])]


def _depth_differences(depth: Image, truth: Image, valid: Mask | None) -> Float64:
    depth, truth = _image("depth", depth), _image("truth", truth)
    if depth.shape != truth.shape:
        raise ArgumentError("truth", f"the shape of depth, {depth.shape}", describe(truth))
    known: Mask = np.isfinite(depth) & np.isfinite(truth) & (depth > 0) & (truth > 0)
    if valid is not None:
        known &= _checked_mask("valid", valid, depth.shape)
    return _differences(depth, truth, known)


def _counting(argument: str, mask: Mask | None, shape: tuple[int, ...]) -> Mask:
    """The mask of pixels that count: all of them if it is None, and never none of them."""
    counts = np.ones(shape, np.bool_) if mask is None else _checked_mask(argument, mask, shape)
    if not counts.any():
        raise ArgumentError(argument, "a pixel that counts", "none")
    return counts


def _checked_mask(argument: str, mask: object, shape: tuple[int, ...] | None = None) -> Mask:
    expected = f"bool of shape {'(H, W)' if shape is None else shape}"
    array = plain_array(argument, mask, expected)
    if array.dtype != np.bool_ or (shape is not None and array.shape != shape):
        raise ArgumentError(argument, expected, describe(mask))
    return array


def _image(argument: str, image: object) -> Image:
    expected = "an image of numbers"
    array = plain_array(argument, image, expected)
    if array.dtype.kind not in "uif":
        raise ArgumentError(argument, expected, describe(image))
    return array
