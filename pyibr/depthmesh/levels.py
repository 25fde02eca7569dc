"""Colours of views on the device, at several levels of detail for minification (kernels/depthmesh/blend.cl)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pyibr.core.checks import Float64
from pyibr.depthmesh.far_sides import FarSides
from pyibr.depthmesh.tree import Tree
from pyibr.images import DepthImage
from pyibr.meshes.textures import halved, rgba_words
from pyibr.opencl.memory import DeviceArray, upload

_FEATHER = 8  # samples over which a view's weight fades towards an end of its surface


@dataclass(frozen=True)
class ViewColors:
    """Colours of views: all levels of each view, one after the other, each half as large as the previous level."""

    words: DeviceArray  # RGBA; A: `feathers_of` on the finest levels, then 255 times the fraction of valid samples
    sizes: DeviceArray  # (levels, 3) width, height and start
    sources: NDArray[np.int32]  # (views, 4) index, first level and last level, and 1 for a perspective view
    focals: Float64  # (views,) samples per scene unit, at depth 1 in perspective views
    far_sides: DeviceArray | None  # RGBA of the continued surfaces behind depth edges, if rays close holes


def view_colors(
    views: Sequence[DepthImage],
    feathers: Sequence[NDArray[np.uint8]],
    gains: Float64 | None = None,
    continued: Sequence[FarSides] = (),
) -> ViewColors:
    """Upload the colours of views, multiplied by their `gains` (views, 3), and their `feathers_of`."""
    words, sizes = list[NDArray[np.uint32]](), list[tuple[int, int, int]]()
    sources, far_sides, start = list[tuple[int, int, int, bool]](), list[NDArray[np.uint32]](), 0
    for number, (view, feather) in enumerate(zip(views, feathers, strict=True)):
        first = len(sizes)
        for level in color_levels(view, feather, None if gains is None else gains[number]):
            sizes.append((*level.shape[::-1], start))
            words.append(level)
            start += level.size
        sources.append((number, first, len(sizes) - 1, view.camera.projection == "perspective"))
        if continued:
            far_sides.append(continued[number].colored(words[first]))
    return ViewColors(
        _joined(words),
        upload(np.array(sizes, np.int32)),
        np.array(sources, np.int32),
        np.sqrt([view.camera.K[0, 0] * view.camera.K[1, 1] for view in views]),
        _joined(far_sides) if far_sides else None,
    )


def _joined(images: Sequence[NDArray[np.uint32]]) -> DeviceArray:
    return upload(np.concatenate([image.ravel() for image in images]))


def feathers_of(tree: Tree) -> NDArray[np.uint8]:
    """(H, W) weights of a view's samples: 255 inside, down to 1 at the ends of the surface; 0 where depth is invalid.

    The weights fade towards depth edges, holes and the image border, with the chessboard distance.
    """
    upper, lower = tree.drawn_cells()
    whole = np.pad(upper & lower, 1)
    inner = whole[1:, 1:] & whole[1:, :-1] & whole[:-1, 1:] & whole[:-1, :-1]
    distance = inner.astype(np.uint8)
    for _ in range(_FEATHER - 1):
        rows = np.pad(inner, 1)
        rows = rows[1:-1] & rows[:-2] & rows[2:]
        inner = rows[:, 1:-1] & rows[:, :-2] & rows[:, 2:]
        distance += inner
    return np.where(tree.view.valid, np.maximum(distance * (255 / _FEATHER), 1), 0).astype(np.uint8)


def color_levels(
    view: DepthImage, feather: NDArray[np.uint8], gains: Float64 | None = None
) -> Iterator[NDArray[np.uint32]]:
    """RGBA words (h, w) of each level, down to 1x1: colours times `gains` (3,), A as in `ViewColors.words`."""
    height, width = view.valid.shape
    shown = view.shown_color
    if gains is not None:
        white = 255 if shown.dtype == np.uint8 else 1
        shown = np.clip(shown * (gains / white), 0, 1).astype(np.float32)
    words = rgba_words(shown).reshape(height, width)
    yield words & np.uint32(0xFFFFFF) | feather.astype(np.uint32) << np.uint32(24)
    sound = np.where(view.valid, words, np.uint32(0)).view(np.uint8).reshape(height, width, 4)
    level = sound.astype(np.float32)  # colours times the fraction of valid samples, and this fraction
    while max(level.shape[:2]) > 1:
        height, width = level.shape[:2]
        level = halved(np.pad(level, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge"))
        rgba = np.ceil(level).astype(np.uint8)
        rgba[..., :3] = np.rint(level[..., :3] * (255 / np.maximum(level[..., 3:], np.float32(1e-3))))
        yield rgba.view(np.uint32)[..., 0]
