"""Open3D's ray caster (Embree), the reference for captures and pictures; rays of pixels, and points that they show."""

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


def pixels_of(camera: ibr.Camera) -> np.ndarray:
    """(H * W, 2) x and y of a camera's pixels, row by row."""
    return np.stack(np.meshgrid(*map(np.arange, camera.size)), -1).reshape(-1, 2).astype(float)


def points_of(seen: ibr.Frame | ibr.DepthImage, pixels: np.ndarray | None = None) -> np.ndarray:
    """(n, 3) points of the world that a frame's or an image's pixels show: valid ones, or the mask (H, W) `pixels`."""
    y, x = np.nonzero(seen.valid if pixels is None else pixels)
    return seen.camera.unproject(np.column_stack([x, y]).astype(float), seen.depth[y, x].astype(float))


def rays_of(camera: ibr.Camera) -> np.ndarray:
    """Rays (H * W, 6): origins, at planar depth 0, and steps along them by which planar depth grows by 1."""
    one = camera.unproject(pixels_of(camera), np.ones(camera.width * camera.height))
    is_perspective = camera.projection == "perspective"
    origin = np.broadcast_to(camera.center, one.shape) if is_perspective else one - camera.forward
    return np.concatenate([origin, one - origin], axis=1)


def true_depth(scene: Any, camera: ibr.Camera) -> np.ndarray:
    """Planar depth (H, W) of the first hits of a camera's rays; inf where there is none."""
    hits = scene.cast_rays(rays_of(camera).astype(np.float32))
    return hits["t_hit"].numpy().reshape(camera.height, camera.width)
