"""A furnished room as a photograph with depth, and the views made of it, for the manual's first pages."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import matplotlib.pyplot as plt
import numpy as np
from epipolar import bare
from matplotlib.figure import Figure
from objects import knot as knot_scene
from objects import knot_surface, twelve_views
from reliefs import bricks, noise

import pyibr as ibr
from pyibr.capture import models

FLOOR, CEILING, BACK, SIDE = 1.25, -1.35, 4.6, 2.3  # distances from the camera, in metres
SPINES = [(140, 40, 36), (34, 74, 96), (196, 160, 84), (70, 96, 62), (226, 214, 190), (66, 50, 74)]
BOWL = [(0, 0), (0.07, 0), (0.075, 0.02), (0.04, 0.06), (0.1, 0.16), (0.15, 0.22), (0.14, 0.22), (0.03, 0.09)]
VASE = [(0, 0), (0.06, 0), (0.09, 0.08), (0.085, 0.16), (0.04, 0.25), (0.035, 0.3), (0.055, 0.34)]
BALL = [(0.16 * np.sin(a), 0.16 - 0.16 * np.cos(a)) for a in np.linspace(0, np.pi, 24)]
LAMP = [(0.17, 0), (0.17, 0.02), (0.02, 0.04), (0.015, 1.35), (0.2, 1.35), (0.12, 1.62), (0, 1.62)]
"""Profiles of turned objects: pairs of radius and height in metres."""
LIGHT = ibr.Light(direction=(0.8, 0.5, 0.55), color=(1.75, 1.66, 1.52), ambient=0.55, shadow_size=2048)
CAMERA = ibr.Camera([[600, 0, 319.5], [0, 600, 239.5], [0, 0, 1]], (640, 480))


def box(low: Sequence[float], high: Sequence[float], texture: np.ndarray, repeats: float = 1.0) -> ibr.Mesh:
    """Return a box along the axes; `repeats` is the number of repetitions of the texture per metre."""
    corners = np.array([[low, high]]).reshape(2, 3)
    vertices, uv, faces = [], [], []
    for axis in range(3):
        a, b = (axis + 1) % 3, (axis + 2) % 3
        if axis != 1:
            a, b = sorted((a, b), key=lambda k: k == 1)  # v of the texture is along y
        for side in range(2):
            for i, j in ((0, 0), (1, 0), (1, 1), (0, 1)):
                vertex = corners[side].copy()
                vertex[a], vertex[b] = corners[i, a], corners[j, b]
                vertices.append(vertex)
                uv.append(((vertex[a] - corners[0, a]) * repeats, (vertex[b] - corners[0, b]) * repeats))
            first = len(vertices) - 4
            faces += [(first, first + 1, first + 2), (first, first + 2, first + 3)]
    return ibr.Mesh(vertices, faces, uv=uv, texture=texture)


def plain(*color: int) -> np.ndarray:
    """Return a texture of one colour."""
    return np.full((4, 4, 3), color, np.uint8)


def planks() -> np.ndarray:
    """Return a texture of wooden planks, two across its width."""
    y, x = np.mgrid[:256, :256]
    grain = noise(21, 1.0)[y, (x // 9 + 57 * (y // 64)) % 256]
    tint = np.random.default_rng(4).random(8)[y // 64 * 2 + (x > 128 * (y // 64 % 2))][..., None]
    color = np.array([152, 104, 66]) * (0.78 + 0.22 * grain[..., None] + 0.16 * tint)
    color[(y % 64 < 2) | (np.abs(x - 128 * (y // 64 % 2)) < 2)] *= 0.55
    return color.clip(0, 255).astype(np.uint8)


def wallpaper() -> np.ndarray:
    """Return a texture of stripes with a small pattern."""
    y, x = np.mgrid[:128, :128]
    color = np.where((x // 16 % 2)[..., None] > 0, (214, 205, 182), (203, 192, 166)).astype(float)
    color[np.hypot(x % 32 - 8, y % 32 - 16) < 4] = (168, 146, 116)
    return color.astype(np.uint8)


def rug() -> np.ndarray:
    """Return a texture of diamonds within a border."""
    y, x = np.mgrid[:256, :256]
    wave = (np.abs((x % 64) - 32) + np.abs((y % 64) - 32)) // 8 % 4
    color = np.array([(146, 42, 44), (222, 196, 148), (38, 58, 92), (176, 72, 52)])[wave]
    edge = np.minimum(np.minimum(x, 255 - x), np.minimum(y, 255 - y))
    color[(edge < 20) & (edge > 8)] = (222, 196, 148)
    color[edge <= 8] = (92, 26, 30)
    return (color * (0.85 + 0.3 * noise(7, 0.8)[..., None])).clip(0, 255).astype(np.uint8)


def painting() -> np.ndarray:
    """Return a picture of hills under an evening sky."""
    y, x = np.mgrid[:192, :256]
    sky = np.linspace(0, 1, 192)[:, None, None]
    color = (1 - sky) * np.array([64, 96, 152]) + sky * np.array([250, 188, 120]) + 0.0 * x[..., None]
    color[np.hypot(x - 176, y - 88) < 17] = (255, 236, 190)
    for k in range(4):
        top = 100 + 20 * k + 14 * np.sin(x / (38 - 6 * k) + 2 * k) + 10 * noise(30 + k, 9)[:192]
        color[y > top] = np.array([70, 98, 104]) * (1 - 0.2 * k) + np.array([20, 26, 6]) * k
    return color.clip(0, 255).astype(np.uint8)


def turned(
    profile: Sequence[tuple[float, float]], at: Sequence[float], color: Sequence[int], sides: int = 48
) -> ibr.Mesh:
    """Return a turned object at a place; its profile lists radii and heights from the foot upwards."""
    radius, height = np.array(profile).T
    a = np.linspace(0, 2 * np.pi, sides + 1)
    ring = np.stack([radius[:, None] * np.cos(a), -height[:, None] + 0 * a, radius[:, None] * np.sin(a)], axis=-1)
    i, j = np.meshgrid(np.arange(len(radius) - 1), np.arange(sides), indexing="ij")
    first = (i * (sides + 1) + j).ravel()
    below, beside = first + sides + 1, first + 1
    upper, lower = np.stack([first, beside, below + 1], 1), np.stack([first, below + 1, below], 1)
    faces = np.concatenate([upper, lower])
    vertices = ring.reshape(-1, 3) + np.asarray(at)
    colors = np.tile(np.array(color, np.uint8), (len(vertices), 1))
    return ibr.Mesh(vertices, faces, colors=colors)


def shelf() -> list[ibr.Mesh]:
    """Return books on shelves at the right of the back wall."""
    random, wood = np.random.default_rng(12), planks()
    left, front, things = 0.75, BACK - 0.34, list[ibr.Mesh]()
    for level in range(5):
        y = FLOOR - 0.06 - 0.44 * level
        things.append(box((left, y, front), (left + 1.2, y + 0.03, BACK), wood, 1.5))
        x = left + 0.05
        while level < 4 and x < left + 1.1:
            width, tall, deep = random.uniform((0.025, 0.24, 0.17), (0.06, 0.36, 0.24))
            shade = random.choice(
                [(140, 40, 36), (34, 74, 96), (196, 160, 84), (70, 96, 62), (226, 214, 190), (66, 50, 74)]
            )
            if random.random() < 0.9:
                things.append(box((x, y - tall, BACK - 0.05 - deep), (x + width, y, BACK - 0.04), plain(*shade)))
            x += width + 0.004
    sides = [box((x, FLOOR - 1.86, front), (x + 0.03, FLOOR, BACK), wood, 1.5) for x in (left - 0.03, left + 1.2)]
    return things + sides


@cache
def room() -> tuple[ibr.Mesh, ...]:
    """Return all objects of the room."""
    wood, dark = planks(), (planks() * 0.55).astype(np.uint8)
    wall, brick = wallpaper(), bricks()[1]
    things = [
        box((-SIDE, FLOOR, -1), (SIDE, FLOOR + 0.1, BACK), wood, 0.9),
        box((-SIDE, CEILING, BACK), (SIDE, FLOOR, BACK + 0.1), wall, 1.6),
        box((SIDE, CEILING, -1), (SIDE + 0.1, FLOOR, BACK), wall, 1.6),
        box((-SIDE - 0.1, CEILING, 3.6), (-SIDE, FLOOR, BACK), brick, 1.2),
        box((-SIDE, CEILING - 0.1, -1), (SIDE, CEILING, BACK), plain(238, 234, 226)),
        box((-SIDE, FLOOR - 0.1, BACK - 0.03), (SIDE, FLOOR, BACK), plain(236, 232, 222)),
        box((-1.5, FLOOR - 0.012, 2.0), (0.9, FLOOR, 3.9), rug(), 1 / 1.2),
        box((-1.72, -0.72, BACK - 0.05), (-0.38, 0.28, BACK), dark, 3.0),
        box((-1.65, -0.65, BACK - 0.055), (-0.45, 0.21, BACK - 0.04), painting(), 1 / 1.2),
        box((-0.95, 0.42, 2.35), (0.45, 0.47, 3.15), wood, 1.4),
    ]
    things += [box((x, 0.47, z), (x + 0.07, FLOOR, z + 0.07), dark, 3.0) for x in (-0.9, 0.33) for z in (2.4, 3.03)]
    things += shelf()
    things += [
        turned(BOWL, (-0.55, 0.42, 2.7), (62, 108, 142)),
        turned(VASE, (0.2, 0.42, 2.85), (188, 92, 58)),
        turned(BALL, (0.95, FLOOR, 2.5), (222, 120, 46)),
        turned(LAMP, (-1.75, FLOOR, 3.9), (232, 214, 170)),
    ]
    vertices, faces, colors = knot_surface(lit=False)
    turn = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0.0]])
    things.append(ibr.Mesh(0.055 * vertices @ turn.T + (-0.12, 0.25, 2.65), faces, colors=colors))
    return tuple(things)


@cache
def photograph() -> ibr.DepthImage:
    """Render the room as a photograph with depth, as a depth camera or a network would give it."""
    seen = ibr.render(list(room()), CAMERA, LIGHT, samples=4)
    depth = ibr.render(list(room()), CAMERA).depth
    return ibr.DepthImage(seen.color, depth, CAMERA)


def first_page() -> Figure:
    """Draw a photograph, its depth, a new view, and the same view with its holes filled."""
    view = photograph()
    aside = CAMERA.moved(0.25, -0.08, 0.1)
    layer = ibr.background_layer(view, aside, fill="exemplar")
    new = ibr.warp(view, aside, samples=4)
    filled = ibr.warp([view, layer], aside, fill="background", samples=4)
    hidden = np.where(new.valid[..., None], new.color, (255, 64, 160))
    near = plt.get_cmap("turbo")((1 / view.depth - 1 / BACK) / (1 / 2.2 - 1 / BACK))
    panels = {
        "a picture": view.color,
        "its depth": near,
        "from a quarter of a metre to the right": hidden,
        "the same view, holes filled": filled.color,
    }
    figure, rows = plt.subplots(2, 2, figsize=(12.8, 9.9), layout="constrained")
    for axes, (name, image) in zip(rows.ravel(), panels.items(), strict=True):
        bare(axes).imshow(image)
        axes.set_title(name, loc="left", fontsize=14)
    return figure


def film_strip() -> Figure:
    """Draw a part of some frames of a film, with the holes filled in three ways, and the same part rendered."""
    view, part = photograph(), np.s_[225:425, 250:460]
    path = [CAMERA.moved(0.06 * k, 0, 0) for k in range(1, 6)]
    layers = [ibr.background_layer(view, path, fill=fill) for fill in ("background", "exemplar")]
    rows = {
        "each frame filled for itself": ibr.warp(view, path, fill="background"),
        "one layer of background": ibr.warp([view, layers[0]], path, fill="background"),
        "the same, with exemplars": ibr.warp([view, layers[1]], path, fill="background"),
        "the room from there": [ibr.render(list(room()), camera, LIGHT, samples=4) for camera in path],
    }
    figure, grid = plt.subplots(len(rows), len(path), figsize=(13, 10.6), layout="constrained")
    for row, (name, frames) in zip(grid, rows.items(), strict=True):
        for axes, frame in zip(row, frames, strict=True):
            bare(axes).imshow(frame.color[part])
        row[0].set_title(name, loc="left", fontsize=14)
    return figure


def choices() -> dict[str, np.ndarray]:
    """Return a small picture of each method, by the method's name."""
    size, view = (320, 240), photograph()
    small = CAMERA.resized(size)
    right = ibr.warp(view, CAMERA.moved(0.3, 0, 0))
    second = ibr.DepthImage(right.color, right.depth, right.camera)
    base, way = models.donut(64), (1.4, -2.3, 1.9)
    height, color = bricks()
    around = ibr.Camera.look_at(way, (0, 0, 0), (0, 0, 1), size, fov_y=42)
    sun = ibr.Light(direction=(-0.6, 0.8, -0.9), ambient=0.35)
    knot = twelve_views(knot_scene(), 192)
    beside = ibr.Camera.look_at((9, 5, 7), (0, 0, 0), (0, 0, 1), size, fov_y=34)
    thick = {"scale": 0.12, "tiles": (12, 5)}
    near = small.moved(0.15, -0.05, 0.3)
    filled = {"fill": "background", "samples": 4}
    on_paper = {"background": (255, 255, 255), "samples": 4}
    return {
        "warp": ibr.warp(view, near, **filled).color,
        "blend": ibr.warp([view, second], near, **filled).color,
        "slices": ibr.render(ibr.SlicedSurface(base, height, color, **thick), around, sun, **on_paper).color,
        "relief": ibr.render(ibr.ReliefSurface(base, height, color, **thick), around, sun, **on_paper).color,
        "object": ibr.render(ibr.DepthObject(knot), beside, **on_paper).color,
        "hull": ibr.render(ibr.VisualHull(knot), beside, **on_paper).color,
        "mesh": ibr.render(ibr.DepthMesh(view), near, **on_paper).color,
        "mesh-object": ibr.render(ibr.DepthMeshObject(knot), beside, **on_paper).color,
    }
