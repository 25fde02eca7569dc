"""The rasteriser: triangles and prisms to pixels; and meshes, which it draws."""

from __future__ import annotations

from pyibr.raster.mesh import DrawnMesh, draw_mesh

__all__ = ["DrawnMesh", "draw_mesh"]
