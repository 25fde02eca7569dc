"""The cameras of a glTF scene: OpenGL's axes; fields of view without a size in pixels."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from pyibr.core.camera import Camera
from pyibr.core.checks import Float64, checked_size, positive
from pyibr.core.conventions import CV_FROM_GL
from pyibr.core.errors import FileFormatError
from pyibr.core.files import read_bytes, reading
from pyibr.io.gltf import chunks_of, item_of, node_matrices

SUFFIXES = (".gltf", ".glb")


def read_gltf_cameras(path: Path, size: tuple[int, int] | None) -> dict[str, Camera]:
    """The scene's cameras by node name, or node number, for pictures of this size; pixels are square."""
    width, height = checked_size(size)
    with reading(path, "glTF") as source:
        scene, _ = chunks_of(read_bytes(source))
        if not str(scene["asset"]["version"]).startswith("2."):
            raise ValueError("expected glTF 2.0")
        found: dict[str, Camera] = {}
        for number, matrix in node_matrices(scene).items():
            node = item_of(scene, "nodes", number)
            if "camera" in node:
                camera = item_of(scene, "cameras", node["camera"])
                fx, fy, projection = _scales(camera, width, height)
                K = [[fx, 0, (width - 1) / 2], [0, fy, (height - 1) / 2], [0, 0, 1]]
                made = Camera(K, (width, height), _unscaled(matrix) @ CV_FROM_GL, projection=projection)
                found[str(node.get("name", number))] = made
    if not found:
        raise FileFormatError(f"{path}: no camera in its scene")
    return found


def _scales(camera: dict[str, Any], width: int, height: int) -> tuple[float, float, Any]:
    if camera["type"] == "perspective":
        focal = height / 2 / np.tan(positive("yfov", camera["perspective"]["yfov"]) / 2)
        return focal, focal, "perspective"
    half = [positive(name, camera["orthographic"][name]) for name in ("xmag", "ymag")]
    return width / 2 / half[0], height / 2 / half[1], "orthographic"


def _unscaled(matrix: Float64) -> Float64:
    """A node's position and orientation, without its scale."""
    pose = matrix.copy()
    pose[:3, :3] /= np.linalg.norm(pose[:3, :3], axis=0)
    return pose
