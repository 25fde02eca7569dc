"""Depth images of a plate in front of a wall. Each sample's surface is known, and so are triangles that bridge both."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pyibr.images import DepthImage
from tests import scenes

Shape = Callable[[np.ndarray, np.ndarray], np.ndarray]

PLATES: dict[str, tuple[Shape, Shape]] = {  # depths of the plate and of the wall
    "flat": (lambda a, b: 3.2 + 0 * a, lambda a, b: 4.8 + 0 * a),
    "close": (lambda a, b: 4.0 + 0 * a, lambda a, b: 4.5 + 0 * a),
    "tilted": (lambda a, b: 3.2 + 0.6 * a - 0.4 * b, lambda a, b: 4.9 - 0.5 * a + 0.3 * b),
    "steep": (lambda a, b: 1 / (0.26 + 0.2 * a), lambda a, b: 14.0 + 0.5 * a),
    "curved": (
        lambda a, b: 3.4 + 0.6 * (a**2 + b**2),
        lambda a, b: 4.9 + 0.15 * np.sin(4 * a + 1) * np.cos(3 * b),
    ),
}


def layered(name: str, size: scenes.Size, projection: str) -> tuple[DepthImage, np.ndarray]:
    """The view, and the mask (H, W) of the plate, which consists of a disc and an oblique bar."""
    near, far = PLATES[name]
    a, b = scenes.image_coordinates(size)
    plate = ((a + 0.3) ** 2 + (b + 0.2) ** 2 < 0.13) | ((np.abs(a - b - 0.2) < 0.15) & (np.abs(a + b - 0.4) < 0.4))
    view = scenes.scene(lambda a, b: np.where(plate, near(a, b), far(a, b)), size, projection)
    return view, plate


def bridging(plate: np.ndarray) -> np.ndarray:
    """(H - 1, W - 1, 2) bool: whether each cell's upper and lower triangle have corners on both plate and wall."""
    y, x = np.mgrid[: plate.shape[0] - 1, : plate.shape[1] - 1]
    four = np.stack([plate[y, x], plate[y, x + 1], plate[y + 1, x], plate[y + 1, x + 1]], -1)
    main = ((x + y) % 2 == 0)[..., None]
    upper = np.where(main, four[..., [0, 1, 3]], four[..., [0, 1, 2]])
    lower = np.where(main, four[..., [0, 2, 3]], four[..., [1, 2, 3]])
    found = np.stack([upper, lower], axis=2)
    return found.any(axis=-1) & ~found.all(axis=-1)
