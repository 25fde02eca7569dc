"""Pictures of epipolar lines and planes, made by pictures.py."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from demo import HOLE, INK
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle as Patch
from matplotlib.ticker import NullLocator
from mpl_toolkits.mplot3d import Axes3D

import pyibr as ibr
from pyibr.core.pixelspace import Rectangle
from pyibr.warp.lines import line_groups

BLUE, ORANGE = "#1f6fb4", "#e08a00"


def bare(axes: Axes) -> Axes:
    """Remove the ticks and the frame of axes."""
    axes.xaxis.set_major_locator(NullLocator())
    axes.yaxis.set_major_locator(NullLocator())
    for spine in axes.spines.values():
        spine.set_visible(False)
    return axes


def epipolar_lines() -> Figure:
    """Draw the sweep's lines over an image, with the epipole inside, beside it, and at infinity."""
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
    """Return the ends of each line of a group as the kernel computes them: (2, 2), x of both ends, then y of both."""
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
    """Draw the surface along one epipolar line of the source, the target's rays, and their first hits."""
    s = np.linspace(0, 40, 2001)
    surface = 0.34 + 0.1 * np.sin(s / 3.4 + 0.4) + 0.36 * np.exp(-(((s - 17) / 2.6) ** 2)) + 0.002 * s
    center = -6.0, 1.25
    figure, axes = plt.subplots(figsize=(10, 4.4), layout="constrained")
    axes.fill_between(s, surface, -0.05, color="#dfe7ee")
    hits: list[int] = []
    for end in np.linspace(4, 74, 22):  # s at which the ray reaches nearness 0
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


def cameras() -> Figure:
    """Draw two cameras with the plane through their centres and a point, and the surface in this plane."""
    figure = plt.figure(figsize=(13, 5.2), layout="constrained")
    space = figure.add_subplot(1, 2, 1, projection="3d")
    assert isinstance(space, Axes3D)
    _in_space(space)
    _in_the_plane(figure.add_subplot(1, 2, 2))
    return figure


def _in_space(axes: Axes3D) -> None:
    """Draw both cameras, their images, and a point that both see."""
    up, point = (0, 0, 1), np.array([0.5, 3.6, 0.7])
    pair = [
        ibr.Camera.look_at((-1.5, 0, 0), (-0.2, 3.6, 0.2), up, (40, 30), fov_y=38),
        ibr.Camera.look_at((1.7, 0.4, 0.1), (0.2, 3.6, 0.2), up, (40, 30), fov_y=38),
    ]
    for camera, color, name in zip(pair, (ORANGE, BLUE), ("source", "target"), strict=True):
        corners = np.array([(-0.5, -0.5), (39.5, -0.5), (39.5, 29.5), (-0.5, 29.5), (-0.5, -0.5)])
        frame = camera.unproject(corners, np.full(5, 1.3))
        axes.plot(*frame.T, color=color, linewidth=1.6)
        for corner in frame[:4]:
            axes.plot(*np.stack([camera.center, corner]).T, color=color, linewidth=0.6)
        pixel, _ = camera.project(point[None])
        seen = camera.unproject(pixel, [1.3])[0]
        axes.plot(*np.stack([camera.center, point]).T, color=INK, linewidth=1.2)
        axes.plot(*seen[:, None], "o", color=color, markersize=6)
        x, y, z = camera.center
        axes.text(x, y, z - 0.25, f"{name}'s centre", fontsize=11, color=color, ha="center")
    axes.plot(*np.stack([pair[0].center, pair[1].center]).T, color=HOLE, linewidth=1.2)
    axes.plot(*point[:, None], "o", color=INK, markersize=8)
    plane = np.stack([pair[0].center, pair[1].center, point])
    axes.plot_trisurf(*plane.T, triangles=[[0, 1, 2]], color=HOLE, alpha=0.16)
    axes.text(point[0] + 0.15, point[1], point[2] + 0.1, "a point of the surface", fontsize=11, color=INK)
    axes.view_init(elev=34, azim=-68)
    axes.set_box_aspect((3.4, 3.8, 1.6), zoom=1)
    axes.set_axis_off()


def _in_the_plane(axes: Axes) -> None:
    """Draw the epipolar plane, in which the source's image is a line, and the part of the line that a ray covers."""
    source, target, image = np.array([0.0, 0.0]), np.array([2.6, 0.7]), 1.0  # the source looks along +y
    x = np.linspace(-1.2, 3.4, 1200)
    surface = 3.1 + 0.28 * np.sin(2.1 * x + 0.6) + 0.25 * np.sin(4.3 * x)
    direction = np.array([-0.66, 1.0])
    way = np.linspace(0, 4, 4000)
    ray = target + way[:, None] * direction
    hit = ray[np.argmax(ray[:, 1] >= np.interp(ray[:, 0], x, surface))]
    epipole, infinity, seen = (image / d[1] * d[0] for d in (target - source, direction, hit - source))
    axes.fill_between(x, surface, 4.4, color="#dfe7ee")
    axes.plot(x, surface, color=INK, linewidth=1.8)
    axes.plot([-1.3, 4.0], [image, image], color=ORANGE, linewidth=1.0)
    axes.plot([infinity, epipole], [image, image], color=ORANGE, linewidth=4, solid_capstyle="butt")
    axes.plot(*np.stack([source, target]).T, color=HOLE, linewidth=1.2)
    axes.plot([target[0], epipole], [target[1], image], color=HOLE, linewidth=0.8, linestyle=":")
    axes.plot(*np.stack([target, hit]).T, color=BLUE, linewidth=1.6)
    axes.plot(*np.stack([hit, hit + 0.8 * direction]).T, color=BLUE, linewidth=0.8, linestyle=":")
    axes.plot(*np.stack([source, hit]).T, color=INK, linewidth=1.0)
    axes.plot(*np.stack([source, source + 2.2 * direction]).T, color=BLUE, linewidth=0.8, linestyle="--")
    for place, color in ((source, ORANGE), (target, BLUE), (hit, INK)):
        axes.plot(*place, "o", color=color, markersize=8)
    for at, name, shift in (
        (epipole, "its epipole", (0.05, 0.1)),
        (infinity, "the ray's point\nat infinity", (-0.1, -0.36)),
        (seen, "the seen point", (0.0, 0.1)),
    ):
        axes.plot(at, image, "o", color=INK, markersize=5)
        axes.annotate(name, (at + shift[0], image + shift[1]), fontsize=10, color=INK, ha="center")
    axes.annotate("source's centre", (source[0] + 0.12, source[1] - 0.05), fontsize=11, color=ORANGE)
    axes.annotate("target's centre", (target[0] + 0.1, target[1] - 0.12), fontsize=11, color=BLUE)
    axes.annotate("source's image", (-1.25, image + 0.07), fontsize=11, color=ORANGE)
    axes.set(xlim=(-1.4, 4.2), ylim=(-0.25, 4.3), aspect="equal")
    bare(axes)


def orders() -> Figure:
    """Draw the lines of target and source for four camera arrangements; they darken in the sweep's direction."""
    up, size = (0, 0, 1), (60, 40)
    source = ibr.Camera.look_at((0, 0, 0), (0, 4, 0), up, size, fov_y=58)
    targets = {
        "the target is before the source": ibr.Camera.look_at((0.4, 1.2, 0.15), (0.4, 4, 0.2), up, size, fov_y=58),
        "behind it": ibr.Camera.look_at((0.5, -1.4, 0.2), (0.3, 4, 0), up, size, fov_y=58),
        "each sees the other": ibr.Camera.look_at((1.0, 3.0, 0.3), (-1.0, 1.6, 0), up, size, fov_y=58),
        "neither does": ibr.Camera.look_at((1.4, -0.4, 0.1), (3.2, 2.6, 0.2), up, size, fov_y=58),
    }
    figure, grid = plt.subplots(2, 4, figsize=(13, 4.9), layout="constrained")
    for column, (name, target) in zip(grid.T, targets.items(), strict=True):
        _walked(column, source, target)
        column[0].set_title(name, loc="left", fontsize=12, color=INK)
    grid[0, 0].set_ylabel("target", fontsize=12, color=BLUE)
    grid[1, 0].set_ylabel("source", fontsize=12, color=ORANGE)
    return figure


def _walked(column: np.ndarray, source: ibr.Camera, target: ibr.Camera) -> None:
    width, height = source.size
    to_target, to_source = _between(source, target), _between(target, source)
    epipole, seen_epipole = to_target[:3, 3], to_source[:3, 3]
    groups, _ = line_groups(epipole, Rectangle(0, width, 0, height), 1)
    for group in groups:
        for ends in lines_of(group, tuple(epipole))[::3]:
            line = np.linspace(ends[:, 0], ends[:, 1], 40)
            # The target's pixels p are visited against the direction D = w p - (u, v), with the epipole (u, v, w).
            _shaded(column[0], line, -(epipole[2] * line[20] - epipole[:2]), BLUE)
            nearness = np.concatenate([[0], np.geomspace(0.02, 50, 160)])
            places = np.ones((len(line), len(nearness), 4))
            places[..., :2], places[..., 3] = line[:, None], nearness
            seen = places.reshape(-1, 4) @ to_source.T
            seen = seen[seen[:, 2] > 1e-9]
            pixels = seen[:, :2] / seen[:, 2:3]
            pixels = pixels[
                (np.abs(pixels - (width / 2 - 0.5, height / 2 - 0.5)) <= (width / 2, height / 2)).all(axis=1)
            ]
            if len(pixels) < 2:
                continue
            # The walk leads outwards from an epipole, and inwards to an antipode.
            outwards = seen_epipole[2] * pixels[len(pixels) // 2] - seen_epipole[:2]
            along = pixels @ outwards
            _shaded(column[1], np.linspace(pixels[along.argmin()], pixels[along.argmax()], 40), outwards, ORANGE)
    for axes, place in zip(column, (epipole, seen_epipole), strict=True):
        axes.add_patch(Patch((-0.5, -0.5), width, height, fill=False, edgecolor=INK, linewidth=1.5))
        if abs(place[2]) > 1e-9:
            axes.plot(*(place[:2] / place[2]), "o" if place[2] > 0 else "x", color=HOLE, markersize=8, zorder=5)
        axes.set(xlim=(-6, width + 5), ylim=(height + 5, -6), aspect="equal")
        bare(axes)


def _between(src: ibr.Camera, dst: ibr.Camera) -> np.ndarray:
    """Return the matrix (4, 4) from the pixel space of `src` to the pixel space of `dst`."""
    return dst.pixel_matrix @ dst.camera_from_world @ src.world_from_camera @ np.linalg.inv(src.pixel_matrix)


def _shaded(axes: Axes, line: np.ndarray, forwards: np.ndarray, color: str) -> None:
    """Draw a line that grows darker in the direction `forwards`."""
    if (line[-1] - line[0]) @ forwards < 0:
        line = line[::-1]
    shades = np.linspace(0.08, 1, len(line) - 1)
    colors = [(*to_rgb(color), shade) for shade in shades]
    axes.add_collection(LineCollection(list(np.stack([line[:-1], line[1:]], axis=1)), colors=colors, linewidths=0.9))
