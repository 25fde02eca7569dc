"""The rasteriser against Embree's rays, and its laws: no crack, no pixel twice, nothing clipped wrongly."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

import pyibr as ibr
from pyibr.camera import Camera
from pyibr.raster import draw_mesh
from pyibr.target import Target
from tests.data import shared

o3d = pytest.importorskip("open3d")

MESHES = ["meshes/dragon_vrip_res3.ply.gz", "meshes/teapot.obj.gz", "meshes/human_male_makehuman.obj.gz"]


def numbered(mesh: ibr.Mesh) -> ibr.Mesh:
    """The same triangles without shared vertices, each in a colour that is its number."""
    number = np.arange(len(mesh.faces))
    color = np.stack([number & 255, number >> 8 & 255, number >> 16], axis=-1).astype(np.uint8)
    return ibr.Mesh(
        mesh.vertices[mesh.faces].reshape(-1, 3),
        np.arange(3 * len(mesh.faces)).reshape(-1, 3),
        colors=color.repeat(3, 0),
    )


def numbers_of(frame: ibr.Frame) -> np.ndarray:
    c = frame.color.astype(int)
    return np.where(frame.valid, c[..., 0] | c[..., 1] << 8 | c[..., 2] << 16, -1)


def cast(mesh: ibr.Mesh, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """True depth (inf: nothing) and number of the triangle (-1)."""
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(np.array(mesh.vertices), mesh.faces.astype(np.uint32))
    y, x = np.mgrid[: camera.height, : camera.width]
    pixels = np.stack([x, y], axis=-1).reshape(-1, 2)
    one = camera.unproject(pixels, np.ones(len(pixels)))
    if camera.projection == "perspective":
        rays, origin = one - camera.center, np.broadcast_to(camera.center, one.shape)
    else:
        rays, origin = np.broadcast_to(camera.forward, one.shape), one - camera.forward
    hits = scene.cast_rays(np.concatenate([origin, rays], axis=1).astype(np.float32))
    shape = camera.height, camera.width
    found = hits["primitive_ids"].numpy().reshape(shape).astype(np.int64)
    return hits["t_hit"].numpy().reshape(shape), np.where(found == 0xFFFFFFFF, -1, found)


def around(mesh: ibr.Mesh, projection: str, direction: tuple[float, float, float], size: tuple[int, int]) -> Camera:
    low, high = (corner.astype(float) for corner in mesh.bounds)
    middle, extent = 0.5 * (low + high), float(np.linalg.norm(high - low))
    away = np.array(direction) / np.linalg.norm(direction)
    up = (0, 1, 0) if abs(away[1]) < 0.9 else (0, 0, 1)
    camera = Camera.look_at(middle + 1.4 * extent * away, middle, up, size, fov_y=40)
    if projection == "perspective":
        return camera
    scale = min(size) / extent
    K = [[scale, 0, (size[0] - 1) / 2], [0, scale, (size[1] - 1) / 2], [0, 0, 1]]
    return Camera(K, size, camera.world_from_camera, "orthographic")


def interior(depth: np.ndarray, jump: float) -> np.ndarray:
    """Pixels 3 away from silhouettes and from jumps in depth."""
    z = np.where(np.isfinite(depth), depth, depth[np.isfinite(depth)].max() + 10 * jump).astype(np.float32)
    box = np.ones((3, 3))
    edges = (cv2.dilate(z, box) - cv2.erode(z, box) > jump).astype(np.uint8)
    return np.isfinite(depth) & ~cv2.dilate(edges, np.ones((7, 7))).astype(bool)


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
@pytest.mark.parametrize("name", MESHES)
def test_the_visible_triangle_is_embrees(name, projection):
    mesh = ibr.Mesh.load(shared(name))
    painted = numbered(mesh)
    for direction in ((0.3, 0.4, 1), (-1, 0.1, -0.4), (0.1, 1, 0.2)):
        camera = around(mesh, projection, direction, (480, 360))
        depth, number = cast(mesh, camera)
        frame = ibr.render(painted, camera)
        extent = float(np.linalg.norm(mesh.bounds[1] - mesh.bounds[0]))
        inside = interior(depth, 0.02 * extent)
        assert inside.sum() > 1000
        same = inside & (numbers_of(frame) == number)
        assert same.sum() >= 0.995 * inside.sum()
        # 1e-4: float32 pixels of up to 480 in positions, over triangles of a pixel
        np.testing.assert_allclose(frame.depth[same], depth[same], rtol=1e-4)
        assert (frame.valid != np.isfinite(depth)).mean() <= 1e-3


def patchwork(projection: str, seed: int = 0) -> tuple[ibr.Mesh, Camera]:
    """A jittered grid that covers a rectangle of pixels, some corners and edges exactly on pixel centres."""
    rng = np.random.default_rng(seed)
    n = 9
    y, x = np.mgrid[:n, :n] * 5.0
    x[1:-1, 1:-1] += rng.integers(-3, 4, (n - 2, n - 2)) * 0.5
    y[1:-1, 1:-1] += rng.integers(-3, 4, (n - 2, n - 2)) * 0.5
    z = rng.uniform(2, 9, (n, n))
    K = np.array([[40.0, 0, 3], [0, 40.0, 3], [0, 0, 1]])
    camera = Camera(K, (47, 47), projection=projection)
    points = camera.unproject(np.stack([x + 3, y + 3], axis=-1).reshape(-1, 2), z.ravel())
    i = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    flip = rng.random(len(i)) < 0.5
    one = np.where(flip[:, None], np.stack([i, i + 1, i + n], 1), np.stack([i, i + 1, i + n + 1], 1))
    two = np.where(flip[:, None], np.stack([i + 1, i + n + 1, i + n], 1), np.stack([i, i + n + 1, i + n], 1))
    return ibr.Mesh(points, np.concatenate([one, two])), camera


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_no_crack_and_no_pixel_twice(projection):
    for seed in range(2):
        mesh, camera = patchwork(projection, seed)
        covered = np.zeros((47, 47), int)
        for face in mesh.faces:
            covered += ibr.render(ibr.Mesh(mesh.vertices, [face]), camera).valid
        # Rounding of the projection decides on the rim's own pixels, 3 and 43, which no neighbour takes.
        assert (covered[4:43, 4:43] == 1).all()
        assert covered.max() == 1
        assert ibr.render(mesh, camera).valid[4:43, 4:43].all()


def test_a_floor_that_passes_under_the_camera():
    """Two triangles with corners far behind the camera: the plane's analytic depth, up to the horizon."""
    floor = ibr.Mesh([[-500, 1, -50], [500, 1, -50], [500, 1, 50], [-500, 1, 50]], [[0, 1, 2], [0, 2, 3]])
    camera = Camera([[60, 0, 79.5], [0, 60, 59.5], [0, 0, 1]], (160, 120))
    frame = ibr.render(floor, camera)
    y = np.arange(120) - 59.5
    depth = np.where(y > 0, 60 / np.where(y > 0, y, 1), np.inf)
    seen = depth < 49  # the floor ends at 50
    np.testing.assert_allclose(frame.depth[seen], np.tile(depth[seen, None], (1, 160)), rtol=1e-4)
    assert not frame.valid[depth > 50].any()


def test_what_lies_behind_the_camera_is_not_seen():
    behind = ibr.Mesh([[-5, -5, -2], [5, -5, -2], [0, 5, -2]], [[0, 1, 2], [0, 2, 1]])
    for projection in ("perspective", "orthographic"):
        camera = Camera([[20, 0, 30], [0, 20, 18], [0, 0, 1]], (61, 37), projection=projection)
        assert not ibr.render(behind, camera).valid.any()


def test_culling():
    front = ibr.Mesh([[0, 0, 3], [0, 1, 3], [1, 0, 3]], [[0, 1, 2]])  # its normal is -z: towards the camera
    camera = Camera([[20, 0, 5], [0, 20, 5], [0, 0, 1]], (30, 30))
    for cull, seen in ((0, True), (1, True), (-1, False)):
        target = Target(camera, np.dtype(np.uint8))
        draw_mesh(target, front, None, cull)
        assert target.frame().valid.any() == seen


def test_the_first_of_two_coincident_triangles_stays():
    points = np.array([[0, 0, 3], [1, 0, 3.5], [0, 1, 4]])
    color = np.repeat(np.array([[255, 0, 0], [0, 255, 0]], np.uint8), 3, axis=0)
    camera = Camera([[20, 0, 5], [0, 20, 5], [0, 0, 1]], (30, 30))
    both = ibr.render(ibr.Mesh(np.tile(points, (2, 1)), [[0, 1, 2], [3, 4, 5]], colors=color), camera)
    assert (both.color[both.valid] == (255, 0, 0)).all()


@pytest.mark.parametrize("size", [(1, 1), (7, 13), (61, 37), (64, 64)], ids=str)
def test_sizes_and_reproducible_bits(size):
    rng = np.random.default_rng(1)
    mesh = ibr.Mesh(rng.uniform((-1, -1, 2), (1, 1, 4), (300, 3)), rng.integers(0, 300, (500, 3)))
    camera = Camera([[size[0], 0, (size[0] - 1) / 2], [0, size[0], (size[1] - 1) / 2], [0, 0, 1]], size)
    first, second = ibr.render(mesh, camera), ibr.render(mesh, camera)
    assert first.valid.any()
    np.testing.assert_array_equal(first.depth, second.depth)
    np.testing.assert_array_equal(first.color, second.color)
    depth, _ = cast(mesh, camera)
    assert (first.valid != np.isfinite(depth)).sum() <= max(1, 2e-3 * first.valid.size)
