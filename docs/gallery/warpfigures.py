"""Pictures like figures 10 to 13 of the warping paper, and of thin objects, made by pictures.py."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from demo import HOLE
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from objects import by_rays
from reliefs import show

import pyibr as ibr
from pyibr.capture import MeshScene, models
from pyibr.warp.view import Edges

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from benchmarks.models import globe, torus

COLORS = [plt.get_cmap("tab10")(number) for number in (0, 1, 2, 3, 4, 6)]
CROSS = {(1, 0): 1, (1, 1): 4, (1, 2): 0, (1, 3): 5, (0, 1): 3, (2, 1): 2}
"""Number of the image of `cube_cameras` at each (row, column) of a cross: a cube's faces, unfolded."""


def globe_of_six() -> Figure:
    """Draw frusta and rays in a half globe, and the six images' colours and displacements, each as a cross."""
    images = globe(257)
    camera = ibr.Camera.look_at((-3.9, -1.9, 3.0), (0, 0, 0), (0, -1, 0), (440, 440), fov_y=43)
    away = [image for image in images if image.camera.forward @ camera.center < 0]
    frame = ibr.warp(away, camera, side="both", edges="connect", blend="nearest", samples=4)
    paper = ((over_white(frame) + 255.0) / 2).astype(np.uint8)
    figure, row = plt.subplots(1, 4, figsize=(17, 4.1), width_ratios=(1, 1, 1.28, 1.28), layout="constrained")
    show(row[0], paper, "the frusta of six images at the centre")
    show(row[1], paper, "rays of the images, to their samples")
    for image, tone in zip(images, COLORS, strict=True):
        corners = image.camera.unproject([[0, 0], [256, 0], [256, 256], [0, 256]], np.full(4, 1.15))
        edges = [np.stack([image.camera.center, corner]) for corner in corners]
        edges += [np.stack(pair) for pair in pairwise([*corners, corners[0]])]
        draw_lines(row[0], edges, camera, frame, tone)
    for image, tone in zip(away, (COLORS[images.index(one)] for one in away), strict=True):
        y, x = (32 * one.ravel() for one in np.mgrid[:9, :9])
        ends = image.camera.unproject(np.column_stack([x, y]), image.depth[y, x])
        rays = [np.stack([image.camera.center, end]) for end in ends]
        draw_lines(row[1], rays, camera, frame, tone, 0.6)
    away_from_sphere = [np.linalg.norm(world_of(image), axis=-1) - 1 for image in images]
    tones = [plt.get_cmap("viridis")(away / 0.08)[..., :3] for away in away_from_sphere]
    show(row[2], cross([image.color / 255 for image in images]), "their colours")
    show(row[3], cross(tones), "their displacements")
    return figure


def torus_of_six() -> Figure:
    """Draw the torus with the frusta around it, the images of three frusta, and their displaced image planes."""
    views = torus(256)
    camera, close = (
        ibr.Camera.look_at((9.4, -2.6, 3.4), (0, 0.2, 0), (0, -1, 0), (560, 560), fov_y=degrees) for degrees in (56, 24)
    )
    frame = ibr.warp(views, camera, blend="nearest", samples=4)
    figure = plt.figure(figsize=(15, 4.9), layout="constrained")
    grid = figure.add_gridspec(2, 6)
    whole, planes = figure.add_subplot(grid[:, :2]), figure.add_subplot(grid[:, 4:])
    show(whole, over_white(frame), "six frusta, proposed")
    show(planes, np.full_like(frame.color, 255), "the polygons that are displaced")
    for view, tone in zip(views, COLORS, strict=True):
        far = np.quantile(view.depth[view.valid], 0.5)
        corners = view.camera.unproject([[0, 0], [255, 0], [255, 255], [0, 255]], np.full(4, far))
        outline = [np.stack(pair) for pair in pairwise([*corners, corners[0]])]
        draw_lines(whole, [np.stack([view.camera.center, one]) for one in corners] + outline, camera, frame, tone)
        planes.add_patch(Polygon(close.project(corners)[0], facecolor=(*tone[:3], 0.35), edgecolor=tone))
    for row, number in enumerate((0, 2)):
        view = views[number]
        near = (view.depth - np.nanmin(view.depth)) / np.ptp(view.depth[view.valid])
        depth = np.where(view.valid[..., None], plt.get_cmap("viridis")(1 - np.where(view.valid, near, 0))[..., :3], 1)
        show(figure.add_subplot(grid[row, 2]), np.where(view.valid[..., None], view.color, 255), f"image {number + 1}")
        show(figure.add_subplot(grid[row, 3]), depth, "depth")
    return figure


def beside_the_original() -> Figure:
    """Draw the torus, warps of its six images with edges cut and connected, and their differences from the torus."""
    views = torus(256)
    camera = models.view(views, (400, 400), direction=(-1, -1.2, -0.3), distance=2.6)
    scene = MeshScene.from_mesh(models.torus_mesh())
    truth, original = scene.capture(camera), by_rays(scene, camera)
    figure, row = plt.subplots(1, 5, figsize=(17.5, 3.8), layout="constrained")
    show(row[0], original, "original geometry, by rays")
    kinds: tuple[Edges, ...] = ("cut", "connect")
    for place, edges in zip((1, 3), kinds, strict=True):
        frame = ibr.warp(views, camera, edges=edges, blend="nearest", samples=4)
        picture = over_white(frame)
        apart = np.abs(picture.astype(np.float64) - original).max(axis=2)
        shown = np.repeat(1 - np.clip(apart / 64, 0, 1)[..., None], 3, axis=2)
        shown[truth.valid & ~frame.valid] = np.array([int(HOLE[i : i + 2], 16) for i in (1, 3, 5)]) / 255
        show(row[place], picture, f'warp, edges="{edges}"')
        show(row[place + 1], shown, "difference; pink: unseen")
    return figure


def over_white(frame: ibr.Frame) -> np.ndarray:
    """Put a frame with several samples per pixel on white: (H, W, 3) uint8."""
    assert frame.alpha is not None
    return np.rint(frame.color + 255 * (1 - frame.alpha[..., None])).clip(0, 255).astype(np.uint8)


def world_of(image: ibr.DepthImage) -> np.ndarray:
    """Return the world coordinates (H, W, 3) of the samples of an image without holes."""
    y, x = np.mgrid[: image.camera.height, : image.camera.width]
    points = image.camera.unproject(np.stack([x, y], -1).reshape(-1, 2), image.depth.ravel())
    return points.reshape(*image.depth.shape, 3)


def cross(faces: Sequence[np.ndarray]) -> np.ndarray:
    """Put the six images of a cube on white, as an unfolded cube."""
    side = faces[0].shape[0]
    sheet = np.ones((3 * side, 4 * side, 3))
    for (row, column), number in CROSS.items():
        sheet[row * side : (row + 1) * side, column * side : (column + 1) * side] = faces[number]
    return sheet


def draw_lines(
    axes: Axes,
    lines: Sequence[np.ndarray],
    camera: ibr.Camera,
    frame: ibr.Frame,
    tone: tuple[float, ...],
    width: float = 1.2,
) -> None:
    """Draw lines over a picture, given by their ends (2, 3) in the world; hidden parts are faint."""
    part = np.linspace(0, 1, 121)[:, None]
    limits = axes.get_xlim(), axes.get_ylim()
    for line in lines:
        pixels, depth = camera.project(line[0] + part * (line[1] - line[0]))
        x, y = np.clip(np.rint(pixels), 0, np.array(camera.size) - 1).astype(int).T
        with np.errstate(invalid="ignore"):
            hidden = (frame.depth[y, x] < 0.99 * depth)[:-1]
        pieces = np.stack([pixels[:-1], pixels[1:]], axis=1)
        for some, alpha in ((~hidden, 1.0), (hidden, 0.22)):
            axes.add_collection(LineCollection(list(pieces[some]), colors=[tone], linewidths=width, alpha=alpha))
    axes.set(xlim=limits[0], ylim=limits[1])


def thin_things() -> Figure:
    """Draw wires and bars of one sample's width, and five times as large by rays, without and with `thin`."""
    view, truth, camera = fence()
    figure, row = plt.subplots(1, 4, figsize=(17, 3.7), layout="constrained")
    show(row[0], view.color, f"{view.camera.width} x {view.camera.height} samples")
    show(row[1], truth, "by rays, five times as fine")
    for axes, thin in zip(row[2:], (False, True), strict=True):
        frame = ibr.warp(view, camera, thin=thin, fill="background", samples=4)
        show(axes, frame.color, f"warp, thin={thin}")
    return figure


def fence() -> tuple[ibr.DepthImage, np.ndarray, ibr.Camera]:
    """Return a depth image of wires and bars before a striped wall, a ray-cast side view, and its camera."""
    size, focal, sample = (96, 72), 100.0, 2 / 100.0
    camera = ibr.Camera([[focal, 0, 47.5], [0, focal, 35.5], [0, 0, 1]], size)
    aside = ibr.Camera(
        [[5 * focal, 0, 239.5], [0, 5 * focal, 179.5], [0, 0, 1]],
        (480, 360),
        camera.moved(0.06, -0.03, 0.0).world_from_camera,
    )
    lines = [((x, -0.6), (x, 0.6)) for x in (-0.69, -0.33, 0.03, 0.39)]  # at the centres of samples
    lines += [
        ((-0.9, 0.3), (0.9, 0.2)),
        ((-0.9, -0.2), (0.9, -0.42)),
        ((-0.7, 0.25), (0.02, -0.3)),
        ((0.42, 0.5), (0.85, -0.35)),
    ]
    lines += [((0.62, 0.1), (0.5, -0.15)), ((0.68, 0), (0.9, -0.1)), ((0.75, -0.16), (0.66, -0.45))]
    vertices: list[np.ndarray] = []
    colors: list[tuple[int, int, int]] = []
    for number, (start, end) in enumerate(np.array(lines, float)):
        along = (end - start) / np.linalg.norm(end - start)
        across = 0.5 * sample * np.array([-along[1], along[0]])
        vertices += [np.append(corner, 2.0) for corner in (start - across, start + across, end + across, end - across)]
        colors += 4 * [(70, 130, 60) if number > 6 else (60, 60, 70) if number < 4 else (170, 90, 40)]
    for stripe in range(24):
        left, right = (-3 + 0.25 * (stripe + k) for k in (0, 1))
        vertices += [
            np.array(corner) for corner in ((left, -3, 3.0), (left, 3, 3.0), (right, 3, 3.0), (right, -3, 3.0))
        ]
        colors += 4 * [(236, 228, 210) if stripe % 2 else (214, 205, 190)]
    first = 4 * np.arange(len(vertices) // 4)
    faces = np.concatenate([np.stack([first, first + 1, first + 2], 1), np.stack([first, first + 2, first + 3], 1)])
    scene = MeshScene(np.array(vertices), faces, colors=np.array(colors, np.uint8))
    return scene.capture(camera), by_rays(scene, aside), aside
