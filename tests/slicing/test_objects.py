"""Depth objects against the intersection of the displaced volumes in float64, and against the true mesh."""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import numpy as np
import pytest

import pyibr as ibr
from pyibr import metrics
from pyibr.camera import Camera
from pyibr.capture import MeshScene, object_views
from tests.data import shared
from tests.reference.slicing import first_depth

o3d = pytest.importorskip("open3d")


@cache
def torus() -> MeshScene:
    """A torus whose colours tell where a point lies."""
    mesh = o3d.geometry.TriangleMesh.create_torus(1.0, 0.45, 120, 60)
    vertices = np.asarray(mesh.vertices) * (1, 1.1, 1) @ np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    colors = np.clip(127.5 + 80 * vertices, 0, 255).astype(np.uint8)
    return MeshScene(vertices, np.asarray(mesh.triangles), colors)


@cache
def cup() -> MeshScene:
    """Open above (+y): a wall 0.15 thick, and a bottom."""
    turn = np.linspace(0, 2 * np.pi, 97)[:-1]
    profile = [(0, -1), (0.8, -1), (0.8, 1), (0.65, 1), (0.65, -0.8), (0, -0.8)]
    rings = np.array([[(r * np.cos(t), y, r * np.sin(t)) for t in turn] for r, y in profile])
    i = np.arange(96)
    faces = []
    for a, b in pairwise(range(len(profile))):
        p, q, r, s = a * 96 + i, a * 96 + (i + 1) % 96, b * 96 + i, b * 96 + (i + 1) % 96
        faces += [np.stack([p, r, q], 1), np.stack([q, r, s], 1)]
    vertices = rings.reshape(-1, 3)
    colors = np.clip(127.5 + 100 * vertices, 0, 255).astype(np.uint8)
    return MeshScene(vertices, np.concatenate(faces), colors)


def looking(scene: MeshScene, direction: tuple[float, float, float], size: tuple[int, int]) -> Camera:
    low, high = scene.vertices.min(axis=0), scene.vertices.max(axis=0)
    middle, extent = 0.5 * (low + high), np.linalg.norm(high - low)
    away = np.array(direction) / np.linalg.norm(direction)
    return Camera.look_at(middle + 1.3 * extent * away, middle, (0, 1, 0), size, fov_y=42)


def reference(thing: ibr.DepthObject, camera: Camera) -> np.ndarray:
    z = camera.camera_from_world[2, :3] @ thing.box.corners.T + camera.camera_from_world[2, 3]
    return first_depth(camera, [v.camera for v in thing.views], thing.maps, float(z.min()), float(z.max()), 600)


def spacing(thing: ibr.DepthObject | ibr.VisualHull) -> float:
    return float(thing.box.edges.max()) / thing.slices


def iou(a: np.ndarray, b: np.ndarray) -> float:
    return float((a & b).sum() / (a | b).sum())


def check(thing: ibr.DepthObject, camera: Camera, truth: np.ndarray, same: float = 0.995) -> None:
    frame = ibr.render(thing, camera)
    seen = np.isfinite(truth)
    assert iou(frame.valid, seen) >= same
    both = frame.valid & seen
    assert np.median(np.abs(frame.depth - truth)[both]) <= 0.5 * spacing(thing)


def some_views(kind: str) -> list[ibr.DepthImage]:
    scene = torus()
    if kind in ("orthographic", "perspective"):
        return object_views(scene, 160, kind)
    if kind == "four":
        return object_views(scene, 160)[:4]
    directions = np.random.default_rng(5).normal(size=(9, 3))
    return [scene.capture(looking(scene, tuple(d), (150, 170))) for d in directions]


@pytest.mark.parametrize("slicing", ["orthogonal", "screen"])
@pytest.mark.parametrize("kind", ["orthographic", "perspective", "four", "nine, anywhere"])
def test_it_is_the_intersection_of_the_displaced_volumes(kind, slicing):
    thing = ibr.DepthObject(some_views(kind), slices=256, slicing=slicing)
    camera = looking(torus(), (0.5, 0.4, 1), (110, 90))
    check(thing, camera, reference(thing, camera), same=0.985)  # of few pixels, more are the outline's


def test_without_halvings_points_lie_on_slices():
    thing = ibr.DepthObject(some_views("orthographic"), 64, "screen", halvings=0)
    frame = ibr.render(thing, looking(torus(), (0.5, 0.4, 1), (110, 90)))
    number = frame.depth[frame.valid] / spacing(thing)
    # z is some 4 units, 200 slices, of float32
    np.testing.assert_allclose(number, np.rint(number), atol=200 * 2**-22)


def test_the_dragon_at_full_size():
    scene = MeshScene.from_mesh(ibr.Mesh.load(shared("meshes/dragon_vrip.ply.gz")))
    thing = ibr.DepthObject(object_views(scene, 512), slices=256)
    camera = looking(scene, (0.15, 0.1, 1), (512, 512))
    check(thing, camera, reference(thing, camera))


@pytest.mark.parametrize("slicing", ["orthogonal", "screen"])
def test_against_the_mesh_with_the_colours_of_views_that_saw_the_point(slicing):
    views, scores = some_views("orthographic"), {}
    for texture in ("visible", "naive"):
        thing = ibr.DepthObject(views, 256, slicing, texture)
        for direction in ((0.5, 0.4, 1), (-1, 0.3, 0.2)):
            camera = looking(torus(), direction, (160, 120))
            truth, frame = torus().capture(camera), ibr.render(thing, camera)
            assert iou(frame.valid, truth.valid) >= 0.97
            both = frame.valid & truth.valid
            scores.setdefault(texture, []).append(metrics.psnr(frame.color, truth.color, both))
    assert np.mean(scores["visible"]) > np.mean(scores["naive"]) + 3  # dB
    assert np.mean(scores["visible"]) > 25


def test_a_cups_cavity_is_in_the_object_and_not_in_the_hull():
    scene = cup()
    views = object_views(scene, 160)
    camera = looking(scene, (0.2, 1.5, 0.3), (120, 120))
    truth = scene.capture(camera)
    frame = ibr.render(ibr.DepthObject(views, 200), camera)
    hull = ibr.render(ibr.VisualHull(views, 200), camera)
    middle = (slice(50, 70), slice(50, 70))
    np.testing.assert_allclose(frame.depth[middle], truth.depth[middle], atol=0.1)  # the bottom, 1.8 deep
    assert (truth.depth[middle] - hull.depth[middle]).min() > 1.0


def test_laws():
    views = some_views("orthographic")
    camera = looking(torus(), (0.5, 0.4, 1), (90, 70))
    thing = ibr.DepthObject(views, 64)
    frame = ibr.render(thing, camera)
    again = ibr.render(ibr.DepthObject(views, 64), camera)
    np.testing.assert_array_equal(frame.depth, again.depth)
    np.testing.assert_array_equal(frame.color, again.color)
    turned = ibr.render(ibr.DepthObject([views[0], *views[:0:-1]], 64), camera)  # the first view gives the box's axes
    np.testing.assert_array_equal(frame.valid, turned.valid)
    np.testing.assert_array_equal(frame.depth, turned.depth)
    hull = ibr.VisualHull(views, 64)
    assert hull.tested == [0, 2, 4]  # opposite silhouettes are one
    assert ibr.render(hull, camera).valid[frame.valid].mean() >= 0.99
    for size in ((1, 1), (7, 13), (61, 37)):
        small = ibr.render(thing, camera.resized(size))
        np.testing.assert_array_equal(np.isfinite(small.depth), small.valid)
        assert small.valid.any()
    inside = Camera([[30, 0, 20], [0, 30, 20], [0, 0, 1]], (41, 41))  # in the torus' hole
    for slicing in ("orthogonal", "screen"):
        ring = ibr.render(ibr.DepthObject(views, 64, slicing), inside)
        np.testing.assert_array_equal(np.isfinite(ring.depth), ring.valid)


def test_it_stands_among_other_things():
    thing = ibr.DepthObject(some_views("orthographic"), 128)
    camera = looking(torus(), (0, 0, 1), (100, 80))
    alone = ibr.render(thing, camera)
    # A wall through the middle, across the view: it hides what lies behind it and nothing else.
    wall = ibr.Mesh([[-5, -5, 0], [5, -5, 0], [5, 5, 0], [-5, 5, 0]], [[0, 1, 2], [0, 2, 3]])
    z = float(camera.camera_from_world[2, 3])
    both = [ibr.render(order, camera) for order in ([thing, wall], [wall, thing])]
    np.testing.assert_array_equal(both[0].depth, both[1].depth)
    assert both[0].valid.all()
    front = alone.valid & (alone.depth < z - 1e-3)
    np.testing.assert_array_equal(both[0].depth[front], alone.depth[front])
    np.testing.assert_allclose(both[0].depth[~alone.valid], z, rtol=1e-5)


def test_bad_input():
    views = some_views("orthographic")
    far = [ibr.DepthImage(v.color, v.depth, v.camera.moved(100.0 * k, 0, 0)) for k, v in enumerate(views)]
    empty = ibr.DepthImage(views[0].color, np.full_like(views[0].depth, np.nan), views[0].camera)
    for bad in ([], views[0], [3], far, [*views, empty]):
        with pytest.raises(ibr.ArgumentError, match=r"^views: "):
            ibr.DepthObject(bad)
    for changes, argument in (
        ({"slices": 0}, "slices"),
        ({"slices": 1.5}, "slices"),
        ({"slicing": "surface"}, "slicing"),
        ({"texture": "best"}, "texture"),
        ({"halvings": -1}, "halvings"),
    ):
        with pytest.raises(ibr.ArgumentError, match=rf"^{argument}: "):
            ibr.DepthObject(views, **changes)
