"""Solids to make objects and hulls of, and cameras all round them."""

from __future__ import annotations

import numpy as np

from pyibr.camera import Camera
from pyibr.capture import MeshScene
from pyibr.images import DepthImage


def revolved(radius: np.ndarray, height: np.ndarray, colors: np.ndarray, closed: bool, sides: int = 64) -> MeshScene:
    """A profile turned about the y axis; radius, height (n,), colors (n, 3) uint8; closed: the last joins the first."""
    n = len(radius)
    angle = np.arange(sides) * 2 * np.pi / sides
    ring = np.stack([np.outer(np.cos(angle), radius), np.tile(height, (sides, 1)), np.outer(np.sin(angle), radius)], -1)
    i, j = np.mgrid[:sides, : n if closed else n - 1]
    a, b = i * n + j, i * n + (j + 1) % n
    c, d = (i + 1) % sides * n + (j + 1) % n, (i + 1) % sides * n + j
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    return MeshScene(ring.reshape(-1, 3), faces, np.tile(colors, (sides, 1)))


def torus() -> MeshScene:
    """Radii 1 and 0.4; red grows from the bottom to the top, green from the inside to the outside."""
    b = np.arange(32) * 2 * np.pi / 32
    colors = np.stack([128 + 120 * np.sin(b), 128 + 120 * np.cos(b), np.full(32, 60)], axis=-1).astype(np.uint8)
    return revolved(1 + 0.4 * np.cos(b), 0.4 * np.sin(b), colors, closed=True)


def cup() -> MeshScene:
    """Open at the top, y = 1, where its walls are 0.2 thick; blue outside, red on the floor inside, y = -0.7."""
    profile = np.array([(0, -1), (1, -1), (1, 1), (0.8, 1), (0.8, -0.7), (0.8, -0.7), (0, -0.7)])
    blue, green, red = (0, 0, 255), (0, 255, 0), (255, 0, 0)
    colors = np.array([blue, blue, blue, green, green, red, red], np.uint8)
    return revolved(profile[:, 0], profile[:, 1], colors, closed=False)


def ball(sides: int = 128) -> MeshScene:
    """Of radius 1."""
    a = np.linspace(-np.pi / 2, np.pi / 2, sides // 2 + 1)
    return revolved(np.cos(a), np.sin(a), np.full((len(a), 3), 200, np.uint8), closed=False, sides=sides)


def tilted_views(scene: MeshScene, size: tuple[int, int] = (100, 88), reach: float = 3.4) -> list[DepthImage]:
    """Eight views from near a cube's corners, each rolled; every other one is orthographic, `reach` scene units high."""
    views: list[DepthImage] = []
    for k in range(8):
        corner = np.array([k & 1, k >> 1 & 1, k >> 2]) * 2.0 - 1 + 0.2 * np.sin([k, 2 * k, 3 * k])
        eye, up = 5 * corner / np.linalg.norm(corner), np.sin([k, k + 2, k + 4])
        orthographic = {"projection": "orthographic", "height": reach}
        how = orthographic if k % 2 else {"fov_y": float(np.degrees(2 * np.arctan(0.52 * reach / 5)))}
        views.append(scene.capture(Camera.look_at(eye, (0.1, 0, 0), up, size, **how)))
    return views


def iou(a: np.ndarray, b: np.ndarray) -> float:
    """Pixels in both over pixels in any."""
    return float((a & b).sum() / (a | b).sum())
