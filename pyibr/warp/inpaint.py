"""Filling of holes by OpenCV on the host."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.core.optional import opencv
from pyibr.opencl.memory import copy, to_host, upload
from pyibr.picture.target import Target

_RADIUS = 3  # radius in pixels of the surroundings that determine a hole's pixel
_STEPS = 65535.0  # steps of floats' range: OpenCV adds about a step to each pixel, whatever the image's range is


def inpaint(target: Target) -> None:
    """Continue colour and depth from around the holes into them (Telea 2004)."""
    cv2 = opencv('fill="inpaint"', "inpaint")
    color, depth, valid = to_host([target.color, target.depth, target.valid])
    known = valid != 0
    if known.all() or not known.any():
        return
    perspective = target.camera.projection == "perspective"
    solid = np.where(known, depth, np.float32(1))
    found = _inpainted(cv2, 1 / solid if perspective else solid, known)  # planes are linear in nearness
    made = [(np.where(known, depth, 1 / found if perspective else found).astype(np.float32), target.depth)]
    if color.dtype == np.uint8 and color.size:
        made.append((_inpainted(cv2, color, known), target.color))
    elif color.size:
        channels = [_inpainted(cv2, np.ascontiguousarray(color[..., i]), known) for i in range(3)]
        made.append((np.dstack(channels), target.color))
    for array, into in made:
        copy(upload(array), into)


def _inpainted(cv2: Any, image: NDArray[Any], known: NDArray[np.bool_]) -> NDArray[Any]:
    """Fill the unknown pixels of an image, (H, W, 3) uint8 or (H, W) float32, within the range of its known ones."""
    low, high = image[known].min(), image[known].max()
    if image.dtype == np.uint8:
        return _filled(cv2, image, known, low, high)
    if low == high:
        return np.full_like(image, low)
    steps = _filled(cv2, (image - low) * (_STEPS / (high - low)), known, 0, _STEPS)
    return np.where(known, image, low + steps * ((high - low) / _STEPS))


def _filled(cv2: Any, image: NDArray[Any], known: NDArray[np.bool_], low: Any, high: Any) -> NDArray[Any]:
    framed = cv2.copyMakeBorder(image, 1, 1, 1, 1, cv2.BORDER_REPLICATE)  # OpenCV reads beyond images of one row
    holes = cv2.copyMakeBorder((~known).astype(np.uint8), 1, 1, 1, 1, cv2.BORDER_REPLICATE)
    return np.clip(cv2.inpaint(framed, holes, _RADIUS, cv2.INPAINT_TELEA)[1:-1, 1:-1], low, high)
