"""Depth images as adaptive triangle meshes, several blended per pixel (Pajarola, Sainz & Meng 2003)."""

from __future__ import annotations

from pyibr.depthmesh.mesh import DepthMesh
from pyibr.depthmesh.object import DepthMeshObject
from pyibr.depthmesh.segmentation import Segmentation

__all__ = ["DepthMesh", "DepthMeshObject", "Segmentation"]
