"""Adds noise of nine kinds to exact depth: as cameras, file formats and neural networks make it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

FOCAL_BASELINE = 600 * 0.075  # pixels times metres: a typical depth camera of 640 x 480
_LEVELS = 255  # steps of 8 bits, from the smallest to the largest 1/depth
_QUARTER = 0.25  # pixels of disparity
_MILLIMETRES = 0.003  # standard deviation in metres
_DISPARITY = 0.1  # standard deviation in pixels, as of structured light
_PROPORTION = 0.005  # standard deviation relative to the depth
_BLURRED, _SPREAD = 0.01, 8.0  # standard deviation relative to the depth; radius of the blur in samples
_WHITE = 0.0005  # standard deviation relative to the depth, independent in each sample


def _rounded(depth: Array, step: float) -> Array:
    return np.maximum(np.round(depth / step), 1) * step


def _eight_bits(depth: Array, rng: np.random.Generator) -> Array:
    near, far = 1 / np.nanmin(depth), 1 / np.nanmax(depth)
    step = (near - far) / _LEVELS or near
    return 1 / (far + step * np.round((1 / depth - far) / step))


def _of_disparity(depth: Array, rng: np.random.Generator) -> Array:
    """Add noise to the disparity, and keep it at a quarter pixel or more, so that no sample lies behind the camera."""
    disparity = FOCAL_BASELINE / depth + rng.normal(0, _DISPARITY, depth.shape)
    return FOCAL_BASELINE / np.maximum(disparity, _QUARTER)


def _blurred(depth: Array, rng: np.random.Generator) -> Array:
    """Multiply depth by a factor that changes slowly over the image, and add a little white noise."""
    spectrum = np.fft.rfft2(rng.normal(size=depth.shape))
    v, u = np.fft.fftfreq(depth.shape[0])[:, None], np.fft.rfftfreq(depth.shape[1])
    field = np.fft.irfft2(spectrum * np.exp(-2 * (np.pi * _SPREAD) ** 2 * (u * u + v * v)), depth.shape)
    return depth * (1 + _BLURRED * field / field.std() + rng.normal(0, _WHITE, depth.shape))


_KINDS: dict[str, Callable[[Array, np.random.Generator], Array]] = {
    "none": lambda depth, rng: depth,
    "millimetres": lambda depth, rng: _rounded(depth, 0.001),
    "centimetres": lambda depth, rng: _rounded(depth, 0.01),
    "8-bit disparity": _eight_bits,
    "quarter-pixel disparity": lambda depth, rng: FOCAL_BASELINE / _rounded(FOCAL_BASELINE / depth, _QUARTER),
    "3 mm": lambda depth, rng: depth + rng.normal(0, _MILLIMETRES, depth.shape),
    "0.1 px of disparity": _of_disparity,
    "0.5 % of depth": lambda depth, rng: depth * (1 + rng.normal(0, _PROPORTION, depth.shape)),
    "blurred": _blurred,
}
NOISES = tuple(_KINDS)


def noisy(depth: Array, noise: str, seed: int) -> NDArray[np.float32]:
    """Add one of the `NOISES` to depth in metres."""
    return _KINDS[noise](depth, np.random.default_rng(seed)).astype(np.float32)
