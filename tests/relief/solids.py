"""Curved solids: coarse meshes of them, and fine meshes with a relief carved into them, for ray casting."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

import pyibr as ibr
from pyibr.core.camera import Camera
from tests.embree import embree, true_depth
from tests.reference.heights import bilinear_height

Surface = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]  # u, v -> points and unit normals


def torus(u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A ring of radius 1 about the z axis, with a tube of radius 0.4."""
    a, b = 2 * np.pi * u, 2 * np.pi * v
    normals = np.stack([np.cos(b) * np.cos(a), np.cos(b) * np.sin(a), np.sin(b)], axis=-1)
    return np.stack([np.cos(a), np.sin(a), 0 * a], axis=-1) + 0.4 * normals, normals


def cylinder(u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A cylinder of radius 1 about the z axis, from z = -1.2 to 1.2, open at both ends."""
    a = 2 * np.pi * u
    normals = np.stack([np.cos(a), np.sin(a), 0 * a], axis=-1)
    return normals + (2.4 * v - 1.2)[..., None] * np.array([0, 0, 1.0]), normals


def sphere(u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A sphere of radius 1 without the poles, at which uv would be degenerate."""
    a, b = 2 * np.pi * u, np.pi * (0.8 * v - 0.4)
    normals = np.stack([np.cos(b) * np.cos(a), np.cos(b) * np.sin(a), np.sin(b)], axis=-1)
    return normals, normals


def plane(u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The plane z = 0, of 3 x 3 unit squares; the middle square has x and y from 0 to 1."""
    points = np.stack([3 * u - 1, 3 * v - 1, 0 * u], axis=-1)
    return points, np.broadcast_to((0.0, 0, 1), points.shape)


def grid(surface: Surface, columns: int, rows: int) -> ibr.Mesh:
    """A mesh of columns x rows quadrilaterals, with u and v from 0 to 1, whose fronts face outwards."""
    u, v = np.meshgrid(np.arange(columns + 1) / columns, np.arange(rows + 1) / rows)
    points, normals = surface(u.ravel(), v.ravel())
    y, x = np.mgrid[:rows, :columns]
    i = (y * (columns + 1) + x).ravel()
    n = columns + 1
    faces = np.concatenate([np.stack([i, i + 1, i + n + 1], 1), np.stack([i, i + n + 1, i + n], 1)])
    return ibr.Mesh(points, faces, uv=np.stack([u.ravel(), v.ravel()], 1), normals=normals)


@dataclass
class Carved:
    """True depth: the smooth surface with the relief carved into it, with `fine` cells per texel along each axis."""

    surface: Surface
    height: np.ndarray
    scale: float
    tiles: tuple[int, int]
    fine: int = 2

    def __post_init__(self) -> None:
        rows, columns = (n * t * self.fine for n, t in zip(self.height.shape, self.tiles[::-1], strict=True))
        u, v = np.meshgrid(np.arange(columns + 1) / columns, np.arange(rows + 1) / rows)
        points, normals = self.surface(u.ravel(), v.ravel())
        h = bilinear_height(self.height.astype(np.float64), u.ravel() * self.tiles[0], v.ravel() * self.tiles[1])
        vertices = points - self.scale * (1 - h)[:, None] * normals
        faces = grid(self.surface, columns, rows).faces
        self.scene = embree(ibr.Mesh(vertices, faces))

    def depth(self, camera: Camera) -> np.ndarray:
        """True planar depth; inf where the camera sees nothing."""
        return true_depth(self.scene, camera)
