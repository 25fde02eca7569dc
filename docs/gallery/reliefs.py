"""Pictures of relief mapping, made by pictures.py."""

from __future__ import annotations

import cv2
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

import pyibr as ibr
from pyibr.capture import models
from pyibr.relief.surface import Shadow

WHITE = (255, 255, 255)


def noise(seed: int, sigma: float, n: int = 256) -> np.ndarray:
    """Return smooth noise (n, n) from 0 to 1 that tiles."""
    rough = np.pad(np.random.default_rng(seed).random((n, n)).astype(np.float32), 64, mode="wrap")
    smooth = cv2.GaussianBlur(rough, (0, 0), sigma)[64:-64, 64:-64]
    return (smooth - smooth.min()) / np.ptp(smooth)


def bricks() -> tuple[np.ndarray, np.ndarray]:
    """Return height and colour of a wall of rough bricks."""
    y, x = np.mgrid[:256, :256]
    shifted = (x + 32 * (y // 32 % 2)) % 64
    joint = np.minimum(np.minimum(shifted, 63 - shifted), np.minimum(y % 32, 31 - y % 32))
    number = (x + 32 * (y // 32 % 2)) // 64 % 4 + 4 * (y // 32)
    shade = np.random.default_rng(5).random(64)[number % 64]
    height = np.clip(joint / 7, 0, 1) * (0.62 + 0.22 * shade + 0.16 * noise(1, 2.5)) + 0.04 * noise(2, 1)
    tint = np.array([168, 92, 66]) + np.array([34, 20, 14]) * (2 * shade[..., None] - 1)
    mortar = np.array([172, 166, 154]) * (0.85 + 0.2 * noise(4, 1.2)[..., None])
    color = np.where((joint > 3)[..., None], tint * (0.75 + 0.35 * noise(3, 2)[..., None]), mortar)
    return (255 * height.clip(0, 1)).astype(np.uint8), color.clip(0, 255).astype(np.uint8)


def stones() -> tuple[np.ndarray, np.ndarray]:
    """Return height and colour of rounded stones that lie side by side."""
    rng = np.random.default_rng(8)
    centers = rng.random((46, 2)) * 256
    shifts = np.array([(i, j) for i in (-256, 0, 256) for j in (-256, 0, 256)])
    points = (centers[:, None] + shifts).reshape(-1, 2)
    y, x = np.mgrid[:256, :256]
    away = np.sort(np.hypot(y[..., None] - points[:, 0], x[..., None] - points[:, 1]), axis=-1)
    owner = np.argmin(np.hypot(y[..., None] - points[:, 0], x[..., None] - points[:, 1]), axis=-1) // 9
    gap = away[..., 1] - away[..., 0]
    height = np.sqrt(np.clip(gap / 26, 0, 1)) * (0.75 + 0.25 * noise(11, 5))
    tint = rng.random(46)[owner][..., None]
    color = (np.array([116, 120, 118]) + np.array([46, 40, 30]) * (tint - 0.5) * 2) * (0.45 + 0.55 * height[..., None])
    return (255 * height.clip(0, 1)).astype(np.uint8), color.clip(0, 255).astype(np.uint8)


def tube(sides: int, length: float = 2.4, radius: float = 1.0) -> ibr.Mesh:
    """Return an open cylinder about the z axis."""
    u, v = np.meshgrid(np.linspace(0, 1, sides + 1), np.linspace(0, 1, 9))
    a = 2 * np.pi * u
    normals = np.stack([np.cos(a), np.sin(a), 0 * a], axis=-1)
    points = radius * normals + (length * (v - 0.5))[..., None] * np.array([0, 0, 1.0])
    i = (np.arange(8)[:, None] * (sides + 1) + np.arange(sides)).ravel()
    faces = np.concatenate([np.stack([i, i + 1, i + sides + 2], 1), np.stack([i, i + sides + 2, i + sides + 1], 1)])
    return ibr.Mesh(
        points.reshape(-1, 3), faces, uv=np.stack([u, -v], -1).reshape(-1, 2), normals=normals.reshape(-1, 3)
    )


def quad(corner: tuple, along: tuple, up: tuple) -> ibr.Mesh:
    """Return a parallelogram with uv along its sides."""
    a, b, c = (np.array(p, float) for p in (corner, along, up))
    return ibr.Mesh([a, a + b, a + b + c, a + c], [[0, 1, 2], [0, 2, 3]], uv=[[0, 1], [1, 1], [1, 0], [0, 0]])


def show(axes: Axes, image: np.ndarray, title: str) -> None:
    axes.imshow(image)
    axes.set_title(title, loc="left", fontsize=12, color="#222222")
    axes.set_axis_off()


def wires(axes: Axes, mesh: ibr.Mesh, camera: ibr.Camera) -> None:
    """Draw the edges of the triangles that face the camera."""
    pixel, _ = camera.project(mesh.vertices)
    corner = mesh.vertices[mesh.faces].astype(float)
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    front = mesh.faces[((camera.center - corner[:, 0]) * normal).sum(axis=1) > 0]
    lines = np.concatenate([pixel[front[:, [i, (i + 1) % 3]]] for i in range(3)])
    limits = axes.get_xlim(), axes.get_ylim()
    axes.add_collection(LineCollection(list(lines), colors="#1f6fb4", linewidths=0.35))
    axes.set(xlim=limits[0], ylim=limits[1])


def silhouettes() -> Figure:
    """Draw a torus and a tube in relief: with the mesh's outline, with the relief's, and with the mesh over it."""
    size, up = (620, 440), (0, 0, 1)
    figure, grid = plt.subplots(2, 3, figsize=(13.5, 6.6), layout="constrained")
    camera = ibr.Camera.look_at((1.3, -2.2, 1.7), (0, 0, -0.05), up, size, fov_y=42)
    outlines(grid[0], models.donut(32), (10, 4), 0.09, camera)
    outlines(grid[1], tube(24), (7, 3), 0.12, ibr.Camera.look_at((2.0, -4.0, 0.6), (0, 0, 0), up, size, fov_y=42))
    return figure


def teapot(mesh: ibr.Mesh) -> Figure:
    """Draw a teapot in relief, as in the paper's figure 9."""
    figure, row = plt.subplots(1, 3, figsize=(13.5, 2.9), layout="constrained")
    low, high = (np.asarray(corner, np.float64) for corner in mesh.bounds)
    middle, extent = 0.5 * (low + high), float(np.linalg.norm(high - low))
    away = extent * np.array([0.35, 0.55, 1.0])
    camera = ibr.Camera.look_at(middle + away, middle, (0, 1, 0), (620, 360), fov_y=27)
    outlines(row, models.with_cylindrical_uv(mesh, axis=1), (12, 5), 0.02 * extent, camera)
    return figure


def outlines(row: np.ndarray, mesh: ibr.Mesh, tiles: tuple[int, int], scale: float, camera: ibr.Camera) -> None:
    """Draw a mesh in a relief of bricks: with the mesh's outline, with the relief's, and with the mesh over it."""
    turn = camera.world_from_camera[:3, :3]
    light = ibr.Light(direction=turn @ (0.45, 0.45, 0.8), color=(1.4, 1.35, 1.25))
    frames = {}
    for silhouette in ("none", "quadric"):
        thing = ibr.ReliefSurface(mesh, *bricks(), scale, tiles=tiles, silhouette=silhouette)
        frames[silhouette] = ibr.render(thing, camera, light, background=WHITE, samples=4).color
    show(row[0], frames["none"], 'silhouette="none"')
    show(row[1], frames["quadric"], 'silhouette="quadric"')
    show(row[2], frames["quadric"], "the mesh over it")
    wires(row[2], mesh, camera)


def texture() -> Figure:
    """Draw the inputs of a relief (heights, their normals, colours), and the relief."""
    height, color = stones()
    rise = 0.09 * height.astype(float) / 255  # in scene units, for a tile one unit wide
    across, down = (np.roll(rise, -1, axis) - np.roll(rise, 1, axis) for axis in (1, 0))
    normals = np.dstack([-across, down, np.full_like(rise, 2 / 256)])
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    thing = ibr.ReliefSurface(quad((-1, -1, 0), (2, 0, 0), (0, 2, 0)), height, color, 0.18, shadow="search")
    camera = ibr.Camera.look_at((0.5, -2.2, 1.6), (0, -0.08, -0.1), (0, 0, 1), (420, 300), fov_y=38)
    light = ibr.Light(direction=(0.8, 0.3, -0.7), color=(2.4, 2.3, 2.1))
    figure, row = plt.subplots(1, 4, figsize=(13, 3.1), layout="constrained", width_ratios=(1, 1, 1, 1.4))
    show(row[0], np.repeat(height[..., None], 3, axis=2), "heights")
    show(row[1], (127.5 * (normals + 1)).astype(np.uint8), "normals, from the heights")
    show(row[2], color, "colours")
    show(row[3], ibr.render(thing, camera, light, background=WHITE, samples=4).color, "the relief")
    return figure


def shadows() -> Figure:
    """Draw a relief's shadows on itself by both methods, and a mesh and reliefs that cast shadows on one another."""
    (height, color), stone = bricks(), stones()
    floor = quad((-2, -2, 0), (4, 0, 0), (0, 4, 0))
    view = ibr.Camera.look_at((0.6, -1.6, 1.5), (0, -0.2, 0), (0, 0, 1), (430, 330), fov_y=40)
    figure, row = plt.subplots(1, 4, figsize=(13, 2.8), layout="constrained")
    kinds: dict[str, tuple[Shadow, int]] = {
        "without shadows": ("map", 0),
        "by the light's map": ("map", 1024),
        "each point's own ray": ("search", 1024),
    }
    for axes, (name, (shadow, texels)) in zip(row[:3], kinds.items(), strict=True):
        light = ibr.Light(direction=(0.85, 0.3, -0.5), color=(1.6, 1.5, 1.4), shadow_size=texels)
        relief = ibr.ReliefSurface(floor, height, color, 0.12, tiles=(2, 3), shadow=shadow)
        show(axes, ibr.render(relief, view, light, background=WHITE, samples=4).color, name)
    ring = models.donut(48, radius=0.5, tube=0.18)
    upright = ring.vertices[:, [0, 2, 1]] * (1, -1, 1) + np.array([-0.25, -0.1, 0.66])
    things = [
        ibr.ReliefSurface(floor, *stone, 0.14, tiles=(3, 3)),
        ibr.Mesh(upright, ring.faces, colors=np.full((len(upright), 3), (196, 150, 60), np.uint8)),
        ibr.ReliefSurface(_post((0.75, 0.5, 0.7)), height, color, 0.05, tiles=(3, 4)),
    ]
    light = ibr.Light(direction=(0.7, 0.55, -0.75), color=(1.8, 1.7, 1.6), shadow_size=2048)
    view = ibr.Camera.look_at((0.9, -2.6, 1.9), (0.05, 0.1, 0.35), (0, 0, 1), (430, 330), fov_y=44)
    show(
        row[3], ibr.render(things, view, light, background=WHITE, samples=4).color, "mesh and reliefs shade one another"
    )
    return figure


def _post(middle: tuple[float, float, float]) -> ibr.Mesh:
    column = tube(32, 1.4, 0.24)
    return ibr.Mesh(column.vertices + np.array(middle), column.faces, uv=column.uv, normals=column.normals)


def distances() -> Figure:
    """Draw a relief by the paper's two distances, the difference of both pictures, and the relief by exact ones."""
    height, color = bricks()
    camera = ibr.Camera.look_at((1.6, -3.2, 0.5), (0, 0, 0), (0, 0, 1), (520, 400), fov_y=44)
    light = ibr.Light(direction=(0.5, 0.8, -0.9), color=(1.4, 1.35, 1.25))
    pictures: dict[str, np.ndarray] = {}
    for distance in ("perpendicular", "approximate", "exact"):
        search = "linear" if distance == "perpendicular" else "safe"
        relief = ibr.ReliefSurface(tube(24), height, color, 0.15, tiles=(7, 3), distance=distance, search=search)
        pictures[distance] = ibr.render(relief, camera, light, background=WHITE, samples=4).color
    off = np.abs(pictures["perpendicular"].astype(int) - pictures["approximate"]).max(axis=2)
    figure, row = plt.subplots(1, 4, figsize=(17.5, 3.6), layout="constrained")
    show(row[0], pictures["perpendicular"], 'distance="perpendicular"')
    show(row[1], pictures["approximate"], 'distance="approximate"')
    show(row[2], 255 - np.repeat(off[..., None], 3, axis=2).astype(np.uint8), "their difference")
    show(row[3], pictures["exact"], 'distance="exact"')
    return figure


def scenes() -> Figure:
    """Draw two reliefs that intersect, a saddle, a torus with three numbers of tiles, and a room with shadows."""
    brick, stone = bricks(), stones()
    light = ibr.Light(direction=(0.5, 0.8, -0.9), color=(1.4, 1.35, 1.25))
    figure, grid = plt.subplots(2, 2, figsize=(13, 9.6), layout="constrained")
    camera = ibr.Camera.look_at((1.6, -3.2, 0.8), (0, 0, 0), (0, 0, 1), (620, 440), fov_y=42)
    both = [
        ibr.ReliefSurface(tube(32), *brick, 0.13, tiles=(6, 3)),
        ibr.ReliefSurface(tube(32), *stone, 0.13, tiles=(5, 2)),
    ]
    frame = ibr.render(both, camera, light, background=WHITE, samples=4)
    show(grid[0, 0], frame.color, "two coincident cylinders of different materials")
    camera = ibr.Camera.look_at((0.75, -1.1, 0.75), (0.25, -0.55, 0.12), (0, 0, 1), (620, 440), fov_y=44)
    saddle = ibr.ReliefSurface(models.donut(48), *stone, 0.07, tiles=(8, 3))
    show(grid[0, 1], ibr.render(saddle, camera, light, background=WHITE, samples=4).color, "the saddle inside a torus")
    row = []
    for tiles in ((4, 2), (8, 3), (16, 6)):
        torus = ibr.ReliefSurface(models.donut(48), *stone, 0.28 / tiles[1], tiles=tiles)
        view = ibr.Camera.look_at((0.7, -2.3, 2.6), (0, 0, 0), (0, 0, 1), (300, 440), fov_y=62)
        row.append(ibr.render(torus, view, light, background=WHITE, samples=4).color)
    show(grid[1, 0], np.hstack(row), "one torus with more and more tiles")
    show(grid[1, 1], room((620, 440)), "walls, floor, columns and a torus, with shadows")
    return figure


def room(size: tuple[int, int]) -> np.ndarray:
    """Render a corner of a room in which everything is a relief, lit by one spot light."""
    brick, stone = bricks(), stones()
    things = [
        ibr.ReliefSurface(quad((-3, 2.2, 0), (6, 0, 0), (0, 0, 3)), *brick, 0.12, tiles=(5, 3)),
        ibr.ReliefSurface(quad((-3, -3, 0), (0, 5.2, 0), (0, 0, 3)), *brick, 0.12, tiles=(5, 3)),
        ibr.ReliefSurface(quad((-3, -3, 0), (6, 0, 0), (0, 5.2, 0)), *stone, 0.10, tiles=(4, 4)),
    ]
    for x, y in ((-1.9, 1.2), (0.1, 1.2), (2.1, 1.2)):
        column = tube(32, 3.0, 0.32)
        moved = ibr.Mesh(column.vertices + np.array([x, y, 1.5]), column.faces, uv=column.uv, normals=column.normals)
        things.append(ibr.ReliefSurface(moved, *brick, 0.05, tiles=(3, 4)))
    ring = models.donut(40, radius=0.62, tube=0.26)
    lying = ibr.Mesh(ring.vertices + np.array([0.5, -0.9, 0.24]), ring.faces, uv=ring.uv, normals=ring.normals)
    things.append(ibr.ReliefSurface(lying, *stone, 0.06, tiles=(7, 3)))
    camera = ibr.Camera.look_at((2.7, -4.4, 2.1), (-0.2, 0.2, 0.9), (0, 0, 1), size, fov_y=48)
    light = ibr.Light(
        position=(2.6, -3.6, 4.4), direction=(-2.6, 3.9, -3.9), angle=75, color=(1.5, 1.4, 1.25), shadow_size=2048
    )
    return ibr.render(things, camera, light, samples=4).color
