"""Colours as screens show them (sRGB, IEC 61966-2-1), and linear in light, as renderers and OpenEXR have them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def srgb_from_linear(linear: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return colours in [0, 1] as screens show them; what is less or more, as highlights are, is clipped."""
    light = np.clip(np.nan_to_num(linear), 0, 1)
    return np.where(light <= 0.0031308, light * 12.92, 1.055 * light ** (1 / 2.4) - 0.055)


def linear_from_srgb(shown: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return the light of colours in [0, 1] as screens show them: the way back."""
    return np.where(shown <= 0.04045, shown / 12.92, ((shown + 0.055) / 1.055) ** 2.4)
