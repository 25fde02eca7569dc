"""A unit square with displaced heights, as a closed solid for ray casting: fine triangles on top, walls and base."""

from __future__ import annotations

import cv2
import numpy as np

import pyibr as ibr
from pyibr.core.camera import Camera
from tests.embree import embree, true_depth
from tests.reference.heights import bilinear_height


def square() -> ibr.Mesh:
    """The base: z = 0, uv = (x, y)."""
    corners = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    return ibr.Mesh(corners, [[0, 1, 2], [0, 2, 3]], uv=[[0, 0], [1, 0], [1, 1], [0, 1]])


def looking(
    elevation: float, direction: float, scale: float, size: tuple[int, int], projection: str = "perspective"
) -> Camera:
    """A camera that sees the whole solid; angles in degrees."""
    e, d = np.radians(elevation), np.radians(direction)
    away = np.array([np.cos(e) * np.cos(d), np.cos(e) * np.sin(d), np.sin(e)])
    middle = np.array([0.5, 0.5, 0.5 * scale])
    up = (0, 0, 1) if elevation < 90 else (np.cos(d), np.sin(d), 0)
    how = {"fov_y": 36.0} if projection == "perspective" else {"projection": projection, "height": 1.5}
    return Camera.look_at(middle + 2.2 * away, middle, up, size, **how)


class Solid:
    """The space between z = 0 and z = scale * height; its mesh has `fine` x `fine` cells for each texel."""

    def __init__(self, height: np.ndarray, scale: float, fine: int) -> None:
        n = fine * len(height)
        ticks = np.arange(n + 1) / n
        u, v = np.meshgrid(ticks, ticks)
        rise = scale * bilinear_height(height.astype(np.float64), u, v)
        top = np.column_stack([u.ravel(), v.ravel(), rise.ravel()])
        base = top * (1, 1, 0)
        y, x = np.mgrid[:n, :n]
        a = (y * (n + 1) + x).ravel()
        b, c, d = a + 1, a + n + 1, a + n + 2
        faces = np.concatenate([np.column_stack([a, b, d]), np.column_stack([a, d, c])])
        rim = np.concatenate([np.arange(n), np.arange(n) * (n + 1)])  # two sides; the opposite ones are `across` on
        step = np.concatenate([np.ones(n, int), np.full(n, n + 1)])
        across = np.concatenate([np.full(n, n * (n + 1)), np.full(n, n)])
        count = len(top)
        walls = []
        for start in (rim, rim + across):
            end = start + step
            walls += [np.column_stack([start, end, end + count]), np.column_stack([start, end + count, start + count])]
        self.scene = embree(ibr.Mesh(np.concatenate([top, base]), np.concatenate([faces, faces + count, *walls])))

    def depth(self, camera: Camera) -> np.ndarray:
        """True planar depth for a camera; inf where it sees no surface."""
        return true_depth(self.scene, camera)


def finely_displaced(base: ibr.Mesh, height: np.ndarray, scale: float, tiles: tuple[int, int], cells: int) -> ibr.Mesh:
    """Split each triangle's sides into `cells` parts, and displace the smaller triangles along interpolated normals."""
    y, x = np.mgrid[: cells + 1, : cells + 1]
    kept = x + y <= cells
    number = np.full(x.shape, -1)
    number[kept] = np.arange(kept.sum())
    shares = np.column_stack([1 - (x + y)[kept] / cells, x[kept] / cells, y[kept] / cells])
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]
    small = np.concatenate([np.stack([a, b, c], -1)[b + c >= 0], np.stack([b, d, c], -1)[d >= 0]])
    small = small[(small >= 0).all(axis=1)]
    corners = (np.asarray(values, np.float64)[base.faces] for values in (base.vertices, base.normals, base.uv))
    points, normals, uv = (np.einsum("kc,tcd->tkd", shares, of_corners) for of_corners in corners)
    rise = scale * bilinear_height(height.astype(np.float64), uv[..., 0] * tiles[0], uv[..., 1] * tiles[1])
    faces = small + np.arange(len(points))[:, None, None] * len(shares)
    return ibr.Mesh((points + rise[..., None] * normals).reshape(-1, 3), faces.reshape(-1, 3))


def interior(truth: np.ndarray, jump: float = 0.03) -> np.ndarray:
    """(H, W) bool: pixels with depth, more than 3 pixels from silhouettes, and from depth steps larger than `jump`."""
    solid = np.isfinite(truth)
    z = np.where(solid, truth, truth[solid].max(initial=0) + 10 * jump).astype(np.float32)
    around = np.ones((3, 3))
    edges = (cv2.dilate(z, around) - cv2.erode(z, around) > jump).astype(np.uint8)
    return solid & ~cv2.dilate(edges, np.ones((7, 7))).astype(bool)
