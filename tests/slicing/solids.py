"""Solids for tests of depth objects and visual hulls, and cameras around them."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import ArrayLike

import pyibr as ibr
from pyibr.capture import MeshScene, object_views
from pyibr.core.camera import Camera
from tests.data import shared


def revolved(profile: ArrayLike, closed: bool, sides: int = 96) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces of a profile, (n, 2) radius and height, revolved about the y axis.

    closed: the profile's last point is joined with the first.
    """
    radius, height = np.asarray(profile, float).T
    n, turn = len(radius), np.arange(sides) * 2 * np.pi / sides
    x, y, z = np.outer(np.cos(turn), radius), np.tile(height, (sides, 1)), np.outer(np.sin(turn), radius)
    i, j = np.mgrid[:sides, : n if closed else n - 1]
    following, right = (i + 1) % sides * n, (j + 1) % n
    a, b, c, d = i * n + j, i * n + right, following + right, following + j
    faces = np.concatenate([np.stack(corners, -1).reshape(-1, 3) for corners in ((a, b, c), (a, c, d))])
    return np.stack([x, y, z], axis=-1).reshape(-1, 3), faces


def colored(vertices: np.ndarray, faces: np.ndarray) -> MeshScene:
    """A scene of the mesh, with colours that depend on position."""
    return MeshScene(vertices, faces, colors=np.clip(127.5 + 80 * vertices, 0, 255).astype(np.uint8))


@cache
def torus() -> MeshScene:
    """A torus with radii 1 and 0.45, in an oblique position."""
    turn = np.arange(60) * 2 * np.pi / 60
    vertices, faces = revolved(np.column_stack([1 + 0.45 * np.cos(turn), 0.45 * np.sin(turn)]), closed=True, sides=120)
    aslant, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
    return colored(vertices @ aslant, faces)


@cache
def cup() -> MeshScene:
    """A cup that is open at the top (+y), with a bottom and a wall 0.15 thick."""
    return colored(*revolved([(0, -1), (0.8, -1), (0.8, 1), (0.65, 1), (0.65, -0.8), (0, -0.8)], closed=False))


@cache
def ball() -> MeshScene:
    """A ball of radius 1."""
    turn = np.linspace(0, np.pi, 101)
    return colored(*revolved(np.column_stack([np.sin(turn), -np.cos(turn)]), closed=False, sides=200))


@cache
def knot() -> MeshScene:
    """A striped trefoil knot: a tube that hides much of itself from any six views."""
    a, b = np.meshgrid(np.linspace(0, 2 * np.pi, 241)[:-1], np.linspace(0, 2 * np.pi, 33)[:-1], indexing="ij")

    def line(t: np.ndarray) -> np.ndarray:
        return np.stack([np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t), -np.sin(3 * t)], axis=-1)

    along = line(a + 1e-4) - line(a - 1e-4)
    side = np.cross(along, (0, 0, 1.0))
    side /= np.linalg.norm(side, axis=-1, keepdims=True)
    up = np.cross(along, side)
    up /= np.linalg.norm(up, axis=-1, keepdims=True)
    vertices = line(a) + 0.55 * (np.cos(b)[..., None] * side + np.sin(b)[..., None] * up)
    number = np.arange(a.size).reshape(a.shape)
    right, down = np.roll(number, -1, axis=1), np.roll(number, -1, axis=0)
    diagonal = np.roll(right, -1, axis=0)
    faces = np.concatenate([np.stack([number, down, diagonal], -1), np.stack([number, diagonal, right], -1)])
    gray = (60 + 140 * (np.floor(a * 14 / np.pi) % 2)).astype(np.uint8)
    return MeshScene(vertices.reshape(-1, 3), faces.reshape(-1, 3), colors=np.repeat(gray.reshape(-1, 1), 3, 1))


@cache
def dragon() -> tuple[MeshScene, list[ibr.DepthImage]]:
    """The scanned dragon, 871,414 triangles, and six depth images of it."""
    scene = MeshScene.from_mesh(ibr.Mesh.load(shared("meshes/dragon_vrip.ply.gz")))
    return scene, object_views(scene, 512)


def looking(
    scene: MeshScene, direction: ArrayLike, size: tuple[int, int], projection: str = "perspective", near: float = 1.3
) -> Camera:
    """A camera that sees the whole scene, `near` times its diagonal away from its middle in the given direction."""
    low, high = scene.vertices.min(axis=0), scene.vertices.max(axis=0)
    middle, extent = 0.5 * (low + high), np.linalg.norm(high - low)
    eye = middle + near * extent * np.asarray(direction) / np.linalg.norm(direction)
    how = {"fov_y": 42.0} if projection == "perspective" else {"projection": projection, "height": 1.05 * extent}
    return Camera.look_at(eye, middle, (0, 1, 0), size, **how)


@cache
def views_of_torus(kind: str) -> list[ibr.DepthImage]:
    """Six "orthographic" or "perspective" views, "four" around one axis, or "nine, anywhere", of both projections."""
    scene = torus()
    if kind in ("orthographic", "perspective"):
        return object_views(scene, 160, projection=kind)
    if kind == "four":
        return object_views(scene, 160)[:4]
    directions = np.random.default_rng(5).normal(size=(9, 3))
    projections = ("perspective", "orthographic")
    return [scene.capture(looking(scene, d, (150, 170), projections[k % 2])) for k, d in enumerate(directions)]


def spacing(thing: ibr.DepthObject | ibr.VisualHull) -> float:
    """Distance between slices in scene units."""
    return float(thing.box.edges.max()) / thing.slices
