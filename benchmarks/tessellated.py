"""The displaced donut as a triangle mesh that pyibr draws: an alternative to reliefs and slices."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import pyibr as ibr
from pyibr.capture import models

CUTS = (8, 24)
"""Numbers of pieces into which each side of the donut's triangles is cut."""


def subject(cut: int) -> str:
    """Name of the mesh in results."""
    return f"ibr.Mesh, cut {cut} x {cut}"


def tessellated(
    sides: int,
    height: NDArray[np.uint8] | NDArray[np.float32],
    color: NDArray[np.uint8],
    rise: tuple[float, float],
    tiles: tuple[int, int],
    cut: int,
) -> ibr.Mesh:
    """Displace `models.donut(sides)`, with each triangle cut into cut x cut triangles that follow the surface.

    A height of 0 lies rise[0] scene units above the donut's surface, a height of 1 (255 in bytes) rise[1] above it.
    """
    fine = models.donut(sides * cut)
    assert fine.normals is not None and fine.uv is not None
    uv = fine.uv * np.asarray(tiles, np.float64)
    heights = height / 255 if height.dtype == np.uint8 else height
    above = rise[0] + (rise[1] - rise[0]) * _bilinear(np.asarray(heights, np.float64), uv)
    return ibr.Mesh(fine.vertices + above[:, None] * fine.normals, fine.faces, uv=uv, texture=color)


def size_of(mesh: ibr.Mesh) -> int:
    """Bytes of the vertices, triangles and uv, without the texture."""
    assert mesh.uv is not None
    return mesh.vertices.nbytes + mesh.faces.nbytes + mesh.uv.nbytes


def _bilinear(height: NDArray[np.float64], uv: NDArray[np.float64]) -> NDArray[np.float64]:
    """Interpolate heights between the texel centres of a repeating map."""
    rows, columns = height.shape
    u, v = uv[:, 0] * columns - 0.5, uv[:, 1] * rows - 0.5
    x, y = np.floor(u).astype(int), np.floor(v).astype(int)
    fx, fy = u - x, v - y
    x0, x1, y0, y1 = x % columns, (x + 1) % columns, y % rows, (y + 1) % rows
    upper, lower = (height[row, x0] * (1 - fx) + height[row, x1] * fx for row in (y0, y1))
    return upper * (1 - fy) + lower * fy
