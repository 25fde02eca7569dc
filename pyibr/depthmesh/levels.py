"""Levels of a view's colours for targets that see it small (kernels/depthmesh/blend.cl)."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from pyibr._check import Float64
from pyibr.camera import Camera
from pyibr.images import DepthImage
from pyibr.raster import as_bytes


def color_levels(view: DepthImage) -> Iterator[tuple[NDArray[np.uint8], NDArray[np.uint8]]]:
    """Colours (h, w, 3) of a view's samples and 255 times the part of each texel that has some, down to 1x1."""
    color = as_bytes(view.color)
    yield color, np.where(view.valid, 255, 0).astype(np.uint8)
    part = view.valid.astype(np.float32)
    sums = color * part[..., None]
    while max(part.shape) > 1:
        part, sums = _halved(part), _halved(sums)
        mean = sums / np.maximum(part, 1e-6)[..., None]
        yield np.rint(mean).astype(np.uint8), np.ceil(255 * part).astype(np.uint8)


def _halved(image: NDArray[np.float32]) -> NDArray[np.float32]:
    """Means of 2x2, the last column and row of odd ones twice."""
    height, width = image.shape[:2]
    even = np.pad(image, ((0, height % 2), (0, width % 2), *(((0, 0),) * (image.ndim - 2))), mode="edge")
    return 0.25 * (even[::2, ::2] + even[1::2, ::2] + even[::2, 1::2] + even[1::2, 1::2])


def level_for(src: Camera, dst: Camera, middle: Float64) -> int:
    """The level of a view whose texels are as large as the target's pixels, at the middle of what is seen."""
    samples, pixels = (_pixels_per_unit(camera, middle) for camera in (src, dst))
    coarsest = (max(src.size) - 1).bit_length()
    return int(np.clip(np.floor(np.log2(samples / pixels) + 0.25), 0, coarsest))


def _pixels_per_unit(camera: Camera, point: Float64) -> float:
    """How large a camera sees a scene unit at a point."""
    focal = float(np.sqrt(camera.K[0, 0] * camera.K[1, 1]))
    away = float(np.linalg.norm(point - camera.center))
    return focal / max(away, 1e-12) if camera.projection == "perspective" else focal
