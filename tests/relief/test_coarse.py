"""Reliefs on coarse bases, below which rays bend on the map, compared with rays cast at the displaced mesh."""

from __future__ import annotations

from functools import cache
from typing import Any

import cv2
import numpy as np
import pytest

import pyibr as ibr
from benchmarks.relief.outlines import carved_scene, cube
from pyibr.capture import models
from pyibr.core.camera import Camera
from tests.embree import rays_of
from tests.one_lane import one_lane
from tests.relief.solids import cylinder, grid
from tests.shadowed import AMBIENT, first_hits, shares, true_shares

WHITE = np.full((2, 2, 3), 255, np.uint8)
SIZE = 321, 239


def hills(rows: int, columns: int) -> np.ndarray:
    """Heights that tile, and are the same along all borders of the map's tiles."""
    v, u = (np.indices((rows, columns)) + 0.5) / np.reshape((rows, columns), (2, 1, 1))
    return (0.5 + 0.5 * np.cos(2 * np.pi * u) * np.cos(2 * np.pi * v)).astype(np.float32)


def few() -> np.ndarray:
    return np.array([[0.2, 0.9, 0.4]], np.float32)


BASES: dict[str, tuple[ibr.Mesh, float, float]] = {
    # the mesh, the relief's depth, and the greatest share of pixels that are wrong by over a tenth of this depth
    "12 triangles": (cube(), 0.25, 0.005),
    "48 triangles": (cube(2), 0.25, 0.005),
    "6 sides": (models.donut(6), 0.2, 0.001),
    "6 sides, shallow": (models.donut(6), 0.1, 0.001),
}
MAPS: dict[str, tuple[np.ndarray, dict[str, Any]]] = {
    "hills": (hills(12, 16), {"tiles": (2, 2)}),
    "1 x 3": (few(), {"tiles": (2, 2)}),
    "clamped": (hills(16, 16), {"wrap": "clamp"}),
}


@cache
def relief_and_truth(base: str, heights: str) -> tuple[ibr.ReliefSurface, Any]:
    pytest.importorskip("open3d")
    mesh, scale, _ = BASES[base]
    height, options = MAPS[heights]
    relief = ibr.ReliefSurface(mesh, height, WHITE, scale, **options)
    return relief, carved_scene(relief, 24 if height.size < 9 else 4)  # large texels have sharp creases


def camera_of(projection: Any = "perspective") -> Camera:
    tall: dict[str, Any] = {"height": 2.4} if projection == "orthographic" else {"fov_y": 40}
    return Camera.look_at((2.2, -2.4, 1.8), (0, 0, 0), (0, 0, 1), SIZE, projection=projection, **tall)


def wrong(base: str, heights: str, projection: str) -> float:
    """Share of the pixels inside the outline whose depth is wrong by over a tenth of the relief's depth.

    Pixels where the truth is seen from behind, as below a tear, do not count.
    """
    relief, scene = relief_and_truth(base, heights)
    camera = camera_of(projection)
    rays = rays_of(camera)
    hits = scene.cast_rays(rays.astype(np.float32))
    truth, ahead = hits["t_hit"].numpy(), (hits["primitive_normals"].numpy() * rays[:, 3:]).sum(axis=1)
    front = (np.isfinite(truth) & (ahead < 0)).reshape(camera.height, camera.width)
    frame = ibr.render(relief, camera)
    inside = cv2.erode(front.astype(np.uint8), np.ones((5, 5))) > 0
    assert inside.sum() > 3000
    assert (inside & ~frame.valid).sum() <= 2
    off = np.abs(frame.depth - truth.reshape(front.shape)) > 0.1 * relief.scale
    return float((off & inside).sum() / inside.sum())


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
@pytest.mark.parametrize("heights", MAPS)
@pytest.mark.parametrize("base", BASES)
def test_hills_are_the_displaced_meshs(base, heights, projection):
    assert wrong(base, heights, projection) <= BASES[base][2]


def test_hills_in_one_lane():
    with one_lane():
        assert wrong("12 triangles", "hills", "perspective") <= 0.005


@pytest.mark.parametrize("direction", [(-1, 0.6, -1), (-0.2, 0.3, -1)], ids=str)
@pytest.mark.parametrize("base", ["12 triangles", "48 triangles"])
def test_hills_on_a_cube_do_not_shade_themselves(base, direction):
    relief, scene = relief_and_truth(base, "hills")
    light = ibr.Light(direction=direction, ambient=AMBIENT)
    _, points, normals = first_hits(scene, camera_of())
    truth = true_shares(scene, light, points, normals)
    share, told = shares(relief, camera_of(), light)
    assert (told & truth).sum() > 1500
    assert (told & truth & (share < 0.5)).sum() <= 0.005 * told.sum()


def test_short_legs_end_where_they_end():
    """The map's tile is ten thousand times as large as the tube, so legs hardly move on the map.

    Everywhere the height is 0.55, below the greatest height of the map. A ray meets the relief in a later leg.
    """
    tube, height = grid(cylinder, 24, 24), np.array([[0.2, 1], [1, 0]], np.float32)
    camera = Camera.look_at((2.2, -2.4, 1.2), (0, 0, 0), (0, 0, 1), SIZE, fov_y=50)
    large = ibr.Mesh(tube.vertices, tube.faces, uv=1e-4 * np.asarray(tube.uv), normals=tube.normals)
    even = ibr.render(ibr.ReliefSurface(tube, np.full((2, 2), 0.55, np.float32), WHITE, 0.3), camera)
    still = ibr.render(ibr.ReliefSurface(large, height, WHITE, 0.3), camera)
    np.testing.assert_array_equal(still.valid, even.valid)
    assert np.abs(still.depth - even.depth)[even.valid].max() <= 1e-3  # heights differ by up to 2e-4, depths by more
