"""Open3D's ray caster (Embree), which tests measure captures and pictures against."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import pyibr as ibr


def embree(*meshes: ibr.Mesh) -> Any:
    """An `open3d.t.geometry.RaycastingScene` of the meshes; the test is left out without Open3D."""
    o3d = pytest.importorskip("open3d")
    scene = o3d.t.geometry.RaycastingScene()
    for mesh in meshes:
        scene.add_triangles(np.array(mesh.vertices, np.float32), np.array(mesh.faces, np.uint32))
    return scene


def rays_of(camera: ibr.Camera) -> np.ndarray:
    """(H * W, 6) where rays begin, and a step along them by which planar depth grows by 1; it begins at 0."""
    y, x = np.mgrid[: camera.height, : camera.width]
    one = camera.unproject(np.column_stack([x.ravel(), y.ravel()]), np.ones(x.size))
    is_perspective = camera.projection == "perspective"
    origin = np.broadcast_to(camera.center, one.shape) if is_perspective else one - camera.forward
    return np.concatenate([origin, one - origin], axis=1)


def true_depth(scene: Any, camera: ibr.Camera) -> np.ndarray:
    """(H, W) planar depth of what a camera's rays meet first; inf where there is nothing."""
    hits = scene.cast_rays(rays_of(camera).astype(np.float32))
    return hits["t_hit"].numpy().reshape(camera.height, camera.width)
