"""Other libraries' camera conventions, as functions of plain arrays.

pyibr's own convention: x right, y down, z forward; pixel centres at integers; `world_from_camera` maps column
vectors. Each function here turns numbers of one other convention into these, or back.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypedDict

import numpy as np

from pyibr.core.checks import Float64, describe, numbers
from pyibr.core.errors import ArgumentError

# y up and z backward (OpenGL, NeRF) against y down and z forward; its own inverse.
CV_FROM_GL = np.diag([1.0, -1.0, -1.0, 1.0])
# x left and y up (PyTorch3D) against x right and y down; its own inverse.
CV_FROM_PYTORCH3D = np.diag([-1.0, -1.0, 1.0])

# Parameters before the distortion coefficients, and the coefficients' places in OpenCV's order k1 k2 p1 p2
# k3 ...
_COLMAP_MODELS: Mapping[str, tuple[int, int]] = {
    "SIMPLE_PINHOLE": (3, 0),
    "PINHOLE": (4, 0),
    "SIMPLE_RADIAL": (3, 1),
    "RADIAL": (3, 2),
    "OPENCV": (4, 4),
    "FULL_OPENCV": (4, 8),
}


class PyTorch3DCamera(TypedDict):
    """Arguments of `pytorch3d.renderer.PerspectiveCameras`, without the batch dimension."""

    R: Float64
    T: Float64
    focal_length: Float64
    principal_point: Float64
    image_size: tuple[int, int]
    in_ndc: bool


def with_principal_point_moved(K: Float64, by: float) -> Float64:
    """Return `K` with `by` pixels added to its principal point."""
    moved = K.copy()
    moved[:2, 2] += by
    return moved


def pose_from_extrinsics(rotation: Float64, translation: Float64) -> Float64:
    """Invert x_camera = rotation x_world + translation into a (4, 4) `world_from_camera`."""
    pose = np.eye(4)
    pose[:3, :3] = rotation.T
    pose[:3, 3] = -rotation.T @ translation
    return pose


def rotation_from_quaternion(wxyz: Float64) -> Float64:
    """Return the (3, 3) rotation of a quaternion (w, x, y, z), which need not be of length 1."""
    length = float(np.linalg.norm(wxyz))
    if length == 0:
        raise ArgumentError("qvec", "a quaternion (w, x, y, z) of length 1", "zeros")
    w, (x, y, z) = wxyz[0] / length, wxyz[1:] / length
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def quaternion_from_rotation(rotation: Float64) -> Float64:
    """Return the quaternion (w, x, y, z), w >= 0, of the rotation nearest to `rotation` (3, 3).

    It is the eigenvector of the largest eigenvalue of Bar-Itzhack's symmetric matrix, which stays exact at
    half turns, where formulas from the trace lose their digits.
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


def intrinsics_from_colmap(model: str, params: object) -> tuple[Float64, Float64]:
    """Return K (pixel centres at integers) and OpenCV's distortion coefficients of a COLMAP camera."""
    if model not in _COLMAP_MODELS:
        raise ArgumentError("model", f"one of {', '.join(_COLMAP_MODELS)}", describe(model))
    linear, distorted = _COLMAP_MODELS[model]
    values = numbers(f"params of {model}", params, (linear + distorted,))
    fx, fy, cx, cy = values[[0, 0, 1, 2]] if linear == 3 else values[:4]
    distortion = np.zeros(8 if distorted == 8 else 4)
    distortion[:distorted] = values[linear:]
    return np.array([[fx, 0, cx - 0.5], [0, fy, cy - 0.5], [0, 0, 1]]), distortion


def pytorch3d_from_camera(K: Float64, size: tuple[int, int], camera_from_world: Float64) -> PyTorch3DCamera:
    """Return the arguments of `PerspectiveCameras`: row vectors, x left, y up, NDC over the shorter side."""
    half = min(size) / 2
    return {
        "R": (CV_FROM_PYTORCH3D @ camera_from_world[:3, :3]).T,
        "T": CV_FROM_PYTORCH3D @ camera_from_world[:3, 3],
        "focal_length": np.array([K[0, 0], K[1, 1]]) / half,
        "principal_point": -(K[:2, 2] + 0.5 - np.array(size) / 2) / half,
        "image_size": (size[1], size[0]),
        "in_ndc": True,
    }


def camera_from_pytorch3d(
    R: object, T: object, focal_length: object, principal_point: object, size: tuple[int, int]
) -> tuple[Float64, Float64]:
    """Return K and `world_from_camera` of one `PerspectiveCameras` in NDC."""
    half = min(size) / 2
    focal = numbers("focal_length", focal_length, (2,)) * half
    center = np.array(size) / 2 - numbers("principal_point", principal_point, (2,)) * half - 0.5
    rotation = CV_FROM_PYTORCH3D @ numbers("R", R, (3, 3)).T
    translation = CV_FROM_PYTORCH3D @ numbers("T", T, (3,))
    K = np.array([[focal[0], 0, center[0]], [0, focal[1], center[1]], [0, 0, 1]])
    return K, pose_from_extrinsics(rotation, translation)
