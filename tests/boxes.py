"""Boxes as bare corners and triangles, as meshes with uv, and with separate corners for each triangle."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

import pyibr as ibr

_QUADS = np.array([(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)])


def cuboid(low: ArrayLike, high: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Corners (8, 3), shared by the sides, and triangles (12, 3), whose fronts face outwards."""
    corners = np.asarray(low) + np.indices((2, 2, 2)).reshape(3, 8).T * np.subtract(high, low)
    return corners, np.concatenate([_QUADS[:, [0, 1, 2]], _QUADS[:, [0, 2, 3]]])


def box(size: tuple[float, float, float] = (2, 1.6, 1.2), inside: bool = False) -> ibr.Mesh:
    """Box about the origin with its fronts outwards or, if `inside`, inwards like a room's.

    u grows by 1 on each of the four sides; each of the two ends has uv from (0, 0) to (1, 1).
    """
    corner = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    ring, round_ = corner[[0, 1, 2, 3, 0]], np.arange(5)
    points, uv, faces = [], [], []
    for z in (-1, 1):
        points.append(np.column_stack([ring, np.full(5, z)]))
        uv.append(np.column_stack([round_, np.full(5, (1 - z) / 2)]))
    faces += [face for i in range(4) for face in ([i, i + 1, i + 6], [i, i + 6, i + 5])]
    for z in (-1, 1):
        points.append(np.column_stack([corner, np.full(4, z)]))
        uv.append((corner + 1) / 2)
    faces += [[10, 12, 11], [10, 13, 12], [14, 15, 16], [14, 16, 17]]
    turned = np.array(faces)[:, ::-1] if inside else np.array(faces)
    return ibr.Mesh(np.concatenate(points) * np.array(size) / 2, turned, uv=np.concatenate(uv))


def facets(mesh: ibr.Mesh, with_normals: bool = False) -> ibr.Mesh:
    """Return the mesh with three separate corners for each triangle; optionally with the triangles' normals."""
    corners = mesh.faces.ravel()
    vertices = mesh.vertices[corners]
    across = np.cross(vertices[1::3] - vertices[::3], vertices[2::3] - vertices[::3]).repeat(3, axis=0)
    faces = np.arange(len(corners)).reshape(-1, 3)
    return ibr.Mesh(vertices, faces, uv=mesh.uv[corners], normals=across if with_normals else None)
