"""Levels of a height map for relief mapping: means for distant surfaces, and bounds for steps that miss nothing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pyibr.meshes.heights import Wrap, Wraps, following
from pyibr.meshes.textures import halved

Float32 = NDArray[np.float32]


@dataclass(frozen=True)
class HeightLevels:
    """All levels of a height map, largest first, and a hierarchy of bounds for each, as in kernels/relief/search.h."""

    texels: NDArray[np.uint32]  # words of kernels/lib/heights.h: four heights of 8 bits, or two of 16
    bounds: NDArray[np.uint16]  # an even number, because kernels read two together
    table: NDArray[np.int32]  # (levels, LEVEL_INTS)
    height_bytes: int  # 1 or 2: the kernels' HEIGHT_BYTES


def height_levels(height: Float32, height_bytes: int, wrap: Wraps) -> HeightLevels:
    """Return the levels of heights (h, w) in [0, 1], each half as large as the one before, rounded down.

    `height_bytes` is 1 if the heights are multiples of 1/255: reading them takes half the time. `wrap` gives, along u
    and v, the neighbours of the last texels: "repeat" the first texels, "clamp" the last texels themselves.
    """
    words: list[NDArray[np.uint32]] = []
    bounds: list[NDArray[np.uint16]] = []
    rows: list[list[int]] = []
    level, start, bound_start = height, 0, 0
    lost = 0.0
    while True:
        h, w = level.shape
        fixed_max = 255 if height_bytes == 1 else 65535
        fixed = np.rint(level * np.float32(fixed_max)).astype(np.uint32)
        right, down = following(fixed, 1, wrap), following(fixed, 0, wrap)
        across = following(right, 0, wrap)
        if height_bytes == 1:
            words.append((fixed | right << 8 | down << 16 | across << 24).astype(np.uint32).ravel())
        else:
            words.append((fixed | right << 16).astype(np.uint32).ravel())
        cell = np.maximum(np.maximum(fixed, right), np.maximum(down, across)) * (65535 // fixed_max)
        (count, pitch, span), tiers = _tiers_of(cell)
        bounds.append(tiers)
        rows.append([w, h, start, count, bound_start, pitch, span, int(np.ceil(65535 * min(lost, 1.0)))])
        bound_start += tiers.size
        start += fixed.size
        if w == h == 1:
            break
        finer, level = level, halved(level)
        lost += float(np.abs(finer - _stretched(_stretched(level, w, wrap[0]).T, h, wrap[1]).T).max())
    return HeightLevels(np.concatenate(words), np.concatenate(bounds), np.array(rows, np.int32), height_bytes)


def _tiers_of(cell: NDArray[np.uint32]) -> tuple[list[int], NDArray[np.uint16]]:
    """Bounds in tiers: for cells, for 2x2 cells, and so on up to one bound; see BOUND_AT of kernels/relief/search.h.

    The tiers lie side by side, or one below the other if the map is taller than wide. The rows' length is a power of 2.
    Returns [number of tiers, log2 of the rows' length, span], and the tiers (m,): tier t starts at span - (span >> t).
    """
    h, w = cell.shape
    count = (max(w, h) - 1).bit_length() + 1
    pitch, rows = (count, h) if w >= h else ((w - 1).bit_length(), 1 << count)
    span = 1 << (count if w >= h else count + pitch)
    tiers = np.zeros((rows, 1 << pitch), np.uint16)
    for tier in range(count):
        top, left = divmod(span - (span >> tier), 1 << pitch)
        tiers[top : top + cell.shape[0], left : left + cell.shape[1]] = cell
        padded = np.pad(cell, ((0, cell.shape[0] % 2), (0, cell.shape[1] % 2)))
        cell = padded.reshape(padded.shape[0] // 2, 2, -1, 2).max(axis=(1, 3))
    return [count, pitch, span], tiers.ravel()


def _stretched(level: Float32, columns: int, wrap: Wrap) -> Float32:
    """A map's rows, sampled bilinearly at this many places."""
    n = level.shape[1]
    x = (np.arange(columns) + 0.5) * (n / columns) - 0.5
    left = np.floor(x).astype(int)
    part = (x - left).astype(np.float32)
    there = [k % n if wrap == "repeat" else k.clip(0, n - 1) for k in (left, left + 1)]
    return np.asarray((1 - part) * level[:, there[0]] + part * level[:, there[1]], np.float32)
