"""No cracks appear where rays leave a quadric while they are still below the mesh; cast rays give the truth."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

import pyibr as ibr
from pyibr.core.camera import Camera
from tests.data import shared
from tests.embree import embree, true_depth
from tests.relief.solids import Carved, grid

WHITE, EVEN = np.full((2, 2, 3), 200, np.uint8), np.full((4, 4), 0.5, np.float32)


def beads(u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A rod along z of bulges with necks between them; its ends lie outside of the picture."""
    a, z = 2 * np.pi * u, 5 * v - 2.5
    radius, slope = 0.6 + 0.2 * np.cos(5 * z), -np.sin(5 * z)
    normals = np.stack([np.cos(a), np.sin(a), -slope + 0 * a], axis=-1) / np.sqrt(1 + slope**2)[..., None]
    return np.stack([radius * np.cos(a), radius * np.sin(a), z + 0 * a], axis=-1), normals


def check_outline_and_inside(frame: ibr.Frame, truth: np.ndarray) -> None:
    """Assert that pixels two pixels inside the true outline are drawn, and that none two pixels outside are."""
    solid = np.isfinite(truth).astype(np.uint8)
    inside = cv2.erode(solid, np.ones((5, 5)), borderValue=0) > 0
    around = cv2.dilate(solid, np.ones((5, 5))) > 0
    assert inside.sum() > 3000
    assert (inside & ~frame.valid).sum() == 0
    assert (frame.valid & ~around).sum() == 0


@pytest.mark.parametrize("distance", ["approximate", "exact"])
@pytest.mark.parametrize("height", [0.2, 1.6])
def test_bulges_with_necks_between_them(height, distance):
    camera = Camera.look_at((0.6, -3.6, height), (0, 0, 0), (0, 0, 1), (161, 157), fov_y=28)
    truth = Carved(beads, np.full((32, 32), 0.5), 0.05, (8, 8)).depth(camera)
    relief = ibr.ReliefSurface(grid(beads, 64, 96), EVEN, WHITE, 0.05, tiles=(8, 8), distance=distance)
    check_outline_and_inside(ibr.render(relief, camera), truth)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("turn", "distance"),
    [(0, "approximate"), (45, "exact"), (135, "approximate"), (135, "exact"), (180, "exact"), (270, "approximate")],
)
def test_a_head_on_a_neck(turn, distance):
    """Spot, a cow of 5,856 triangles, with a relief 0.004 of its size deep and all heights 0.5."""
    mesh = ibr.Mesh.load(next(shared("meshes/spot").glob("*.obj*")))
    low, high = (np.asarray(corner, float) for corner in mesh.bounds)
    size, middle, angle = float(np.linalg.norm(high - low)), (low + high) / 2, np.radians(turn)
    scale, away = 0.004 * size, np.array([np.sin(angle), 0.35, np.cos(angle)])
    camera = Camera.look_at(middle + 1.15 * size * away, middle, (0, 1, 0), (317, 323), fov_y=42)
    relief = ibr.ReliefSurface(mesh, EVEN, WHITE, scale, tiles=(24, 24), distance=distance)
    carved = mesh.vertices - 0.5 * scale * relief.frames.normals[: len(mesh.vertices)]
    truth = true_depth(embree(ibr.Mesh(carved, mesh.faces)), camera)
    check_outline_and_inside(ibr.render(relief, camera), truth)
