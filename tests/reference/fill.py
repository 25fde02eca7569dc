"""Holes filled from the farther side, in NumPy float64: all holes of an image walk along their lines step by step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

SAME_DEPTH, OTHER_DEPTH = 1.02, 1.1
UNDECIDED = 1e-4  # pixels: rounding may take what lies that close to the middle between two pixels for either


@dataclass
class Filled:
    """What an image is after filling."""

    color: Array  #: (H, W, 3) float64
    depth: Array  #: (H, W) float64
    decided: Array  #: (H, W) bool: which pixels the line passes does not hang on rounding


def fill_reference(color: Array, depth: Array, valid: Array, epipole: tuple[float, float, float]) -> Filled:
    """A hole's line leads away from the epipole, and back to it, in steps of a pixel along its longer axis.

    Parameters
    ----------
    color : (H, W, 3)
    depth : (H, W)
    valid : (H, W) bool
    epipole : (x, y, w)
        Homogeneous; all 0: the lines are the rows.
    """
    y, x = holes = np.nonzero(~valid)
    at = np.stack([x, y], axis=-1).astype(float)
    away = at * epipole[2] - epipole[:2]
    longest = np.abs(away).max(axis=-1, initial=0.0, keepdims=True)
    away = np.where(longest > 0, away / np.where(longest > 0, longest, 1.0), (1.0, 0.0))
    a, b = _End(valid, at, away), _End(valid, at, -away)

    result = Filled(color.astype(float), depth.astype(float), np.ones(valid.shape, bool))
    at_epipole = (longest[:, 0] == 0) & any(epipole)  # there, rounding decides on the direction
    result.decided[holes] = a.decided & b.decided & ~at_epipole
    values = np.concatenate([result.color, result.depth[..., None]], axis=-1)
    part = np.where(a.found, 0.0, 1.0)  # of b
    both = a.found & b.found
    za, zb = (end.values(result.depth)[both] for end in (a, b))
    ratio = np.maximum(za, zb) / np.minimum(za, zb)
    t = np.clip((ratio - SAME_DEPTH) / (OTHER_DEPTH - SAME_DEPTH), 0.0, 1.0)
    apart = t * t * (3.0 - 2.0 * t)
    by_distance = a.steps[both] / (a.steps + b.steps)[both]
    part[both] = by_distance * (1.0 - apart) + (za < zb) * apart
    between = (1.0 - part)[:, None] * a.values(values) + part[:, None] * b.values(values)
    some = a.found | b.found
    filled = y[some], x[some]
    result.color[filled], result.depth[filled] = between[some, :3], between[some, 3]
    return result


class _End:
    """The first valid pixels from places on."""

    def __init__(self, valid: Array, at: Array, step: Array) -> None:
        height, width = valid.shape
        count = len(at)
        self.found, self.decided = np.zeros(count, bool), np.ones(count, bool)
        self.steps, self.pixels = np.zeros(count, int), np.zeros((count, 2), int)
        walking = np.arange(count)
        for number in range(1, max(width, height) + 1):
            place = at[walking] + number * step[walking]
            pixel = np.rint(place).astype(int)
            self.decided[walking] &= (np.abs(place - np.floor(place) - 0.5) > UNDECIDED).all(axis=-1)
            inside = ((pixel >= 0) & (pixel < (width, height))).all(axis=-1)
            walking, pixel = walking[inside], pixel[inside]
            there = valid[pixel[:, 1], pixel[:, 0]]
            ends = walking[there]
            self.found[ends], self.steps[ends], self.pixels[ends] = True, number, pixel[there]
            walking = walking[~there]

    def values(self, image: Array) -> Array:
        """What the image is there; 0 where there is no end."""
        found = self.found.reshape(-1, *[1] * (image.ndim - 2))
        return np.where(found, image[self.pixels[:, 1], self.pixels[:, 0]], 0.0)
