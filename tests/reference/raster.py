"""Weights and depths of triangles at pixels, in float64: a readable reference without pyibr's camera maths."""

from __future__ import annotations

import numpy as np

from pyibr.core.camera import Camera


def homogeneous(camera: Camera, points: np.ndarray) -> np.ndarray:
    """Homogeneous pixels (..., 3), U, V and W, of world points (..., 3); the pixels are (U / W, V / W)."""
    rotation, center = camera.world_from_camera[:3, :3], camera.world_from_camera[:3, 3]
    local = (points - center) @ rotation
    if camera.projection == "orthographic":
        local = np.concatenate([local[..., :2], np.ones_like(local[..., :1])], axis=-1)
    return local @ camera.K.T


def weights(camera: Camera, corners: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Weights (n, 3) of triangles' corners (n, 3, 3) for the points of the triangles' planes that pixels (n, 2) see.

    Pixel (x, y) sees the point sum w_k P_k if sum w_k (U_k, V_k, W_k) is a multiple of (x, y, 1). The sum of w_k is 1.
    """
    seen = np.concatenate([pixels, np.ones((len(pixels), 1))], axis=1)
    multiple = np.linalg.solve(homogeneous(camera, corners).transpose(0, 2, 1), seen[..., None])[..., 0]
    return multiple / multiple.sum(axis=1, keepdims=True)


def depths(camera: Camera, corners: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """(n,) planar depth of the triangles' planes at pixels."""
    z = (corners - camera.world_from_camera[:3, 3]) @ camera.world_from_camera[:3, 2]
    return (weights(camera, corners, pixels) * z).sum(axis=1)


def edge_distances(camera: Camera, corners: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Distances (n, 3) of pixels from the edge opposite each corner, in pixels, positive inside the triangle.

    All corners must lie in front of the camera.
    """
    place = homogeneous(camera, corners)
    place = place[..., :2] / place[..., 2:]
    p, q = np.roll(place, -1, axis=1), np.roll(place, -2, axis=1)
    along = q - p

    def across(points: np.ndarray) -> np.ndarray:
        return along[..., 0] * (points - p)[..., 1] - along[..., 1] * (points - p)[..., 0]

    length = np.linalg.norm(along, axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return across(pixels[:, None]) * np.sign(across(place)) / length
