"""Pictures of slices, made by pictures.py."""

from __future__ import annotations

import cv2
import matplotlib.pyplot as plt
import numpy as np
from demo import HOLE, INK
from epipolar import BLUE, ORANGE, bare
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from objects import knot
from terrain import height_field

import pyibr as ibr
from pyibr.capture import models, object_views
from pyibr.slicing.prisms import extruded

GREEN = "#3c8d4f"
SOLID = "#dfe7ee"
UNIT = ibr.Mesh(
    [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]], uv=[[0, 0], [1, 0], [1, 1], [0, 1]]
)


def slicing_directions() -> Figure:
    """Draw a height map from above and from the side, by each of the three kinds of slices."""
    y, x = np.mgrid[:128, :128] / 128
    hills = np.sin(4 * np.pi * x) * np.cos(2 * np.pi * y) + 0.7 * np.sin(9 * np.pi * x + 5 * y)
    height = (0.5 + 0.26 * hills).clip(0.04, 1).astype(np.float32)
    checks = ((x * 8).astype(int) + (y * 8).astype(int) & 1)[..., None]
    color = (np.stack([90 + 150 * x, 110 + 100 * y, 235 - 120 * x], axis=-1) - 35 * checks).astype(np.uint8)
    corners, uv = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 0], [1, 0], [1, 1], [0, 1]]
    square = ibr.Mesh(corners, [[0, 1, 2], [0, 2, 3]], uv=uv)
    light = ibr.Light(direction=(0.6, 0.3, -1))
    figure, grid = plt.subplots(2, 3, figsize=(13, 5.6), layout="constrained")
    for row, elevation, slices in ((0, 50, 16), (1, 4, 16)):
        angle = np.radians(elevation)
        eye = np.array([0.5, 0.5, 0.1]) + 2.1 * np.array([0.5 * np.cos(angle), -0.87 * np.cos(angle), np.sin(angle)])
        camera = ibr.Camera.look_at(
            eye, (0.5, 0.5, 0.1), (0, 0, 1), (640, 300 if row else 400), fov_y=26 if row else 36
        )
        for axes, slicing in zip(grid[row], ("surface", "orthogonal", "screen"), strict=True):
            thing = ibr.SlicedSurface(square, height, color, 0.22, slices=slices, slicing=slicing)
            bare(axes).imshow(ibr.render(thing, camera, light, background=(255, 255, 255), samples=4).color)
            axes.set_title(f'slicing="{slicing}", {slices} slices', loc="left", fontsize=12, color=INK)
    return figure


def three_directions() -> Figure:
    """Draw a height map by 64 slices from three views: in each, another slicing direction faces the viewer most."""
    y, x = np.mgrid[:128, :128] / 128
    waves = 0.6 * np.sin(9.4 * np.hypot(x - 0.4, y - 0.55) * 2) + 0.4 * np.sin(12.6 * x) * np.sin(18.8 * y)
    height = (0.5 + 0.45 * waves).clip(0.04, 1).astype(np.float32)
    tint = height[..., None]
    color = (np.array([50, 70, 120]) * (1 - tint) + np.array([250, 205, 150]) * tint).astype(np.uint8)
    corners, uv = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 0], [1, 0], [1, 1], [0, 1]]
    square = ibr.Mesh(corners, [[0, 1, 2], [0, 2, 3]], uv=uv)
    thing = ibr.SlicedSurface(square, height, color, 0.22, slices=64)
    light = ibr.Light(direction=(0.6, 0.4, -1))
    figure, row = plt.subplots(1, 3, figsize=(13, 3.0), layout="constrained")
    views = {"a, along the normal": (65, -60), "b, along u": (16, 0), "c, along v": (16, -90)}
    for axes, (name, (elevation, azimuth)) in zip(row, views.items(), strict=True):
        e, a = np.radians((elevation, azimuth))
        middle = np.array([0.5, 0.5, 0.1])
        eye = middle + 3 * np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
        camera = ibr.Camera.look_at(eye, middle, (0, 0, 1), (640, 330), fov_y=27 if elevation > 45 else 15)
        bare(axes).imshow(ibr.render(thing, camera, light, background=(255, 255, 255), samples=4).color)
        axes.set_title(f"direction {name}", loc="left", fontsize=12, color=INK)
    return figure


def slice_counts() -> Figure:
    """Draw a field of pyramids by 6, 12 and 48 slices of each of the three kinds."""
    y, x = np.mgrid[:128, :128] / 128
    ridges = np.maximum(1 - np.abs(4 * x % 1 - 0.5) * 2.4, 1 - np.abs(4 * y % 1 - 0.5) * 2.4).clip(0, 1)
    height = (0.08 + 0.9 * ridges).astype(np.float32)
    color = (np.array([60, 110, 150]) + ridges[..., None] * np.array([170, 100, 20])).astype(np.uint8)
    corners, uv = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 0], [1, 0], [1, 1], [0, 1]]
    square = ibr.Mesh(corners, [[0, 1, 2], [0, 2, 3]], uv=uv)
    angle, light = np.radians(25), ibr.Light(direction=(0.6, 0.3, -1))
    eye = np.array([0.5, 0.5, 0.1]) + 2.1 * np.array([0.5 * np.cos(angle), -0.87 * np.cos(angle), np.sin(angle)])
    camera = ibr.Camera.look_at(eye, (0.5, 0.5, 0.02), (0, 0, 1), (560, 250), fov_y=18)
    figure, grid = plt.subplots(3, 3, figsize=(13, 6.1), layout="constrained")
    for row, slicing in zip(grid, ("surface", "orthogonal", "screen"), strict=True):
        for axes, slices in zip(row, (6, 12, 48), strict=True):
            thing = ibr.SlicedSurface(square, height, color, 0.2, slices=slices, slicing=slicing)
            bare(axes).imshow(ibr.render(thing, camera, light, background=(255, 255, 255), samples=4).color)
            axes.set_title(f'slicing="{slicing}", {slices} slices', loc="left", fontsize=12, color=INK)
    return figure


def bands() -> Figure:
    """Draw a slope and blocks by the test "band": with a band that is too thin, one slice thick, and thicker."""
    y, x = np.mgrid[:96, :96] / 96
    height = (0.04 + 0.1 * x).astype(np.float32)
    for left, rise in ((0.1, 0.15), (0.4, 0.4), (0.7, 0.75)):
        height[(x > left) & (x < left + 0.2) & (y > 0.3) & (y < 0.7)] += rise
    color = (np.array([60, 110, 150]) + height[..., None] * np.array([190, 110, 20])).clip(0, 255).astype(np.uint8)
    corners, uv = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 0], [1, 0], [1, 1], [0, 1]]
    square, light = ibr.Mesh(corners, [[0, 1, 2], [0, 2, 3]], uv=uv), ibr.Light(direction=(0.6, 0.3, -1))
    camera = ibr.Camera.look_at((0.2, -1.5, 1.1), (0.5, 0.48, 0.05), (0, 0, 1), (420, 250), fov_y=25)
    figure, row = plt.subplots(1, 4, figsize=(13, 2.6), layout="constrained")
    for axes, (band, name) in zip(
        row, ((0.3 / 48, "0.3 / slices: gaps"), (None, "1 / slices"), (0.25, "0.25"), (1.0, "1")), strict=True
    ):
        thing = ibr.SlicedSurface(square, height, color, 0.3, slices=48, test="band", band=band)
        bare(axes).imshow(ibr.render(thing, camera, light, background=(255, 255, 255), samples=4).color)
        axes.set_title(f"band {name}", loc="left", fontsize=12, color=INK)
    return figure


def donuts() -> Figure:
    """Draw height maps of fur and of bricks on a donut of 625 quadrilaterals."""
    rng = np.random.default_rng(1)
    fur = cv2.GaussianBlur(rng.random((64, 64)).astype(np.float32) ** 3, (0, 0), 0.8, borderType=cv2.BORDER_REFLECT)
    fur /= fur.max()
    y, x = np.mgrid[:64, :64]
    joint = np.minimum(y % 16, (x + 8 * (y // 16 % 2)) % 32 % 31)
    brick = np.clip(joint / 3, 0, 1).astype(np.float32) * (0.8 + 0.2 * rng.random((64, 64)).astype(np.float32))
    fur_color = (np.stack([60 + 190 * fur, 40 + 120 * fur, 20 + 60 * fur], -1)).clip(0, 255).astype(np.uint8)
    red = np.where(joint[..., None] > 1, (176, 84, 62), (190, 184, 172)).astype(np.uint8)
    light, camera = (
        ibr.Light(direction=(0.3, 1, -1)),
        ibr.Camera.look_at((1.6, -2.7, 2.3), (0, 0, -0.05), (0, 0, 1), (760, 560), fov_y=42),
    )
    figure, row = plt.subplots(1, 2, figsize=(13, 4.9), layout="constrained")
    surfaces = {
        "furry, 20 slices": ibr.SlicedSurface(models.donut(), fur, fur_color, 0.16, tiles=(8, 4), slices=20),
        "bricks, 15 slices": ibr.SlicedSurface(models.donut(), brick, red, 0.06, tiles=(10, 4), slices=15),
    }
    for axes, (name, surface) in zip(row, surfaces.items(), strict=True):
        bare(axes).imshow(ibr.render(surface, camera, light, background=(255, 255, 255), samples=4).color)
        axes.set_title(name, loc="left", fontsize=12, color=INK)
    return figure


def volume() -> Figure:
    """Draw a line displaced along its normals, the slices of its volume, and a polygon's three slicing directions."""
    figure, row = plt.subplots(1, 3, figsize=(13, 2.7), width_ratios=(1, 1, 1.4), layout="constrained")
    _displaced_line(row[0])
    _slices_of_a_line(row[1])
    _directions(row[2])
    return figure


def terrain_heights(rows: int) -> tuple[np.ndarray, np.ndarray]:
    """Return heights from 0 to 1 and colours of a square part of the terrain."""
    field = height_field()
    part = np.s_[250:1050, 350:1150]
    height = -field.depth[part]
    height = cv2.resize((height - height.min()) / np.ptp(height), (rows, rows), interpolation=cv2.INTER_AREA)
    return height, cv2.resize(field.color[part], (rows, rows), interpolation=cv2.INTER_AREA)


def _base(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return points of a curved base line, and its normals."""
    points = np.stack([t, 0.16 * np.sin(np.pi * t)], axis=-1)
    slope = 0.16 * np.pi * np.cos(np.pi * t)
    normals = np.stack([-slope, np.ones_like(t)], axis=-1)
    return points, normals / np.linalg.norm(normals, axis=-1, keepdims=True)


def _displaced_line(axes: Axes) -> None:
    height, _ = terrain_heights(200)
    t, rise = np.linspace(0, 1, 200), 0.06 + 0.3 * height[90]
    points, normals = _base(t)
    above = points + rise[:, None] * normals
    axes.fill(*np.concatenate([points, above[::-1]]).T, color=SOLID)
    for k in range(4, 200, 12):
        axes.annotate("", above[k], points[k], arrowprops={"arrowstyle": "->", "color": BLUE, "lw": 1.1})
    axes.plot(*points.T, color=INK, linewidth=2.2)
    axes.plot(*above.T, color=ORANGE, linewidth=1.8)
    axes.text(0.5, 0.07, "base", fontsize=11, color=INK, ha="center")
    axes.text(0.62, 0.43, "displaced along\nthe normals", fontsize=11, color=ORANGE)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.03)
    axes.set_title("a displaced line", loc="left", fontsize=12, color=INK)
    bare(axes)


def _slices_of_a_line(axes: Axes) -> None:
    """Draw the slices of a curved line; parts that pass the alpha test have the colours of the map."""
    height, color = terrain_heights(200)
    t, alpha = np.linspace(0, 1, 200), 0.08 + 0.9 * height[90]
    points, normals = _base(t)
    edge = np.concatenate([points, (points + 0.36 * normals)[::-1], points[:1]])
    axes.plot(*edge.T, color=INK, linewidth=0.9)
    for h in np.arange(12) / 12:
        slice_at = points + 0.36 * h * normals
        axes.plot(*slice_at.T, color="#c4cad0", linewidth=0.8)
        passes = alpha > h
        for k in np.flatnonzero(passes[:-1] & passes[1:]):
            axes.plot(*slice_at[k : k + 2].T, color=color[90, k] / 255, linewidth=3.2, solid_capstyle="butt")
    axes.plot(*(points + 0.36 * alpha[:, None] * normals).T, color=ORANGE, linewidth=1.2)
    axes.text(0.5, 0.58, "displacement volume, 12 slices", fontsize=11, color=INK, ha="center")
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.03)
    axes.set_title("drawn where alpha > h", loc="left", fontsize=12, color=INK)
    bare(axes)


def _directions(axes: Axes) -> None:
    """Draw a polygon's displacement volume, cut into slices across each of its three slicing directions."""
    frame, height = extruded(UNIT, 0.34, (1, 1)).frames[0], 0.34
    camera = ibr.Camera.look_at((-2, -6, 3.4), (0, 0, 0), (0, 0, 1), (200, 200), projection="orthographic", height=2)
    box = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, height)])
    for number, (name, direction, color) in enumerate(zip("abc", frame, (ORANGE, BLUE, GREEN), strict=True)):

        def drawn(points: np.ndarray, column: int = number) -> np.ndarray:
            return camera.project(points)[0] * (1, -1) + (175 * column, 0)

        along = box @ direction
        for at in np.linspace(along.min(), along.max(), 6)[:: -1 if name == "c" else 1]:
            # The corners of one end are moved along the direction, and sorted by their angle in the picture.
            face = box[along < along.mean()]
            face = drawn(face + (at - along.min()) * direction)
            middle = face - face.mean(axis=0)
            face = face[np.argsort(np.arctan2(middle[:, 1], middle[:, 0]))]
            axes.fill(*face.T, facecolor=(*to_rgb(color), 0.25), edgecolor=color, linewidth=0.9)
        start = box.mean(axis=0) + 0.5 * np.ptp(along) * direction
        ends = drawn(np.stack([start, start + 0.4 * direction]))
        axes.annotate("", ends[1], ends[0], arrowprops={"arrowstyle": "-|>", "color": INK, "lw": 1.4})
        x, y = ends[1] + 0.28 * (ends[1] - ends[0])
        axes.text(x, y, name, fontsize=13, color=INK, ha="center", va="center")
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.03)
    axes.set_title("slicing directions of a polygon", loc="left", fontsize=12, color=INK)
    bare(axes)


def planes() -> Figure:
    """Draw two planes through a volume: the map's colour and height on them, their own height, and drawn points."""
    height, color = terrain_heights(256)
    figure = plt.figure(figsize=(13, 4.3), layout="constrained")
    grid = figure.add_gridspec(2, 5, width_ratios=(1.35, 1, 1, 1, 1))
    cuts = {  # a corner of the plane, and its two sides
        "orthogonal": (np.array([0.0, 0.42, 0]), np.array([1.0, 0, 0]), np.array([0, 0, 0.3])),
        "any plane": (np.array([0.14, 0.1, 0]), np.array([0.8, 0.28, 0]), np.array([-0.1, 0.5, 0.3])),
    }
    for number, (name, (corner, along, up)) in enumerate(cuts.items()):
        t, s = np.meshgrid(np.linspace(0, 1, 400), np.linspace(1, 0, 200))
        places = corner + t[..., None] * along + s[..., None] * up
        x, y = (places[..., k].astype(np.float32) * 256 - 0.5 for k in (0, 1))
        alpha, shown = cv2.remap(height, x, y, cv2.INTER_LINEAR), cv2.remap(color, x, y, cv2.INTER_LINEAR)
        h = places[..., 2] / 0.3
        passes = alpha > h
        space = figure.add_subplot(grid[number, 0])
        _plane_in_volume(space, height, color, np.array([corner, corner + along, corner + along + up, corner + up]))
        space.set_title(name, loc="left", fontsize=12, color=INK)
        panels = {
            "extruded colour": shown,
            "extruded alpha": np.repeat(alpha[..., None], 3, axis=2),
            "h": np.repeat(h[..., None], 3, axis=2),
            "drawn: alpha > h": np.where(passes[..., None], shown, 255),
        }
        for column, (title, image) in enumerate(panels.items(), 1):
            axes = figure.add_subplot(grid[number, column])
            bare(axes).imshow(image, aspect="auto")
            axes.set_title(title, loc="left", fontsize=12, color=INK)
            for spine in axes.spines.values():
                spine.set(visible=True, color="#c4cad0")
    return figure


def _plane_in_volume(axes: Axes, height: np.ndarray, color: np.ndarray, plane: np.ndarray) -> None:
    """Draw the displaced terrain behind a slicing plane, and the plane's outline in the volume."""
    ticks = (np.arange(256) + 0.5) / 256
    x, y = np.meshgrid(ticks, ticks)
    normal = np.cross(plane[1] - plane[0], plane[3] - plane[0])
    to_plane = (plane[0] - np.stack([x, y, 0 * x], axis=-1)) @ normal
    # The terrain is cut off at the plane's height above each point; in front of a vertical plane, all is removed.
    limit = to_plane / normal[2] / 0.3 if normal[2] > 0 else np.where(to_plane < 0, 0, 1)
    left = np.minimum(height, limit.clip(0, 1)).astype(np.float32)
    left[-1] = 0  # the map repeats, so its last row would rise in front of the first
    camera = ibr.Camera.look_at((0.05, -1.6, 1.25), (0.5, 0.45, 0.09), (0, 0, 1), (520, 330), fov_y=26)
    surface = ibr.SlicedSurface(UNIT, left, color, 0.3, slices=256, slicing="screen")
    bare(axes).imshow(ibr.render(surface, camera, background=(255, 255, 255), samples=4).color)
    axes.fill(*camera.project(plane)[0].T, facecolor=(*to_rgb(HOLE), 0.1), edgecolor=HOLE, linewidth=1.4)
    for z in (0, 0.3):
        square = np.array([[0, 0, z], [1, 0, z], [1, 1, z], [0, 1, z], [0, 0, z]])
        axes.plot(*camera.project(square)[0].T, color=INK, linewidth=0.6)
    for corner in UNIT.vertices:
        axes.plot(*camera.project(corner + np.array([[0, 0, 0], [0, 0, 0.3]]))[0].T, color=INK, linewidth=0.6)
    axes.set(xlim=(0, 520), ylim=(330, 0))


def intersection() -> Figure:
    """Draw a plane through the knot: the parts that one, two and six depth images keep."""
    views = object_views(knot(), 512)
    ticks = np.linspace(-3.7, 3.7, 600)
    x, y = np.meshgrid(ticks, ticks)
    points = np.stack([x, y, np.full_like(x, 0.35)], axis=-1).reshape(-1, 3)
    left, above = (_left_by(view, points).reshape(x.shape) for view in (views[0], views[3]))
    all_six = np.all([_left_by(view, points) for view in views], axis=0).reshape(x.shape)
    figure, row = plt.subplots(1, 4, figsize=(13, 3.5), layout="constrained")
    panels = {
        "one image, from the left": (left, ORANGE),
        "one image, from above": (above, BLUE),
        "both": (left & above, INK),
        "all six": (all_six, INK),
    }
    for axes, (name, (inside, tint)) in zip(row, panels.items(), strict=True):
        bare(axes).contourf(x, y, inside, levels=[0.5, 1.5], colors=[tint], alpha=0.35)
        axes.contour(x, y, inside, levels=[0.5], colors=[tint], linewidths=1.2)
        axes.set(aspect="equal", xlim=(-4.4, 3.9), ylim=(-3.9, 4.4))
        axes.set_title(name, loc="left", fontsize=12, color=INK)
    arrow = {"arrowstyle": "-|>", "lw": 1.6}
    for place in np.linspace(-2.4, 2.4, 5):
        row[0].annotate("", (-3.5, place), (-4.35, place), arrowprops={**arrow, "color": ORANGE})
        row[1].annotate("", (place, 3.5), (place, 4.35), arrowprops={**arrow, "color": BLUE})
    return figure


def one_slice() -> Figure:
    """Draw one slice of a depth object of the knot: the views whose tests each point passes, and the drawn points."""
    views = object_views(knot(), 512)
    whole = ibr.DepthObject(views, slices=128)
    camera = ibr.Camera.look_at((0, 0, 12), (0, 0, 0), (0, 1, 0), (400, 400), projection="orthographic", height=7.6)
    axis, spacing = int(np.abs(whole.box.axes[:, 2]).argmax()), whole.box.edges.max() / 128
    number = int(0.62 * whole.box.edges[axis] / spacing)
    y, x = np.mgrid[:400, :400]
    height = (whole.box.low[axis] + number * spacing) * whole.box.axes[axis, 2]
    pixels = np.stack([x.ravel(), y.ravel()], axis=-1)
    points = camera.unproject(pixels, np.full(len(pixels), 12 - height))
    passed = np.stack([_left_by(view, points) for view in views], axis=-1).reshape(400, 400, 6)
    tints = np.array([(230, 60, 60), (60, 190, 80), (70, 110, 230), (230, 190, 40), (180, 70, 200), (40, 190, 200)])
    count = passed.sum(axis=2)[..., None]
    mixed = 0.8 * (passed[..., None] * tints).sum(axis=2) / np.maximum(count, 1)
    mixed = np.where(count == 6, 255, np.where(count > 0, mixed, 30))
    alone = ibr.DepthObject(views, slices=128, only=number)
    oblique = ibr.Camera.look_at((4.5, -5.5, 6.5), (0, 0, 0), (0, 0, 1), (420, 400), fov_y=42)
    light = {"background": (255, 255, 255), "samples": 4}
    panels = {
        "the object": ibr.render(whole, oblique, **light).color,
        "tests of one slice: white passes all six": mixed.astype(np.uint8),
        f"drawn: only={number}": ibr.render(alone, camera, **light).color,
        "the same from the side": ibr.render(alone, oblique, **light).color,
    }
    figure, row = plt.subplots(1, 4, figsize=(13, 3.5), layout="constrained")
    for axes, (name, image) in zip(row, panels.items(), strict=True):
        bare(axes).imshow(image)
        axes.set_title(name, loc="left", fontsize=12, color=INK)
    return figure


def _left_by(view: ibr.DepthImage, points: np.ndarray) -> np.ndarray:
    """Return for each point whether it lies behind the surface that a view saw."""
    pixels, z = view.camera.project(points)
    x, y = np.rint(pixels).astype(int).T
    width, height = view.camera.size
    on_image = (x >= 0) & (x < width) & (y >= 0) & (y < height)
    x, y = np.where(on_image, x, 0), np.where(on_image, y, 0)
    return on_image & view.valid[y, x] & (z >= view.depth[y, x])


def inputs() -> Figure:
    """Draw colour and depth of the six images of the knot's depth object."""
    figure, grid = plt.subplots(2, 6, figsize=(13, 4.4), layout="constrained")
    names = ("along x", "along -x", "along y", "along -y", "along z", "along -z")
    for (top, bottom), name, view in zip(grid.T, names, object_views(knot(), 256), strict=True):
        bare(top).imshow(np.where(view.valid[..., None], view.color, 255))
        bare(bottom).imshow(np.where(view.valid, view.depth, np.nan), cmap="gray_r")
        top.set_title(name, loc="left", fontsize=12, color=INK)
    return figure
