"""Depth images of meshes and scans, and models to try them on."""

from __future__ import annotations

from pyibr.capture.raycast import MeshScene, capture, cube_cameras, object_views

__all__ = ["MeshScene", "capture", "cube_cameras", "object_views"]
