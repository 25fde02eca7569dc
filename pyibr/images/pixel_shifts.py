"""Differences of pictures that tolerate small shifts of pixels, for IV-PSNR."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_ROWS = 32  # rows per band, which fits into a processor's cache

_WEIGHTS = 4, 1, 1  # weights of luma and chroma, in the search and in the mean


def searched_psnr(
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
    for top in range(0, height, _ROWS):
        bottom = min(top + _ROWS, height)
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
