"""Pictures of Gaussians for pictures.py: a made tree beside other things, and a scene of a file.

The tree consists of flat Gaussians: bark around a trunk and its branches, and leaves of all directions.
"""

from __future__ import annotations

from functools import cache

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from objects import knot
from reliefs import WHITE, bricks, quad, show

import pyibr as ibr
from pyibr.capture import capture, object_views

Array = NDArray[np.float64]

LEAVES, BARK, CLUSTERS = 60_000, 30_000, 26
CROWN = np.array([0.0, 0.0, 2.05])
CAMERA = ibr.Camera.look_at((1.1, -5.6, 2.2), (0.35, 0, 1.25), (0, 0, 1), (620, 440), fov_y=40)
SUN = ibr.Light(direction=(0.75, 0.45, -1.0), color=(1.5, 1.45, 1.3), ambient=0.4, shadow_size=2048)


def _turned_to(normals: Array) -> Array:
    """Quaternions that turn the z axis to unit normals."""
    x, y, z = normals.T
    return np.stack([np.maximum(1 + z, 1e-6), -y, x, 0 * x], axis=1)


def _unit(vectors: Array) -> Array:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


@cache
def tree() -> ibr.Gaussians:
    """Return a tree whose foot is the origin; z points up, and the unit is the metre."""
    rng = np.random.default_rng(3)
    middles = CROWN + _unit(rng.normal(size=(CLUSTERS, 3))) * (0.85, 0.85, 0.6) * rng.uniform(0.5, 1, (CLUSTERS, 1))
    cluster, out = rng.integers(0, CLUSTERS, LEAVES), _unit(rng.normal(size=(LEAVES, 3)))
    leaves = middles[cluster] + 0.38 * out * rng.random((LEAVES, 1)) ** 0.5
    tint = rng.random((LEAVES, 1))
    green = np.array([0.16, 0.36, 0.1]) + tint * (0.34, 0.32, 0.08)
    green *= 0.55 + 0.45 * np.clip((leaves[:, 2:] - 1.3) / 1.4, 0, 1)  # darker at the bottom
    # From the foot to the fork, then to the middle of a cluster
    branch, along = rng.integers(-CLUSTERS, CLUSTERS, BARK), rng.random((BARK, 1))
    fork, is_trunk = np.array([0.05, 0, 1.25]), (branch < 0)[:, None]
    line = np.where(is_trunk, along * fork, fork + along * (middles[branch] - fork))
    round_ = _unit(rng.normal(size=(BARK, 3)) * (1, 1, 0.2))
    bark = line + round_ * np.where(is_trunk, 0.13 - 0.05 * along, 0.05 - 0.035 * along)
    brown = np.array([0.34, 0.24, 0.16]) * (0.6 + 0.5 * rng.random((BARK, 1)))
    scales = np.concatenate(
        [np.tile([0.026, 0.013, 0.001], (LEAVES, 1)), np.tile([0.02, 0.02, 0.002], (BARK, 1))]
    ) * rng.uniform(0.6, 1.3, (LEAVES + BARK, 1))
    return ibr.Gaussians(
        np.concatenate([leaves, bark]),
        scales,
        _turned_to(np.concatenate([_unit(out + rng.normal(0, 0.7, out.shape)), round_])),
        np.concatenate([rng.uniform(0.6, 0.98, LEAVES), np.full(BARK, 0.95)]),
        colors=np.concatenate([green, brown]).clip(0, 1).astype(np.float32),
    )


def floor() -> ibr.Mesh:
    """Return a floor with a texture of tiles."""
    y, x = np.mgrid[:256, :256] // 32
    tiles = np.where((x + y)[..., None] % 2, (206, 200, 186), (180, 172, 156)).astype(np.uint8)
    flat = quad((-3, -2.4, 0), (6, 0, 0), (0, 4.2, 0))
    return ibr.Mesh(flat.vertices, flat.faces, uv=flat.uv, texture=tiles)


def wall() -> ibr.ReliefSurface:
    """Return a wall of bricks, behind the tree."""
    return ibr.ReliefSurface(quad((-3, 1.8, 0), (6, 0, 0), (0, 0, 3)), *bricks(), 0.12, tiles=(5, 3))


def pillar() -> ibr.Mesh:
    """Return a thin pillar, whose shadow falls on the tree."""
    a = np.linspace(0, 2 * np.pi, 33)
    ring = np.stack([0.14 * np.cos(a) - 1.25, 0.14 * np.sin(a) - 0.75], axis=1)
    points = np.concatenate([np.column_stack([ring, np.full(33, z)]) for z in (0.0, 3.4)])
    i = np.arange(32)
    faces = np.concatenate([np.stack([i, i + 1, i + 34], 1), np.stack([i, i + 34, i + 33], 1)])
    return ibr.Mesh(points, faces, colors=np.tile(np.array([[222, 190, 120]], np.uint8), (66, 1)))


def knot_image() -> ibr.WarpedView:
    """Return a depth image of a knot that stands on the floor at the right."""
    scene, camera = knot(), ibr.Camera.look_at((0.6, -9, 3.4), (0, 0, 0), (0, 0, 1), (420, 420), fov_y=42)
    image = scene.capture(camera)
    smaller, pose = 0.2, camera.world_from_camera.copy()
    pose[:3, 3] = smaller * pose[:3, 3] + (1.75, -0.6, 0.78)
    placed = ibr.Camera(camera.K, camera.size, pose)
    return ibr.WarpedView(ibr.DepthImage(image.color, image.depth * np.float32(smaller), placed))


def together() -> Figure:
    """Draw the tree alone, in one picture with everything else, and its depth there."""
    alone = ibr.render(tree(), CAMERA, background=WHITE)
    others = [floor(), wall(), pillar(), knot_image()]
    frame = ibr.render([tree(), *others], CAMERA, SUN, background=WHITE, samples=4)
    depth = plt.get_cmap("viridis")((8.2 - frame.depth) / 4.6)[..., :3]
    figure, row = plt.subplots(1, 3, figsize=(14, 3.45), layout="constrained")
    show(row[0], alone.color, f"{len(tree()):,} Gaussians")
    show(row[1], frame.color, "with meshes, a relief and a depth image")
    show(row[2], np.where(frame.valid[..., None], depth, 1), "depth of this picture")
    return figure


def made_of() -> Figure:
    """Draw things made of the tree: a depth image, an object, and a picture for two eyes."""
    image = capture(tree(), CAMERA, background=WHITE)
    solid = ibr.DepthObject(object_views(tree(), 512, margin=0.1))
    turned = CAMERA.orbited(12, (0, 0, 1.25))
    warped = ibr.render([image, floor(), wall()], turned, SUN, background=WHITE, samples=4)
    drawn = ibr.render([solid, floor()], turned, SUN, background=WHITE, samples=4)
    eyes = ibr.stereo([tree(), floor(), wall()], CAMERA, layout="dubois", background=WHITE, samples=4)
    panels = {
        "a depth image, from 12 degrees to its side": warped.color,
        "an object of six depth images, with its shadow": drawn.color,
        "a picture for red and cyan glasses": eyes,
    }
    figure, row = plt.subplots(1, 3, figsize=(14, 3.45), layout="constrained")
    for axes, (name, picture) in zip(row, panels.items(), strict=True):
        show(axes, picture, name)
    return figure


def biker(scene: ibr.Gaussians) -> Figure:
    """Draw a scene of photographs on a floor, with its shadow; its depth; and an object made of it.

    The scene is `biker` of playcanvas/engine, examples/assets/splats; -y is up.
    """
    low, high = scene.bounds
    middle, tall = 0.5 * (low + high), float(high[1] - low[1])
    side, ground = 1.6 * tall, high[1]
    flat = quad((-side, ground, -side), (2 * side, 0, 0), (0, 0, 2 * side))
    below = ibr.Mesh(flat.vertices, flat.faces, colors=np.full((4, 3), 214, np.uint8))
    lamp = ibr.Light(direction=(-0.2, 1, 0.8), ambient=0.45, shadow_size=2048)
    eye = middle + tall * np.array([1.4, -0.35, 0.35])
    camera = ibr.Camera.look_at(eye, middle, (0, -1, 0), (420, 440), fov_y=46)
    frame = ibr.render([scene, below], camera, lamp, background=WHITE, samples=4)
    alone = ibr.render(scene, camera)
    away = np.linalg.norm(eye - middle)
    depth = plt.get_cmap("viridis")((away + 0.25 * tall - alone.depth) / (0.5 * tall))[..., :3]
    solid = ibr.DepthObject(object_views(scene, 512, margin=0.1))
    figure, row = plt.subplots(1, 3, figsize=(12, 4.4), layout="constrained")
    show(row[0], frame.color, f"{len(scene):,} Gaussians on a mesh")
    show(row[1], np.where(alone.valid[..., None], depth, 1), "their depth")
    show(row[2], ibr.render([solid, below], camera, lamp, background=WHITE, samples=4).color, "an object made of them")
    return figure


def choice() -> NDArray[np.uint8]:
    """Return a small picture of the tree with its shadow, for the choice of a method."""
    camera = ibr.Camera.look_at((1.1, -6.0, 2.4), (0, 0, 1.3), (0, 0, 1), (320, 240), fov_y=32)
    return np.asarray(ibr.render([tree(), floor()], camera, SUN, background=WHITE, samples=4).color, np.uint8)
