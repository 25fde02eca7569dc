from __future__ import annotations

import numpy as np
import pytest

from benchmarks.models import DRAGON_HEAD, dragon_head, dragon_scene, globe, load_earth, torus
from pyibr.capture import capture, models
from pyibr.capture.coverage import surface_of, unseen_share
from pyibr.capture.frusta import load_frusta
from pyibr.core.camera import Camera
from pyibr.meshes.mesh import Mesh
from pyibr.warp.warp import warp
from tests import truth
from tests.capture.torus import torus as coarse_torus
from tests.data import shared

pytest.importorskip("open3d")


def test_the_globe_is_a_sphere_displaced_outwards():
    for height, radius in ((0, 1), (1, 1.25)):
        for view in globe(33, elevation=np.full((4, 8), height, np.float32), relief=0.25):
            np.testing.assert_allclose(np.linalg.norm(view.points, axis=1), radius, rtol=1e-6)
    hills = np.concatenate([np.linalg.norm(view.points, axis=1) for view in globe(33)])
    assert hills.min() >= 1 - 1e-6
    assert 1.03 < hills.max() <= 1.08 + 1e-6


def test_the_globe_has_north_up_and_east_to_the_right():
    # In the equirectangular image, red grows with longitude, from -180 to 180 degrees, and green from north to south.
    width, height = 720, 360
    red, green = np.meshgrid(np.linspace(0, 255, width), np.linspace(0, 255, height))
    color = np.stack([red, green, 0 * red], -1).astype(np.uint8)
    images = globe(65, elevation=np.zeros((2, 4), np.float32), color=color)
    camera = models.view(images, (41, 41), direction=(0, 0, -1))  # above latitude 0, longitude 0
    seen = truth.raycast(images, camera, side="back")
    np.testing.assert_allclose(seen.color[20, 20], (127.5, 127.5, 0), atol=3)
    assert seen.color[20, 30, 0] > seen.color[20, 20, 0] + 10 > seen.color[20, 10, 0] + 20
    assert seen.color[30, 20, 1] > seen.color[20, 20, 1] + 20 > seen.color[10, 20, 1] + 40


@pytest.mark.parametrize("direction", [(0.45, -0.4, -1), (1, 1, 1), (-0.2, 1, 0.5)])
def test_the_globe_has_no_gap(direction):
    images = globe(33)
    camera = models.view(images, (80, 60), direction=direction)
    seen = truth.raycast(images, camera, side="back")
    x, y = np.meshgrid(np.arange(80), np.arange(60))
    ray = camera.unproject(np.stack([x, y], -1).reshape(-1, 2), np.ones(4800)) - camera.center
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    nearest = np.linalg.norm(camera.center - (ray @ camera.center)[:, None] * ray, axis=1).reshape(60, 80)
    assert (nearest < 0.99).sum() > 1000
    assert seen.valid[nearest < 0.99].all()
    assert not seen.valid[nearest > 1.08].any()


def test_six_frusta_around_it_see_the_torus_and_its_inner_wall(monkeypatch: pytest.MonkeyPatch):
    """From directions that see the inner wall through the hole, warped views agree with cast rays."""
    monkeypatch.setattr(models, "torus_mesh", coarse_torus)
    views = torus(160)
    assert len(views) == 6
    for direction in ((0.45, -0.4, -1), (1, 1, 1), (-1, -1.2, -0.3)):
        camera = models.view(views, (131, 117), direction=direction)
        expected = capture(coarse_torus(), camera)
        frame = warp(views, camera)
        # 0.97: the images show outlines to a sample.
        assert frame.valid[expected.valid].mean() > 0.97
        both = frame.valid & expected.valid
        assert (np.abs(frame.depth / expected.depth - 1)[both] < 0.01).mean() > 0.99


@pytest.mark.thorough
def test_sixteen_frusta_cover_the_dragons_head():
    """The frusta leave at most 2 % unseen, and pictures warped from their views agree with cast rays."""
    frusta, about = load_frusta(DRAGON_HEAD)
    assert len(frusta) == 16
    assert DRAGON_HEAD.stat().st_size < 8000
    box = np.array(about["within"])
    path = shared("meshes/dragon_vrip_res3.ply.gz")
    mesh = Mesh.load(path)
    surface = surface_of(mesh, count=8000, within=box)
    seen = [surface.seen(one.resized(256).capture(mesh)) for one in frusta]
    assert unseen_share(surface, seen) < 0.02
    views = dragon_head(path, 256)
    box = np.sort(box * (1, -1, -1), axis=0)  # the views have y and z turned
    for direction in ((-0.3, -0.2, -1), (-1, -0.1, -0.3), (0.5, -0.6, 1), (-0.2, 0.6, -1)):
        camera = Camera.look_at(
            box.mean(axis=0) + 0.15 * np.array(direction), box.mean(axis=0), (0, -1, 0), (181, 163), fov_y=45
        )
        expected = dragon_scene(path).capture(camera)
        frame = warp(views, camera)
        inside = ((expected.points > box[0]) & (expected.points < box[1])).all(axis=1)
        y, x = (one[inside] for one in np.nonzero(expected.valid))
        assert frame.valid[y, x].mean() > 0.97
        y, x = (one[frame.valid[y, x]] for one in (y, x))
        apart = np.abs(frame.depth[y, x] / expected.depth[y, x] - 1)
        assert (apart < 2e-3).mean() > 0.93  # the images show silhouettes to a sample
    assert models.view(views, (32, 32)).center[2] < 0


@pytest.mark.thorough
def test_the_real_earth():
    elevation, color = load_earth(shared("heightfields/earth"))
    assert elevation.dtype == np.float32
    assert (elevation.min(), elevation.max() <= 1) == (0, True)
    images = globe(64, elevation=elevation, color=color)
    camera = models.view(images, (61, 61), direction=(np.sin(np.radians(10)), -np.sin(np.radians(20)), -1))
    r, g, b = truth.raycast(images, camera, side="back").color[30, 30]
    assert r > g > b  # the Sahara, not the sea
