"""Lit scenes, and their true shadows, from rays cast from points of the surface to the light."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

import pyibr as ibr
from pyibr.capture import MeshScene
from pyibr.core.camera import Camera
from tests.boxes import cuboid
from tests.embree import rays_of
from tests.slicing.solids import revolved

AMBIENT = 0.25


def white(points: np.ndarray, faces: np.ndarray) -> ibr.Mesh:
    return ibr.Mesh(points, faces, colors=np.full((len(points), 3), 255, np.uint8))


def plane(half: float = 2.0, z: float = 0.0) -> ibr.Mesh:
    corners = [[-half, -half, z], [half, -half, z], [half, half, z], [-half, half, z]]
    return white(corners, [[0, 1, 2], [0, 2, 3]])


def box(middle: tuple[float, float, float], half: tuple[float, float, float]) -> ibr.Mesh:
    """A box whose sides share corners, so that its interpolated normals differ much from the sides' normals."""
    return white(*cuboid(np.subtract(middle, half), np.add(middle, half)))


def ring(middle: tuple[float, float, float], radius: float, tube: float, sides: int = 96) -> ibr.Mesh:
    turn = np.arange(48) * 2 * np.pi / 48
    points, faces = revolved(np.column_stack([radius + tube * np.cos(turn), tube * np.sin(turn)]), True, sides)
    return white(points[:, [2, 0, 1]] + middle, faces)


def ball(middle: tuple[float, float, float], radius: float) -> ibr.Mesh:
    turn = np.linspace(-np.pi / 2, np.pi / 2, 49)
    points, faces = revolved(radius * np.column_stack([np.cos(turn), np.sin(turn)]), False)
    return white(points[:, [2, 0, 1]] + middle, faces)


SCENES = {
    "torus and boxes": [
        plane(),
        box((-0.8, 0.5, 0.35), (0.25, 0.25, 0.35)),
        box((0.9, -0.7, 0.15), (0.3, 0.2, 0.15)),
        ring((0.2, 0.4, 0.75), 0.5, 0.2),
    ],
    "balls": [plane(), ball((0, 0, 0.8), 0.8), ball((0.9, -0.9, 0.4), 0.4), ball((-1.0, -0.4, 0.3), 0.3)],
}
LIGHTS = {
    "directional": {"direction": (1, 0.6, -1.2)},
    "low": {"direction": (-1, 0.4, -0.35)},
    "spot": {"position": (-2, -1, 3), "direction": (2, 1.2, -3), "angle": 40},
    "wide spot": {"position": (0.4, -1.1, 1.9), "direction": (-0.1, 0.6, -1), "angle": 160},
    "point": {"position": (-1.5, -2, 2.8)},
    "point among them": {"position": (0.1, -1.2, 1.1)},
}
CAMERAS = {
    "perspective": Camera.look_at((1.5, -3.2, 2.6), (0, 0, 0.2), (0, 0, 1), (240, 180), fov_y=45),
    "orthographic": Camera.look_at(
        (-0.5, -3.2, 3), (0, 0, 0.2), (0, 0, 1), (240, 180), projection="orthographic", height=3.6
    ),
}


def light_of(name: str, **more: Any) -> ibr.Light:
    return ibr.Light(**LIGHTS[name], ambient=AMBIENT, **more)


def first_hits(scene: Any, camera: Camera) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """True planar depth (H, W), inf without a hit, and the hits' points and unit normals towards the camera."""
    rays = rays_of(camera)
    origin = rays[:, :3]
    found = scene.cast_rays(rays.astype(np.float32))
    t, normal = found["t_hit"].numpy().astype(float), found["primitive_normals"].numpy().astype(float)
    normal *= np.where((normal * rays[:, 3:]).sum(axis=1, keepdims=True) > 0, -1, 1)
    with np.errstate(invalid="ignore"):
        points = origin + t[:, None] * rays[:, 3:]
    shape = camera.height, camera.width
    return t.reshape(shape), points.reshape(*shape, 3), normal.reshape(*shape, 3)


def true_shares(scene: Any, light: ibr.Light, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """(H, W) bool: points that the light reaches: a ray cast to the light is free, and lies within a spot's cone."""
    flat = np.where(np.isfinite(points), points, 0).reshape(-1, 3)
    away = np.full_like(flat, 1) * -light.direction if light.position is None else light.position - flat
    length = np.linalg.norm(away, axis=1, keepdims=True) if light.position is not None else np.full((len(flat), 1), 1e3)
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    start = flat + 1e-4 * normals.reshape(-1, 3)
    hidden = scene.test_occlusions(np.concatenate([start, away], axis=1).astype(np.float32), 0, 1e3).numpy()
    reached = scene.cast_rays(np.concatenate([start, away], axis=1).astype(np.float32))["t_hit"].numpy() > length[:, 0]
    seen = ~hidden | reached
    if light.position is not None and light.direction is not None:
        seen &= -away @ light.direction / np.linalg.norm(light.direction) > np.cos(np.radians(light.angle / 2))
    faces = (away * normals.reshape(-1, 3)).sum(axis=1) > 0
    return (seen & faces).reshape(points.shape[:2])


def edges(of: np.ndarray, jump: float = 0.15) -> np.ndarray:
    """(H, W) bool: pixels within 3 pixels of a change in a boolean image, or of a step in depth of more than `jump`."""
    if of.dtype == bool:
        low, high = (f(of.astype(np.uint8), np.ones((3, 3))) for f in (cv2.erode, cv2.dilate))
        at = low != high
    else:
        z = np.where(np.isfinite(of), of, 1e3)
        at = cv2.dilate(z, np.ones((3, 3))) - cv2.erode(z, np.ones((3, 3))) > jump
    return cv2.dilate(at.astype(np.uint8), np.ones((5, 5))) > 0


def shares(things: Any, camera: Camera, light: ibr.Light, **options: Any) -> tuple[np.ndarray, np.ndarray]:
    """(H, W) fraction of the unshadowed light that a picture shows, and the mask of pixels where it is measurable."""
    kept = {name: getattr(light, name) for name in ("direction", "position", "color", "ambient", "angle")}
    plain = ibr.Light(**kept, shadow_size=0)
    picture, lit = (ibr.render(things, camera, one, **options).color[..., 0].astype(float) for one in (light, plain))
    own = ibr.render(things, camera, **options).color[..., 0].astype(float)
    told = lit - AMBIENT * own > 8  # levels of 255; with less light, rounding changes the fraction too much
    return np.where(told, (picture - AMBIENT * own) / np.where(told, lit - AMBIENT * own, 1), 0), told


def agreement(things: Any, scene: Any, camera: Camera, light: ibr.Light, **options: Any) -> float:
    depth, points, normals = first_hits(scene, camera)
    truth = true_shares(scene, light, points, normals)
    share, told = shares(things, camera, light, **options)
    counted = told & np.isfinite(depth) & ~edges(truth) & ~edges(depth)
    assert counted.sum() > 2500
    assert 0.02 < truth[counted].mean() < 0.999  # both light and shadow
    return float(((share > 0.5) == truth)[counted].mean())


def hilly() -> np.ndarray:
    y, x = np.mgrid[:64, :64] / 64
    waves = np.sin(2 * np.pi * (2 * x + 0.3)) * np.cos(2 * np.pi * y) + 0.4 * np.sin(2 * np.pi * (x + 3 * y))
    return (0.5 + 0.3 * waves).clip(0.05, 0.95).astype(np.float32)


def joined(meshes: list[ibr.Mesh]) -> MeshScene:
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    vertices = np.concatenate([mesh.vertices for mesh in meshes])
    faces = np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)])
    return MeshScene(vertices, faces, colors=np.full((len(vertices), 3), 255, np.uint8))
