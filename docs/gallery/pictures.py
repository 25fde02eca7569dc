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
import reliefrays
import reliefs
import warpfigures
from demo import FAINT, HOLE, INK, PATH, views_of
from epipolar import bare, cameras, epipolar_lines, epipolar_plane, orders
from matplotlib.colors import Normalize, to_rgb, to_rgba
from matplotlib.figure import Figure
from objects import depth_object
from splats import splats
from terrain import height_field, source_view

import pyibr as ibr
from pyibr.capture import models

IMAGES = Path(__file__).resolve().parents[1] / "images"


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
    save("paper-warp-cameras.png", cameras(), 80)
    save("paper-warp-orders.png", orders(), 70)
    save("globe-of-six.jpg", warpfigures.globe_of_six(), 80)
    save("torus-of-six.jpg", warpfigures.torus_of_six(), 80)
    save("beside-the-original.jpg", warpfigures.beside_the_original(), 80)
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
    save("paper-relief-texture.jpg", reliefs.texture(), 80)
    save("paper-relief-rays.png", reliefrays.rays(), 80)
    save("paper-relief-distances.png", reliefrays.measures(), 80)
    save("paper-relief-quadrics.png", reliefrays.quadrics(), 70)
    save("paper-relief-shadows.jpg", reliefs.shadows(), 80)
    save("depth-mesh.jpg", depthmeshes.segmentation(), 80)
    save("depth-mesh-blending.jpg", depthmeshes.blending(), 80)
    save("depth-mesh-object.jpg", depthmeshes.unseen(), 80)
