"""The pictures of the README and of the manual, into docs/images: python docs/gallery/pictures.py."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")

import cv2
import depthcameras
import depthmeshes
import matplotlib.pyplot as plt
import numpy as np
import reliefs
from demo import FAINT, HOLE, INK, PATH, views_of
from matplotlib.axes import Axes
from matplotlib.colors import Normalize, to_rgb, to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle as Patch
from matplotlib.ticker import NullLocator
from objects import depth_object
from splats import splats
from terrain import height_field, source_view

import pyibr as ibr
from pyibr.capture import models
from pyibr.core.pixelspace import Rectangle
from pyibr.warp.lines import line_groups

IMAGES = Path(__file__).resolve().parents[1] / "images"
BLUE, ORANGE = "#1f6fb4", "#e08a00"


def bare(axes: Axes) -> Axes:
    """Axes without ticks and frame."""
    axes.xaxis.set_major_locator(NullLocator())
    axes.yaxis.set_major_locator(NullLocator())
    for spine in axes.spines.values():
        spine.set_visible(False)
    return axes


def terrain() -> Figure:
    """One depth image and one of its new views, in a row: colour, depth, new view, holes."""
    source = source_view(height_field())
    frame = views_of(source, PATH[2:3])[0].frame
    gray = (frame.color.mean(axis=2, keepdims=True) * 0.55 + 100) / 255
    depth = np.where(source.valid, -source.depth, np.nan)
    panels = {
        "source: colour": np.where(source.valid[..., None], source.color, 255),
        "source: depth": plt.get_cmap("viridis")(Normalize(-28_000, -11_000)(depth)),
        "new view": frame.color,
        "hidden from the source": np.where(frame.valid[..., None], gray, to_rgb(HOLE)),
    }
    panels["source: depth"][~source.valid] = to_rgba(FAINT)
    figure, row = plt.subplots(1, 4, figsize=(14, 2.62), layout="constrained")
    for axes, (name, image) in zip(row, panels.items(), strict=True):
        bare(axes).imshow(image)
        axes.set_title(name, loc="left", fontsize=12, color=INK)
    return figure


def epipolar_lines() -> Figure:
    """How the sweep's lines cover an image: the epipole inside, beside, and at infinity."""
    width, height = 48, 32
    cases = {
        "epipole inside": (30.0, 12.0, 1.0),
        "epipole beside": (-9.0, 26.0, 1.0),
        "epipole at infinity": (-1.0, 0.35, 0.0),
    }
    figure, row = plt.subplots(1, 3, figsize=(13, 3.4), layout="constrained")
    for axes, (name, epipole) in zip(row, cases.items(), strict=True):
        groups, _ = line_groups(np.array(epipole), Rectangle(0, width, 0, height), 1)
        for group in groups:
            for ends in lines_of(group, epipole):
                color = BLUE if group["axis"] == 0 else ORANGE
                axes.plot(*ends, color=color, linewidth=0.7, alpha=0.9)
        axes.add_patch(Patch((-0.5, -0.5), width, height, fill=False, edgecolor=INK, linewidth=1.5))
        if epipole[2]:
            axes.plot(*epipole[:2], "o", color=HOLE, markersize=8, zorder=5)
        axes.set_title(name, loc="left", fontsize=12, color=INK)
        axes.set(xlim=(-11, width + 1), ylim=(height + 1, -2), aspect="equal")
        bare(axes)
    return figure


def lines_of(group: np.void, epipole: tuple[float, float, float]) -> list[np.ndarray]:
    """(2, 2) x and y of the ends of each line of a group, as the kernel lays it."""
    axis = int(group["axis"])
    e_along, e_across, w = epipole[axis], epipole[1 - axis], epipole[2]
    lines: list[np.ndarray] = []
    for index in range(group["count"]):
        at = group["first"] + group["spacing"] * index
        slope = (at * w - e_across) / (group["reference"] * w - e_along)
        along = np.linspace(group["low"], group["high"], 400)
        across = at + slope * (along - group["reference"])
        inside = (across >= group["cross_low"] - 0.5) & (across <= group["cross_high"] + 0.5)
        if inside.any():
            ends = np.array([along[inside][[0, -1]], across[inside][[0, -1]]])
            lines.append(ends if axis == 0 else ends[::-1])
    return lines


def epipolar_plane() -> Figure:
    """One epipolar line of the source: its surface, the target's rays, and what each of them meets first."""
    s = np.linspace(0, 40, 2001)
    surface = 0.34 + 0.1 * np.sin(s / 3.4 + 0.4) + 0.36 * np.exp(-(((s - 17) / 2.6) ** 2)) + 0.002 * s
    center = -6.0, 1.25
    figure, axes = plt.subplots(figsize=(10, 4.4), layout="constrained")
    axes.fill_between(s, surface, -0.05, color="#dfe7ee")
    hits: list[int] = []
    for end in np.linspace(4, 74, 22):  # where the ray reaches nearness 0
        ray = center[1] * (end - s) / (end - center[0])
        crossing = np.flatnonzero((surface[:-1] < ray[:-1]) & (surface[1:] >= ray[1:]))
        if not crossing.size:
            continue
        hit = int(crossing[0])
        hits.append(hit)
        axes.plot((center[0], s[hit]), (center[1], surface[hit]), color=BLUE, linewidth=0.9)
        on = s[s >= s[hit]]
        axes.plot(on, ray[s >= s[hit]], color=BLUE, linewidth=0.5, linestyle=":", alpha=0.6)
    axes.plot(s, surface, color=INK, linewidth=1.8)
    steepness = (surface - center[1]) / (s - center[0])
    hidden = steepness < np.maximum.accumulate(steepness)
    axes.plot(s, np.where(hidden, surface, np.nan), color=HOLE, linewidth=3)
    axes.plot(s[hits], surface[hits], "o", color=INK, markersize=5)
    axes.plot(*center, "o", color=ORANGE, markersize=10)
    axes.annotate("the target's centre,\nat the epipole", center, (-4.6, 1.26), fontsize=11, color=INK)
    middle = int(np.flatnonzero(hidden & (s > 17)).min()) + 120
    axes.annotate(
        "hidden: no ray meets it first",
        (s[middle], surface[middle]),
        (s[middle] + 4, surface[middle] + 0.42),
        fontsize=11,
        color=HOLE,
        arrowprops={"arrowstyle": "-", "color": HOLE},
    )
    axes.annotate("", (12, 0.08), (1, 0.08), arrowprops={"arrowstyle": "->", "color": INK, "lw": 1.5})
    axes.text(1, 0.1, "the walk", fontsize=11, color=INK, va="bottom")
    axes.set(xlim=(-8, 40), ylim=(0, 1.4), xlabel="s: pixels along the source's epipolar line")
    axes.set_ylabel("nearness (1/z)")
    axes.spines[["top", "right"]].set_visible(False)
    return figure


def slicing_directions() -> Figure:
    """One height map, seen from above and from the side, by slices of each kind."""
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
    """A height map by 64 slices from where the directions a, b and c face the viewer most."""
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
        camera = ibr.Camera.look_at(eye, middle, (0, 0, 1), (640, 330), 27 if elevation > 45 else 15)
        bare(axes).imshow(ibr.render(thing, camera, light, background=(255, 255, 255), samples=4).color)
        axes.set_title(f"direction {name}", loc="left", fontsize=12, color=INK)
    return figure


def slice_counts() -> Figure:
    """A pyramid field at 40 degrees by 6 to 48 slices along the normal, across it and parallel to the screen."""
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


def donuts() -> Figure:
    """Height maps on a donut of 625 quadrilaterals: fur, and bricks."""
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
        ibr.Camera.look_at((1.6, -2.7, 2.3), (0, 0, -0.05), (0, 0, 1), (760, 560), 42),
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


def save(name: str, figure: Figure, dpi: int) -> None:
    """Write one picture and say how large it is."""
    path = IMAGES / name
    quality = {"quality": 88} if path.suffix == ".jpg" else None
    figure.savefig(path, dpi=dpi, facecolor="white", pil_kwargs=quality)
    plt.close(figure)
    print(f"{path}: {path.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    IMAGES.mkdir(exist_ok=True)
    plt.rcParams |= {"font.family": "DejaVu Sans"}
    save("terrain.jpg", terrain(), 110)
    save("epipolar-lines.png", epipolar_lines(), 80)
    save("epipolar-plane.png", epipolar_plane(), 100)
    save("slicing-directions.png", slicing_directions(), 80)
    save("three-directions.jpg", three_directions(), 80)
    save("slice-counts.png", slice_counts(), 70)
    save("donuts.jpg", donuts(), 80)
    save("depth-object.png", depth_object(), 90)
    save("depth-camera.jpg", depthcameras.steps(), 80)
    save("own-system.jpg", splats(), 100)
    save("relief-silhouettes.jpg", reliefs.silhouettes(), 80)
    save("relief-distances.jpg", reliefs.distances(), 80)
    save("relief-scenes.jpg", reliefs.scenes(), 80)
    save("depth-mesh.jpg", depthmeshes.segmentation(), 80)
    save("depth-mesh-blending.jpg", depthmeshes.blending(), 80)
    save("depth-mesh-object.jpg", depthmeshes.unseen(), 80)
