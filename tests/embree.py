"""Open3D's ray caster (Embree), the reference for captures and pictures."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import pyibr as ibr


def embree(*meshes: ibr.Mesh) -> Any:
    """An `open3d.t.geometry.RaycastingScene` of the meshes; the test is skipped without Open3D."""
    o3d = pytest.importorskip("open3d")
    scene = o3d.t.geometry.RaycastingScene()
    for mesh in meshes:
        scene.add_triangles(np.array(mesh.vertices, np.float32), np.array(mesh.faces, np.uint32))
    return scene


def rays_of(camera: ibr.Camera) -> np.ndarray:
    """Rays (H * W, 6): origins, at planar depth 0, and steps along them by which planar depth grows by 1."""
    y, x = np.mgrid[: camera.height, : camera.width]
    one = camera.unproject(np.column_stack([x.ravel(), y.ravel()]), np.ones(x.size))
    is_perspective = camera.projection == "perspective"
    origin = np.broadcast_to(camera.center, one.shape) if is_perspective else one - camera.forward
    return np.concatenate([origin, one - origin], axis=1)


def true_depth(scene: Any, camera: ibr.Camera) -> np.ndarray:
    """Planar depth (H, W) of the first hits of a camera's rays; inf where there is none."""
    hits = scene.cast_rays(rays_of(camera).astype(np.float32))
    return hits["t_hit"].numpy().reshape(camera.height, camera.width)
