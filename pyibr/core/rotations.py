"""Rotations as matrices, quaternions and OpenCV's axis-angle vectors."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from pyibr.core.checks import Float64, describe, numbers
from pyibr.core.errors import ArgumentError


def rotation_from_quaternion(wxyz: Float64) -> Float64:
    """Return the (3, 3) rotation of a quaternion (w, x, y, z) of any length."""
    largest = float(np.abs(wxyz).max())
    if largest == 0:
        raise ArgumentError("qvec", "a quaternion (w, x, y, z) of length 1", "zeros")
    scaled = wxyz / largest  # avoids overflow of the squares
    w, x, y, z = scaled / np.linalg.norm(scaled)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def quaternion_from_rotation(rotation: Float64) -> Float64:
    """Return the quaternion (w, x, y, z), w >= 0, of the rotation nearest to `rotation` (3, 3).

    It is the eigenvector of the largest eigenvalue of Bar-Itzhack's symmetric matrix. This stays exact at half turns,
    where formulas from the trace lose digits.
    """
    (a, b, c), (d, e, f), (g, h, i) = rotation
    symmetric = np.array(
        [
            [a + e + i, h - f, c - g, d - b],
            [h - f, a - e - i, b + d, c + g],
            [c - g, b + d, e - a - i, f + h],
            [d - b, c + g, f + h, i - a - e],
        ]
    )
    quaternion = np.linalg.eigh(symmetric)[1][:, -1]
    return -quaternion if quaternion[0] < 0 else quaternion


def upright_axes(up: ArrayLike) -> Float64:
    """Return the (3, 3) rotation R for rows of points: `points @ R` has y up, where `up`, along an axis, was up."""
    direction = np.asarray(up, np.float64)
    axis = int(np.abs(direction).argmax())
    return np.roll(np.eye(3), 1 - axis, axis=1) * ((1, -1, -1) if direction[axis] < 0 else (1, 1, 1))


def rotation_from_opencv(rotation: object) -> Float64:
    """Return the (3, 3) rotation of OpenCV's axis-angle vector of 3 numbers, or of a rotation matrix."""
    array = np.asarray(rotation)
    if array.shape == (3, 3):
        return numbers("rotation", rotation, (3, 3))
    if array.size != 3:
        raise ArgumentError("rotation", "an axis-angle vector (3,) or a matrix (3, 3)", describe(rotation))
    vector = numbers("rotation", array.reshape(3), (3,))
    angle = float(np.linalg.norm(vector))
    axis = vector / angle if angle > 0 else vector
    return rotation_from_quaternion(np.array([np.cos(angle / 2), *(np.sin(angle / 2) * axis)]))


def rvec_from_rotation(rotation: Float64) -> Float64:
    """Return OpenCV's axis-angle vector (3,), of length 0 to pi, of a (3, 3) rotation."""
    w, *xyz = quaternion_from_rotation(rotation)
    sine = float(np.linalg.norm(xyz))
    return np.asarray(xyz) * (2 * np.arctan2(sine, w) / sine if sine > 0 else 2.0)
