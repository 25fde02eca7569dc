"""Metrics that compare two pictures, or the depths of two frames.

Each metric documents the pixels that it counts. If no pixel counts, it raises ArgumentError instead of returning NaN.
SSIM and FLIP come from scikit-image and NVIDIA (extra `metrics`); the others need only NumPy.
"""

from __future__ import annotations

import math
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pyibr.core.checks import Float64, describe, integer_from, one_of, plain_array, positive
from pyibr.core.errors import ArgumentError
from pyibr.core.optional import flip_evaluator, scikit_image

__all__ = [
    "depth_rmse",
    "flip",
    "hole_ratio",
    "iv_psnr",
    "median_color_error",
    "median_depth_error",
    "psnr",
    "silhouette_iou",
    "ssim",
    "ws_psnr",
]

Mask = NDArray[np.bool_]
Image = NDArray[np.number[Any]]
Space = Literal["rgb", "ycbcr"]

_SSIM_SIDE, _SSIM_SIGMA = 11, 1.5  # pixels: the window of Wang et al. 2004
_DESK = 3840 * math.pi / 180  # pixels per degree of a screen 3840 pixels wide, seen from as far as it is wide
_BAND = 32  # rows of IV-PSNR that are searched together, which fit into a processor's cache
_WEIGHTS = 4, 1, 1  # weights of Y, Cb and Cr in IV-PSNR, both in the search and in the mean
_LUMA = 0.2126, 0.7152, 0.0722  # weights of red, green and blue by BT.709


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
        infinite if the images are equal there.

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
    a, b, peak = _pictures(a, b)
    return _decibels(float(np.mean(np.square(_differences(a, b, valid)))), peak)


def ws_psnr(a: Image, b: Image, *, latitudes: float = 180.0, valid: Mask | None = None) -> float:
    """WS-PSNR of two equirectangular panoramas: PSNR with rows weighted by their area on the sphere.

    By Sun, Lu and Yu (IEEE Signal Processing Letters 2017): the weight of row j of N is cos((j + 0.5 - N / 2) pi / N).

    Parameters
    ----------
    a, b, valid
        As in `psnr`.
    latitudes : float
        Degrees that the rows cover, half of them above the horizon.

    Returns
    -------
    float
        In dB, over all channels; infinite if the images are equal.

    Examples
    --------
    >>> import numpy as np
    >>> from pyibr.images import metrics
    >>> black = np.zeros((4, 8, 3))
    >>> round(metrics.ws_psnr(black, black + 0.1), 6)
    20.0
    """
    a, b, peak = _pictures(a, b)
    rows, columns = map(int, a.shape[:2])
    half = math.radians(positive("latitudes", latitudes)) / 2
    edge = half * (1 - 1 / rows)
    weights = np.cos(np.linspace(-edge, edge, rows))[:, None] * _counting("valid", valid, (rows, columns))
    squares = np.square(_differences(a, b, None)).reshape(rows, columns, -1).mean(axis=-1)
    return _decibels(float((weights * squares).sum() / weights.sum()), peak)


def iv_psnr(
    a: Image, b: Image, *, valid: Mask | None = None, space: Space = "rgb", bits: int = 8, reach: int = 2
) -> float:
    """IV-PSNR of two pictures, for synthesised views: PSNR that tolerates small shifts and changes of exposure.

    By Dziembowski et al. (IEEE TCSVT 2022), with the parameters of MPEG. First, the mean difference of each component
    is removed, up to 1 % of the range. Then each pixel is compared with the most similar of 5 x 5 pixels of the other
    picture. Both directions are evaluated, and the lower value counts. Components are weighted 4 : 1 : 1.

    Parameters
    ----------
    a, b : (H, W, 3), both uint8 or both floats in [0, 1]; YCbCr may also be integers of `bits` bits
    valid : (H, W) bool, optional
        The pixels that count, and with which pixels of the other picture are compared; all if not given.
    space : {"rgb", "ycbcr"}
        RGB is converted to YCbCr by BT.709, in the range of videos (16 to 235).
    bits : int
        Bits per component of YCbCr, 8 to 16.
    reach : int
        Distance of the search to each side, in pixels.

    Returns
    -------
    float
        In dB; infinite if the pictures are equal.

    Examples
    --------
    >>> import numpy as np
    >>> from pyibr.images import metrics
    >>> noise = np.random.default_rng(0).integers(0, 256, (20, 30, 3), np.uint8)
    >>> metrics.psnr(noise[:, 1:], noise[:, :-1]) < 10 < metrics.iv_psnr(noise[:, 1:], noise[:, :-1])
    True
    """
    one_of("space", space, Space)
    bits, reach = integer_from("bits", bits, 8, 16), integer_from("reach", reach, 0, 16)
    a, b = _pair("a", a, "b", b) if space == "ycbcr" else _pictures(a, b)[:2]
    _check_color("a", a)
    first, second = (_components(one, space, bits) for one in (a, b))
    return _searched_psnr(first, second, _counting("valid", valid, a.shape[:2]), (1 << bits) - 1, reach)


def ssim(a: Image, b: Image, *, valid: Mask | None = None) -> float:
    """Structural similarity of two images (Wang et al. 2004), -1 to 1, where 1 is equal; by scikit-image.

    Windows are Gaussian, of 11 x 11 pixels and a sigma of 1.5; only windows inside the image count. Several channels
    are averaged.

    Parameters
    ----------
    a, b, valid
        As in `psnr`, of 11 x 11 pixels or more.

    Raises
    ------
    MissingPackageError
        scikit-image is not installed.

    Examples
    --------
    >>> import numpy as np
    >>> from pyibr.images import metrics
    >>> noise = np.random.default_rng(0).random((20, 30, 3))
    >>> metrics.ssim(noise, noise)
    1.0
    """
    a, b, peak = _pictures(a, b)
    height, width = a.shape[:2]
    if min(height, width) < _SSIM_SIDE:
        raise ArgumentError("a", f"{_SSIM_SIDE} x {_SSIM_SIDE} pixels or more", describe(a))
    edge = _SSIM_SIDE // 2
    inner = _counting("valid", valid, (height, width))[edge : height - edge, edge : width - edge]
    _, found = scikit_image().structural_similarity(
        a.astype(np.float64),
        b.astype(np.float64),
        data_range=peak,
        channel_axis=-1 if a.ndim == 3 else None,
        gaussian_weights=True,
        sigma=_SSIM_SIGMA,
        use_sample_covariance=False,
        full=True,
    )
    return float(found[edge : height - edge, edge : width - edge][_counting("valid", inner, inner.shape)].mean())


def flip(a: Image, b: Image, *, valid: Mask | None = None, pixels_per_degree: float = _DESK) -> float:
    """Mean FLIP of two pictures, 0 to 1: the perceived difference (Andersson et al. 2020), by NVIDIA.

    It is the mean of flip-evaluator's error map. The package's own mean is a float32 sum, which is off in the fifth
    digit for 1080p.

    Parameters
    ----------
    a, b : (H, W, 3), both uint8 or both floats in [0, 1]
        sRGB; `a` is the reference.
    valid : (H, W) bool, optional
        The pixels that count; all if not given.
    pixels_per_degree : float
        Angular resolution for the viewer; by default 67.02, for a 4K screen 0.7 m wide at a distance of 0.7 m.

    Raises
    ------
    MissingPackageError
        flip-evaluator is not installed.

    Examples
    --------
    >>> import numpy as np
    >>> from pyibr.images import metrics
    >>> black = np.zeros((20, 30, 3), np.uint8)
    >>> metrics.flip(black, black)
    0.0
    """
    a, b, peak = _pictures(a, b)
    _check_color("a", a)
    counts = _counting("valid", valid, a.shape[:2])
    shown = [np.clip(np.nan_to_num(one.astype(np.float32)) / np.float32(peak), 0, 1) for one in (a, b)]
    how = {"ppd": positive("pixels_per_degree", pixels_per_degree)}
    found, _, _ = flip_evaluator().evaluate(*shown, "LDR", applyMagma=False, computeMeanError=False, parameters=how)
    return float(np.reshape(found, counts.shape)[counts].mean(dtype=np.float64))


def median_color_error(a: Image, b: Image, *, valid: Mask | None = None) -> float:
    """Median absolute difference of two images, over all channels of the pixels that count, in the images' units.

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
        Pixels count if both depths are finite and > 0, and `valid`, if given, is True. Holes therefore have no effect;
        `hole_ratio` measures them.

    Examples
    --------
    >>> import numpy as np
    >>> from pyibr.images import metrics
    >>> metrics.depth_rmse(np.array([[1.0, 2.0, np.nan]]), np.array([[4.0, 5.0, 1.0]]))
    3.0
    """
    return math.sqrt(float(np.mean(np.square(_depth_differences(depth, truth, valid)))))


def median_depth_error(depth: Image, truth: Image, *, valid: Mask | None = None) -> float:
    """Median absolute difference of two depth images, in scene units; counts the same pixels as `depth_rmse`.

    Examples
    --------
    >>> import numpy as np
    >>> from pyibr.images import metrics
    >>> metrics.median_depth_error(np.full((3, 4), 2.5, np.float32), np.full((3, 4), 2, np.float32))
    0.5
    """
    return float(np.median(np.abs(_depth_differences(depth, truth, valid))))


def hole_ratio(valid: Mask, *, expected: Mask | None = None) -> float:
    """Fraction of pixels that are holes.

    Parameters
    ----------
    valid : (H, W) bool
        True where a surface was seen, as `Frame.valid`.
    expected : (H, W) bool, optional
        The pixels that count, where a surface can be seen; all if not given.

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
    """Intersection over union of two silhouettes, 0 to 1; all pixels of the image count.

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


def _pictures(a: object, b: object) -> tuple[Image, Image, float]:
    """Two pictures of equal shape and kind, and their peak."""
    first, second = _pair("a", a, "b", b)
    if not first.dtype == second.dtype == np.uint8 and {first.dtype.kind, second.dtype.kind} != {"f"}:
        raise ArgumentError("b", "uint8 if a is, else floats", f"{second.dtype}, and a is {first.dtype}")
    return first, second, 255.0 if first.dtype == np.uint8 else 1.0


def _check_color(argument: str, image: Image) -> None:
    if image.ndim != 3 or image.shape[2] != 3:
        raise ArgumentError(argument, "a picture of shape (H, W, 3)", describe(image))


def _decibels(error: float, peak: float) -> float:
    return 10 * math.log10(peak**2 / error) if error > 0 else math.inf


def _components(image: Image, space: Space, bits: int) -> NDArray[np.int32]:
    """(H, W, 3) YCbCr as integers of `bits` bits."""
    if space == "ycbcr" and image.dtype.kind != "f":
        return image.astype(np.int32)
    shown = image / 255.0 if image.dtype == np.uint8 else np.nan_to_num(image.astype(np.float64))
    if space == "ycbcr":
        return np.rint(shown * ((1 << bits) - 1)).astype(np.int32)
    luma = shown @ np.array(_LUMA)
    red, blue = ((shown[..., at] - luma) / (2 - 2 * _LUMA[at]) for at in (0, 2))
    parts = np.dstack([219 * luma + 16, 224 * blue + 128, 224 * red + 128]) * (1 << (bits - 8))
    return np.rint(parts).astype(np.int32)


def _pair(name: str, a: object, other: str, b: object) -> tuple[Image, Image]:
    """Two images of equal shape."""
    first, second = _image(name, a), _image(other, b)
    if first.shape != second.shape:
        raise ArgumentError(other, f"the shape of {name}, {first.shape}", describe(b))
    return first, second


def _differences(a: Image, b: Image, valid: Mask | None) -> Float64:
    a, b = _pair("a", a, "b", b)
    difference = a.astype(np.float64) - b.astype(np.float64)
    return difference[_counting("valid", valid, a.shape[:2])]


def _depth_differences(depth: Image, truth: Image, valid: Mask | None) -> Float64:
    depth, truth = _pair("depth", depth, "truth", truth)
    known: Mask = np.isfinite(depth) & np.isfinite(truth) & (depth > 0) & (truth > 0)
    if valid is not None:
        known &= _checked_mask("valid", valid, depth.shape)
    return _differences(depth, truth, known)


def _counting(argument: str, mask: Mask | None, shape: tuple[int, ...]) -> Mask:
    """Mask of the pixels that count, all if `mask` is None; ArgumentError if none counts."""
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


def _searched_psnr(
    reference: NDArray[np.int32], image: NDArray[np.int32], valid: NDArray[np.bool_], peak: int, reach: int
) -> float:
    """IV-PSNR of two (H, W, 3) pictures in YCbCr: the lower value when either picture is the reference."""
    most = round(0.01 * peak)
    mean = (reference - image)[valid].mean(axis=0)
    shift = np.clip(np.rint(mean).astype(np.int32), -most, most)
    both = (reference, image, shift), (image, reference, -shift)
    return min(_one_sided(a, b, by, valid, peak, reach) for a, b, by in both)


def _one_sided(
    reference: NDArray[np.int32],
    image: NDArray[np.int32],
    shift: NDArray[np.int32],
    valid: NDArray[np.bool_],
    peak: int,
    reach: int,
) -> float:
    height = len(image)
    margin = (reach, reach), (reach, reach)
    wide = np.ascontiguousarray(np.moveaxis(np.pad(reference, (*margin, (0, 0)), "edge"), -1, 0))
    known = np.pad(valid, margin, "edge")
    sums = np.zeros(3)
    for top in range(0, height, _BAND):
        bottom = min(top + _BAND, height)
        counts = valid[top:bottom]
        if counts.any():
            part = np.moveaxis(image[top:bottom] + shift, -1, 0)
            rows = slice(top, bottom + 2 * reach)
            sums += [squares[counts].sum() for squares in _nearest(part, wide[:, rows], known[rows], reach)]
    with np.errstate(divide="ignore"):
        quality = 10 * np.log10(float(peak) ** 2 * np.count_nonzero(valid) / sums)
    return float(np.dot(quality, _WEIGHTS) / sum(_WEIGHTS))


def _nearest(
    image: NDArray[np.int32], wide: NDArray[np.int32], known: NDArray[np.bool_], reach: int
) -> NDArray[np.int64]:
    """(3, h, w) squared differences to the most similar nearby pixel of the reference."""
    _, height, width = image.shape
    least = np.full((height, width), np.iinfo(np.int64).max)
    found = np.zeros(image.shape, np.int64)
    for y in range(2 * reach + 1):
        for x in range(2 * reach + 1):
            place = slice(y, y + height), slice(x, x + width)
            squares = np.square((image - wide[(slice(None), *place)]).astype(np.int64))
            error = np.tensordot(_WEIGHTS, squares, 1)
            better = (error < least) & known[place]
            np.copyto(least, error, where=better)
            np.copyto(found, squares, where=better)
    return found
