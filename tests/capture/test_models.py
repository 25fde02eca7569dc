from __future__ import annotations

import gzip

import numpy as np
import pytest

from pyibr.capture import capture, models
from pyibr.capture.coverage import surface_of, unseen_share
from pyibr.capture.frusta import load_frusta
from pyibr.core.camera import Camera
from pyibr.core.errors import ArgumentError, FileFormatError
from pyibr.meshes.mesh import Mesh
from pyibr.warp.warp import warp
from tests import truth
from tests.capture.torus import torus
from tests.data import shared

o3d = pytest.importorskip("open3d")


def world(view):
    y, x = np.nonzero(view.valid)
    return view.camera.unproject(np.stack([x, y], -1), view.depth[view.valid])


def test_the_globe_is_a_sphere_displaced_outwards():
    size = 33
    plain = models.globe(size, elevation=np.zeros((4, 8), np.float32))
    for view in plain:
        np.testing.assert_allclose(np.linalg.norm(world(view), axis=1), 1, rtol=1e-6)
    raised = models.globe(size, elevation=np.ones((4, 8), np.float32), relief=0.25)
    for view in raised:
        np.testing.assert_allclose(np.linalg.norm(world(view), axis=1), 1.25, rtol=1e-6)
    hills = np.concatenate([np.linalg.norm(world(view), axis=1) for view in models.globe(size)])
    assert hills.min() >= 1 - 1e-6
    assert 1.03 < hills.max() <= 1.08 + 1e-6


def test_the_globe_has_north_up_and_east_to_the_right():
    # Equirectangular: red grows with longitude from -180 to 180 degrees, green from north to south.
    width, height = 720, 360
    red, green = np.meshgrid(np.linspace(0, 255, width), np.linspace(0, 255, height))
    color = np.stack([red, green, 0 * red], -1).astype(np.uint8)
    images = models.globe(65, elevation=np.zeros((2, 4), np.float32), color=color)
    camera = models.view(images, (41, 41), direction=(0, 0, -1))  # above 0 N 0 E
    seen = truth.raycast(images, camera, side="back")
    np.testing.assert_allclose(seen.color[20, 20], (127.5, 127.5, 0), atol=3)
    assert seen.color[20, 30, 0] > seen.color[20, 20, 0] + 10 > seen.color[20, 10, 0] + 20
    assert seen.color[30, 20, 1] > seen.color[20, 20, 1] + 20 > seen.color[10, 20, 1] + 40


@pytest.mark.parametrize("direction", [(0.45, -0.4, -1), (1, 1, 1), (-0.2, 1, 0.5)])
def test_the_globe_has_no_gap(direction):
    images = models.globe(33)
    camera = models.view(images, (80, 60), direction=direction)
    seen = truth.raycast(images, camera, side="back")
    x, y = np.meshgrid(np.arange(80), np.arange(60))
    ray = camera.unproject(np.stack([x, y], -1).reshape(-1, 2), np.ones(4800)) - camera.center
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    nearest = np.linalg.norm(camera.center - (ray @ camera.center)[:, None] * ray, axis=1).reshape(60, 80)
    assert (nearest < 0.99).sum() > 1000
    assert seen.valid[nearest < 0.99].all()
    assert not seen.valid[nearest > 1.08].any()


@pytest.mark.thorough
@pytest.mark.parametrize("direction", [(0.45, -0.4, -1), (1, 1, 1), (-1, -1.2, -0.3)])
def test_the_whole_torus_is_seen(direction):
    images = models.torus(48)
    assert len(images) == 12
    camera = models.view(images, (90, 70), direction=direction)
    seen = truth.raycast(images, camera, side="both")
    expected = capture(models.torus_mesh(), camera)
    inside = ~truth.dilate(~expected.valid, 2)
    outside = ~truth.dilate(expected.valid, 2)
    assert inside.sum() > 800
    assert seen.valid[inside].mean() > 0.999
    assert not seen.valid[outside].any()
    # Not exact: the images have 48 samples a side, and the rim is a pixel off.
    assert np.median(np.abs(seen.depth - expected.depth)[inside & seen.valid]) < 0.01


@pytest.fixture
def coarse(monkeypatch: pytest.MonkeyPatch) -> None:
    """Replace the torus by one with fewer triangles."""
    mesh = torus()
    monkeypatch.setattr(models, "torus_mesh", lambda: mesh)


@pytest.mark.usefixtures("coarse")
def test_six_frusta_around_it_see_the_torus_and_its_inner_wall():
    """Compared with rays, from directions that see the wall through the hole."""
    views = models.torus_from_outside(160)
    assert len(views) == 6
    for direction in ((0.45, -0.4, -1), (1, 1, 1), (-1, -1.2, -0.3)):
        camera = models.view(views, (131, 117), direction=direction)
        expected = capture(models.torus_mesh(), camera)
        frame = warp(views, camera)
        # Except at outlines, which the images locate to a sample
        assert frame.valid[expected.valid].mean() > 0.97
        both = frame.valid & expected.valid
        assert (np.abs(frame.depth / expected.depth - 1)[both] < 0.01).mean() > 0.99


@pytest.mark.usefixtures("coarse")
def test_the_torus_layers_can_be_had_alone():
    both, last = models.torus(16), models.torus(16, layers=("last",))
    assert len(last) == 6
    for one, other in zip(both[6:], last, strict=True):
        np.testing.assert_array_equal(one.depth, other.depth)
    for first, second in zip(both[:6], both[6:], strict=True):
        np.testing.assert_array_equal(first.valid, second.valid)
        assert (first.depth[first.valid] <= second.depth[first.valid] + 1e-6).all()


def test_a_mesh_file_from_all_around(tmp_path):
    mesh = o3d.geometry.TriangleMesh.create_cone(1.0, 2.0, 40, 4)  # along z, apex at z = 2
    mesh.rotate(mesh.get_rotation_matrix_from_xyz((-np.pi / 2, 0, 0)), center=(0, 0, 0))  # apex at y = 2
    o3d.io.write_triangle_mesh(str(tmp_path / "cone.ply"), mesh)
    (tmp_path / "cone.ply.gz").write_bytes(gzip.compress((tmp_path / "cone.ply").read_bytes()))
    images = models.dragon(tmp_path / "cone.ply.gz", 32)
    assert len(images) == 16
    every = np.concatenate([world(view) for view in images])
    assert every[:, 1].min() < -1.7  # the apex: +y in the file is up, -y here
    assert np.abs(every[:, 0]).max() <= 1 + 1e-5
    for view in images:
        border = np.ones((32, 32), bool)
        border[1:-1, 1:-1] = False
        assert not view.valid[border].any()
        assert view.valid.mean() > 0.05
    plain = models.dragon(tmp_path / "cone.ply", 32, views=3)
    assert len(plain) == 3


def test_errors_name_what_is_wrong(tmp_path):
    with pytest.raises(ArgumentError, match="elevation"):
        models.globe(8, elevation=np.zeros(3, np.float32))
    with pytest.raises(ArgumentError, match="color"):
        models.globe(8, color=np.zeros((3, 3), np.uint8))
    with pytest.raises(ArgumentError, match="size"):
        models.torus(4)
    with pytest.raises(ArgumentError, match="layers"):
        models.torus(16, layers=("middle",))
    with pytest.raises(FileFormatError, match="no such file"):
        models.dragon(tmp_path / "none.ply", 16)
    (tmp_path / "broken.ply.gz").write_bytes(b"not gzip")
    with pytest.raises(FileFormatError, match="not a readable PLY"):
        models.dragon(tmp_path / "broken.ply.gz", 16)
    (tmp_path / "empty.ply").write_text("ply\nformat ascii 1.0\nend_header\n")
    with pytest.raises(FileFormatError, match="not a readable PLY"):
        models.dragon(tmp_path / "empty.ply", 16)


@pytest.mark.thorough
def test_sixteen_frusta_cover_the_dragons_head():
    """The frusta see the rays' hit points, and views warped from them agree with the rays."""
    frusta, about = load_frusta(models.DRAGON_HEAD)
    assert len(frusta) == 16
    assert models.DRAGON_HEAD.stat().st_size < 8000
    box = np.array(about["within"])
    path = shared("meshes/dragon_vrip_res3.ply.gz")
    mesh = Mesh.load(path)
    surface = surface_of(mesh, count=8000, within=box)
    seen = [surface.seen(one.resized(256).capture(mesh)) for one in frusta]
    assert unseen_share(surface, seen) < 0.02
    views = models.dragon_head(path, 256)
    box = np.sort(box * (1, -1, -1), axis=0)  # turned like the views
    for direction in ((-0.3, -0.2, -1), (-1, -0.1, -0.3), (0.5, -0.6, 1), (-0.2, 0.6, -1)):
        camera = Camera.look_at(
            box.mean(axis=0) + 0.15 * np.array(direction), box.mean(axis=0), (0, -1, 0), (181, 163), fov_y=45
        )
        expected = models.load_scene(path).capture(camera)
        frame = warp(views, camera)
        y, x = np.nonzero(expected.valid)
        points = camera.unproject(np.column_stack([x, y]), expected.depth[y, x])
        y, x = (one[((points > box[0]) & (points < box[1])).all(axis=1)] for one in (y, x))
        assert frame.valid[y, x].mean() > 0.97
        y, x = (one[frame.valid[y, x]] for one in (y, x))
        apart = np.abs(frame.depth[y, x] / expected.depth[y, x] - 1)
        assert (apart < 2e-3).mean() > 0.93  # except at silhouettes, which the images locate to a sample
    assert models.view(views, (32, 32)).center[2] < 0


@pytest.mark.thorough
def test_the_real_earth_and_dragon():
    elevation, color = models.load_earth(shared("heightfields/earth"))
    assert elevation.dtype == np.float32
    assert (elevation.min(), elevation.max() <= 1) == (0, True)
    images = models.globe(64, elevation=elevation, color=color)
    camera = models.view(images, (61, 61), direction=(np.sin(np.radians(10)), -np.sin(np.radians(20)), -1))
    r, g, b = truth.raycast(images, camera, side="back").color[30, 30]
    assert r > g > b  # the Sahara, not the sea
    dragon = models.dragon(shared("meshes/dragon_vrip_res3.ply.gz"), 64)
    assert all(0.08 < view.valid.mean() < 0.5 for view in dragon)


def test_the_donut_is_closed_and_its_normals_point_outwards():
    mesh = models.donut(25, radius=2.0, tube=0.5)
    assert len(mesh.faces) == 1250
    ring = np.hypot(mesh.vertices[:, 0], mesh.vertices[:, 1])
    np.testing.assert_allclose(np.hypot(ring - 2, mesh.vertices[:, 2]), 0.5, rtol=1e-5)
    corner = mesh.vertices[mesh.faces].astype(float)
    across = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    assert (np.einsum("nc,nc->n", across, mesh.normals[mesh.faces[:, 0]]) > 0).all()
    # Volume by the divergence theorem. The polygons enclose a little less than the torus, 2 pi^2 R r^2.
    volume = np.einsum("nc,nc->", across, corner[:, 0]) / 6
    assert 0.96 <= volume / (2 * np.pi**2 * 2 * 0.25) <= 1
    with pytest.raises(ArgumentError, match="sides"):
        models.donut(2)
