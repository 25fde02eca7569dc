"""Colours as bytes; sRGB colours for screens (IEC 61966-2-1) and linear colours of renderers and OpenEXR."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def in_bytes(color: NDArray[Any]) -> NDArray[np.uint8]:
    """Return colours in [0, 1], or bytes, as bytes; white for depth alone, (H, W, 0)."""
    if color.shape[-1] == 0:
        return np.full((*color.shape[:-1], 3), 255, np.uint8)
    return color if color.dtype == np.uint8 else np.rint(np.clip(np.nan_to_num(color), 0, 1) * 255).astype(np.uint8)


def srgb_from_linear(linear: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return sRGB colours in [0, 1]; values outside, such as highlights, are clipped."""
    light = np.clip(np.nan_to_num(linear), 0, 1)
    return np.where(light <= 0.0031308, light * 12.92, 1.055 * light ** (1 / 2.4) - 0.055)


def linear_from_srgb(shown: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return the linear colours of sRGB colours in [0, 1]."""
    return np.where(shown <= 0.04045, shown / 12.92, ((shown + 0.055) / 1.055) ** 2.4)
