"""Open3D's ray caster (Embree), which tests measure captures and pictures against."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import pyibr as ibr


def embree(mesh: ibr.Mesh) -> Any:
    """An `open3d.t.geometry.RaycastingScene` of the mesh; the test is left out without Open3D."""
    o3d = pytest.importorskip("open3d")
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(np.array(mesh.vertices), np.array(mesh.faces, np.uint32))
    return scene
