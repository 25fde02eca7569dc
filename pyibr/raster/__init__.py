"""Rasteriser of triangles and prisms, and the meshes that it draws."""

from __future__ import annotations

from pyibr.raster.mesh import DrawnMesh, draw_mesh

__all__ = ["DrawnMesh", "draw_mesh"]
