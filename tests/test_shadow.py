"""Shadows against rays cast at the true surfaces."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
import pytest

import pyibr as ibr
from pyibr import models
from pyibr.camera import Camera
from pyibr.capture import MeshScene, object_views
from pyibr.shadow import light_cameras
from tests.one_lane import one_lane
from tests.relief.solids import Carved, grid, torus

o3d = pytest.importorskip("open3d")

SIZE = (320, 240)
CAMERA = Camera.look_at((1.9, -3.4, 2.6), (0, 0, -0.1), (0, 0, 1), SIZE, fov_y=45)
LIGHTS = {
    "far": {"direction": (0.6, 0.5, -0.9)},
    "low": {"direction": (0.9, 0.2, -0.25)},
    "spot": {"position": (-2.0, -1.5, 3.0), "direction": (2, 1.5, -3.4), "angle": 70},
    "point": {"position": (-3.0, 1.0, 3.0)},
    "within": {"position": (0.0, 0.0, 0.5)},
}


def floor(size: float = 3.0, z: float = -0.45) -> ibr.Mesh:
    corners = [[-size, -size, z], [size, -size, z], [size, size, z], [-size, size, z]]
    return ibr.Mesh(corners, [[0, 1, 2], [0, 2, 3]], colors=np.full((4, 3), 200, np.uint8))


def block(low: tuple[float, float, float], high: tuple[float, float, float]) -> ibr.Mesh:
    """A box with a vertex for each corner of each side, so that its normals are the sides'."""
    corners = np.array(np.meshgrid(*zip(low, high, strict=True), indexing="ij")).reshape(3, -1).T
    quads = np.array([(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)])
    first = 4 * np.arange(6)[:, None]
    faces = np.concatenate([first + np.array(corner) for corner in ((0, 1, 2), (0, 2, 3))])
    vertices = corners[quads.ravel()]
    sides = np.repeat(np.cross(vertices[1::4] - vertices[::4], vertices[3::4] - vertices[::4]), 4, axis=0)
    return ibr.Mesh(vertices, faces, None, sides, colors=np.full((24, 3), 180, np.uint8))


def joined(meshes: list[ibr.Mesh]) -> o3d.t.geometry.RaycastingScene:
    scene = o3d.t.geometry.RaycastingScene()
    for mesh in meshes:
        scene.add_triangles(np.array(mesh.vertices), mesh.faces.astype(np.uint32))
    return scene


def truly_lit(scene: o3d.t.geometry.RaycastingScene, light: ibr.Light) -> tuple[np.ndarray, np.ndarray]:
    """Which pixels of CAMERA see a point that the light reaches, and their depths (inf: nothing)."""
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    pixels = np.column_stack([x.ravel(), y.ravel()])
    rays = CAMERA.unproject(pixels, np.ones(len(pixels))) - CAMERA.center
    packed = np.concatenate([np.broadcast_to(CAMERA.center, rays.shape), rays], axis=1).astype(np.float32)
    answer = scene.cast_rays(packed)
    t, normal = answer["t_hit"].numpy().astype(float), answer["primitive_normals"].numpy().astype(float)
    hit = np.isfinite(t)
    normal *= -np.sign((normal * rays).sum(axis=1, keepdims=True))
    point = CAMERA.center + np.where(hit, t, 0)[:, None] * rays + 1e-4 * normal
    if light.position is None:
        to = np.broadcast_to(-light.direction / np.linalg.norm(light.direction) * 100, point.shape)
    else:
        to = light.position - point
    shadow = scene.cast_rays(np.concatenate([point, to], axis=1).astype(np.float32))["t_hit"].numpy()
    lit = hit & ~(shadow < 1) & ((normal * to).sum(axis=1) > 0)
    if light.position is not None and light.direction is not None:
        along = -(to @ light.direction) / np.linalg.norm(to, axis=1) / np.linalg.norm(light.direction)
        lit &= along > np.cos(np.radians(light.angle / 2))
    return lit.reshape(y.shape), np.where(hit, t, np.inf).reshape(y.shape)


def lit_in(frame: ibr.Frame, ambient: float, own: np.ndarray) -> np.ndarray:
    """Pixels with more than ambient light: half a grey level and the filter's first part."""
    return (frame.color.astype(float) - ambient * own).max(axis=2) > 2


def agreement(lit: np.ndarray, truth: np.ndarray, depth: np.ndarray) -> float:
    """Share of equal pixels, 3 away from where truth or depth change."""
    z = np.where(np.isfinite(depth), depth, 100).astype(np.float32)
    around = np.ones((3, 3))
    edges = cv2.dilate(z, around) - cv2.erode(z, around) > 0.1
    mask = truth.astype(np.uint8)
    edges |= cv2.dilate(mask, around) != cv2.erode(mask, around)
    inside = np.isfinite(depth) & (cv2.dilate(edges.astype(np.uint8), np.ones((7, 7))) == 0)
    assert inside.mean() > 0.1
    return float((lit == truth)[inside].mean())


@cache
def scene() -> tuple[list[ibr.Mesh], o3d.t.geometry.RaycastingScene]:
    meshes = [floor(), models.donut(64), block((0.9, 0.9, -0.45), (1.2, 1.2, 0.8))]
    return meshes, joined(meshes)


@pytest.mark.parametrize("name", list(LIGHTS))
def test_meshes_against_cast_rays(name):
    light = ibr.Light(**LIGHTS[name], ambient=0.3)
    meshes, cast = scene()
    frame, own = ibr.render(meshes, CAMERA, light), ibr.render(meshes, CAMERA)
    truth, depth = truly_lit(cast, light)
    dim = own.color.astype(float)
    # Where light only grazes, half a grey level is all there is: nearly tangent points count as neither.
    assert agreement(lit_in(frame, 0.3, dim), truth, depth) >= 0.97
    assert 0.05 < truth[np.isfinite(depth)].mean() < 0.95


@pytest.mark.parametrize("elevation", [80, 45, 20, 10])
def test_a_plane_has_no_shadow_of_its_own(elevation):
    angle = np.radians(elevation)
    light = {"direction": (np.cos(angle), 0.3 * np.cos(angle), -np.sin(angle)), "ambient": 0.1}
    for plane in (floor(), grid(torus, 64, 32)):
        dark = ibr.render(plane, CAMERA, ibr.Light(**light))
        plain = ibr.render(plane, CAMERA, ibr.Light(**light, shadow_size=0))
        if len(plane.faces) == 2:
            assert np.abs(dark.color.astype(int) - plain.color).max() <= 1
        else:  # a torus shades itself; what faces the light alone must not be speckled
            seen, depth = truly_lit(joined([plane]), ibr.Light(**light))
            lit = lit_in(dark, 0.1, np.where(plain.valid[..., None], 204.0, 0))
            assert agreement(lit, seen, depth) >= 0.99


def test_a_blocks_shadow_starts_at_its_foot():
    meshes = [floor(), block((-0.3, -0.3, -0.45), (0.3, 0.3, 0.6))]
    light = ibr.Light(direction=(-0.2, 0.9, -0.6), ambient=0)
    frame = ibr.render(meshes, CAMERA, light)
    foot = np.array([[x, 0.3 + step, -0.45] for x in np.linspace(-0.2, 0.2, 9) for step in (0.02, 0.05)])
    behind = Camera.look_at((1.0, 3.4, 2.6), (0, 0.3, -0.3), (0, 0, 1), SIZE, fov_y=30)
    frame = ibr.render(meshes, behind, light)
    u, v = behind.project(foot)[0].T.round().astype(int)
    assert (frame.color[v, u] == 0).all()


def test_reliefs_cast_and_receive():
    rng = np.random.default_rng(0)
    height = cv2.GaussianBlur(rng.random((32, 32)).astype(np.float32), (0, 0), 1.5)
    height = (height - height.min()) / np.ptp(height)
    relief = ibr.ReliefSurface(grid(torus, 96, 48), height, np.full((2, 2, 3), 200, np.uint8), 0.06, (12, 5))
    carved = Carved(torus, height, 0.06, (12, 5))
    ground = floor()
    carved.scene.add_triangles(np.array(ground.vertices), ground.faces.astype(np.uint32))
    light = ibr.Light(**LIGHTS["far"], ambient=0.3)
    frame, own = ibr.render([ground, relief], CAMERA, light), ibr.render([ground, relief], CAMERA)
    truth, depth = truly_lit(carved.scene, light)
    assert agreement(lit_in(frame, 0.3, own.color.astype(float)), truth, depth) >= 0.97


@pytest.mark.parametrize("slicing", ["orthogonal", "screen"])
def test_sliced_surfaces_cast_and_receive(slicing):
    height = np.full((32, 32), 0.1, np.float32)
    height[12:20, 12:20] = 1
    base = ibr.Mesh([[-1, -1, -0.4], [1, -1, -0.4], [1, 1, -0.4], [-1, 1, -0.4]], [[0, 1, 2], [0, 2, 3]], np.eye(4, 2))
    uv = [[0, 0], [1, 0], [1, 1], [0, 1]]
    base = ibr.Mesh(base.vertices, base.faces, uv)
    thing = ibr.SlicedSurface(base, height, np.full((2, 2, 3), 200, np.uint8), 0.8, slices=128, slicing=slicing)
    sun = {"direction": (0.8, 0.1, -0.7), "ambient": 0.2}
    frame = ibr.render([floor(), thing], CAMERA, ibr.Light(**sun))
    plain = ibr.render([floor(), thing], CAMERA, ibr.Light(**sun, shadow_size=0))
    # The tower is 0.5 wide and rises 0.72 above its surroundings: its shadow falls to x = 0.25 + 0.72 * 8 / 7.
    points = np.array(
        [[x, y, -0.32] for x in (0.4, 0.7, 0.95) for y in (0.0, 0.1)] + [[-0.6, y, -0.32] for y in (-0.5, 0.5)]
    )
    u, v = CAMERA.project(points)[0].T.round().astype(int)
    darker = frame.color[v, u, 0] < 0.5 * plain.color[v, u, 0]
    np.testing.assert_array_equal(darker, [True] * 6 + [False] * 2)


def test_images_and_objects_cast_and_receive():
    knot = MeshScene.from_mesh(models.donut(48))
    thing = ibr.DepthObject(object_views(knot, 256), 128)
    light = ibr.Light(**LIGHTS["far"], ambient=0.25)
    ground = floor()
    own = ibr.render([ground, thing], CAMERA)
    frame = ibr.render([ground, thing], CAMERA, light)
    truth, depth = truly_lit(joined([ground, models.donut(48)]), light)
    alone = ibr.render(ground, CAMERA)
    on_ground = own.valid & (np.abs(own.depth - alone.depth) < 1e-4)
    ground_lit = frame.color[..., 0] > 60  # 50 is its ambient part
    inside = cv2.erode(on_ground.astype(np.uint8), np.ones((7, 7))) > 0
    assert agreement(np.where(inside, ground_lit, truth), truth, depth) >= 0.97
    # A depth image of the ground gets the object's shadow as the mesh does.
    seen = MeshScene.from_mesh(ground).capture(CAMERA)
    both = ibr.render([seen, thing], CAMERA, light)
    shadowed = both.color.astype(float)[..., 0] < 0.6 * own.color.astype(float)[..., 0].clip(1)
    reference = seen.valid & inside
    darker = (both.color.astype(float) / np.maximum(ibr.render([seen, thing], CAMERA).color, 1))[..., 0] < 0.6
    assert agreement(np.where(reference, ~darker, truth), truth, depth) >= 0.97
    assert shadowed.any()


def test_without_shadows_nothing_is_looked_at():
    meshes, _ = scene()
    first = ibr.render(meshes, CAMERA, ibr.Light(**LIGHTS["far"], shadow_size=0))
    lit = ibr.render(meshes, CAMERA, ibr.Light(**LIGHTS["far"]))
    assert (first.color >= lit.color).all()
    assert (first.color > lit.color).any()


def test_two_runs_give_the_same_bits_and_one_lane_is_as_good():
    meshes, _ = scene()
    light = ibr.Light(**LIGHTS["spot"], specular=0.4)
    first, second = ibr.render(meshes, CAMERA, light), ibr.render(meshes, CAMERA, light)
    np.testing.assert_array_equal(first.color, second.color)
    with one_lane():
        one = ibr.render(meshes, CAMERA, light)
    assert (np.abs(one.color.astype(int) - first.color).max(axis=2) <= 1).mean() >= 0.995


def test_highlights_follow_blinn():
    light = ibr.Light(position=(0, 0, 3.0), specular=0.5, shininess=20, ambient=0.2, shadow_size=0)
    camera = Camera.look_at((0, -2, 3.0), (0, 0, -0.45), (0, 0, 1), (81, 61), fov_y=50)
    frame, own = ibr.render(floor(), camera, light), ibr.render(floor(), camera)
    y, x = np.mgrid[:61, :81]
    point = camera.unproject(np.column_stack([x.ravel(), y.ravel()]), own.depth.ravel().astype(float))
    to, view = (0, 0, 3.0) - point, camera.center - point
    to, view = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in (to, view))
    half = (to + view) / np.linalg.norm(to + view, axis=1, keepdims=True)
    expected = 200 * (0.2 + 0.8 * to[:, 2]) + 255 * 0.8 * 0.5 * half[:, 2] ** 20
    seen = own.valid.ravel()
    assert np.abs(frame.color[..., 0].ravel() - expected.clip(0, 255))[seen].max() <= 1.01


@pytest.mark.parametrize(
    ("light", "count"),
    [
        ({"direction": (0.6, 0.5, -0.9)}, 1),
        ({"direction": (0, 0, -1)}, 1),
        ({"position": (-8.0, 1.0, 6.0)}, 1),
        ({"position": (-3.0, 1.0, 1.5)}, 6),  # so close that one map would be all edge
        ({"position": (0.0, 0.0, 0.5)}, 6),
        ({"position": (0.0, 0.0, 0.5), "direction": (1, 0, 0)}, 1),
    ],
)
def test_the_lights_cameras_see_all_of_the_scene(light, count):
    low, high = np.array([-3.0, -3, -0.5]), np.array([3.0, 3, 1])
    cameras = light_cameras(ibr.Light(**light, shadow_size=64), [(low, high)])
    assert len(cameras) == count
    corners = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1).T
    seen = np.zeros(8, bool)
    for camera in cameras:
        pixel, depth = camera.project(corners)
        seen |= (depth > 0) & (pixel >= -0.5).all(axis=1) & (pixel <= 63.5).all(axis=1)
    assert seen.all() or ("direction" in light and "position" in light)
