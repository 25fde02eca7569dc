"""Pictures of rays in reliefs and of depths below the base, made by pictures.py."""

from __future__ import annotations

from collections.abc import Callable

import matplotlib.pyplot as plt
import numpy as np
from demo import HOLE, INK
from epipolar import BLUE, ORANGE, bare
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from reliefs import quad, stones, tube

import pyibr as ibr
from pyibr.capture import models
from pyibr.relief.quadrics import vertex_frames

BEND = -0.62
"""Coefficient a of the quadric z = a x^2 in the cross-sections; positive z is outwards."""
DEEP = 0.34
"""Greatest depth of the relief in the cross-sections, in the unit of x."""


def rays() -> Figure:
    """Draw the search below a flat base, and rays below a flat base and below a curved base, where one ray gets out."""
    figure, row = plt.subplots(1, 3, figsize=(13, 2.7), layout="constrained")
    flat = _section(row[0], 0.0)
    _entering(row[0], flat, 0.0, (-0.55, (0.9, -0.3)), BLUE, searched=True)
    flat = _section(row[1], 0.0)
    curved = _section(row[2], BEND)
    for axes, heights, bend in ((row[1], flat, 0.0), (row[2], curved, BEND)):
        _entering(axes, heights, bend, (-0.88, (0.8, -0.42)), BLUE)
        _entering(axes, heights, bend, (0.15, (0.97, -0.26)), ORANGE)
    row[0].set_title("even steps, then halvings", loc="left", fontsize=12, color=INK)
    row[1].set_title("flat: every ray meets something", loc="left", fontsize=12, color=INK)
    row[2].set_title("along the quadric: one comes out again", loc="left", fontsize=12, color=INK)
    return figure


def _section(axes: Axes, bend: float) -> Callable[[np.ndarray], np.ndarray]:
    """Draw a cross-section of a relief below z = bend x^2; return the height map along it as a function of x."""
    heights = stones()[0][40] / 255.0
    x = np.linspace(-1.25, 1.25, 900)

    def height(at: np.ndarray) -> np.ndarray:
        return np.interp(((at + 1.25) * 0.4 + 0.12) % 1, np.arange(256) / 256, heights)

    top, bottom = bend * x**2, bend * x**2 - DEEP
    axes.fill_between(x, bottom, top - DEEP * (1 - height(x)), color="#dfe7ee")
    axes.plot(x, top - DEEP * (1 - height(x)), color=INK, linewidth=1.6)
    axes.plot(x, top, color=INK, linewidth=0.8, linestyle="--")
    axes.plot(x, bottom, color=INK, linewidth=0.8, linestyle=":")
    axes.set(xlim=(-1.05, 1.05), ylim=(-0.78 if bend else -0.4, 0.24), aspect="equal")
    bare(axes)
    return height


def _entering(
    axes: Axes,
    height: Callable[[np.ndarray], np.ndarray],
    bend: float,
    ray: tuple[float, tuple[float, float]],
    color: str,
    searched: bool = False,
) -> None:
    """Draw a ray that enters at x, up to its hit on the relief or its exit."""
    at, way = ray
    start, way = np.array([at, bend * at**2]), np.array(way)

    def below(t: np.ndarray) -> np.ndarray:
        return (bend * (start[0] + way[0] * t) ** 2 - start[1] - way[1] * t) / DEEP

    t = np.linspace(1e-3, 2.2, 4000)
    depth = below(t)
    ends = int(np.argmax((depth < 0) | (depth > 1))) or len(t) - 1
    meets = np.flatnonzero(depth[:ends] >= 1 - height(start[0] + way[0] * t[:ends]))
    end = t[meets[0]] if meets.size else t[ends]
    axes.plot(*np.stack([start - 0.5 * way, start + end * way]).T, color=color, linewidth=1.5)
    if meets.size:
        axes.plot(*(start + end * way), "o", color=color, markersize=7)
    else:
        axes.plot(*np.stack([start + end * way, start + (end + 0.35) * way]).T, color=color, linewidth=1.5)
    axes.plot(*start, "o", color=color, markersize=5, markerfacecolor="white")
    if searched:
        steps = t[ends] * np.arange(1, 13) / 12
        taken = steps[: int(np.argmax(steps >= end)) + 1]
        points = start + taken[:, None] * way
        axes.plot(*points.T, "|", color=HOLE, markersize=9)


def measures() -> Figure:
    """Draw the depth of a point below a tube by each of the three distances, and the depths along a ray."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(13, 3.6), layout="constrained", width_ratios=(1.15, 1))
    radius, turn = -0.5 / BEND, np.linspace(-0.7, 1.6, 300)
    circle = radius * np.stack([np.sin(turn), np.cos(turn) - 1])
    left.fill(np.append(circle[0], circle[0, 0]), np.append(circle[1], -2), color="#dfe7ee")
    left.plot(*circle, color=INK, linewidth=1.8)
    x = np.linspace(-0.5, 1.2, 300)
    left.plot(x, BEND * x**2, color=INK, linewidth=1.0, linestyle="--")
    way = np.array([0.83, -0.5577])
    point = 0.72 * way
    normal_foot = np.array([point[0], BEND * point[0] ** 2])
    across = np.array([0.5577, 0.83])  # at right angles to the ray, in the plane of ray and normal
    # equation 6, solved for s: a (Px + s Ux)^2 = Pz + s Uz
    a, b, c = BEND * across[0] ** 2, 2 * BEND * point[0] * across[0] - across[1], BEND * point[0] ** 2 - point[1]
    s = min((r.real for r in np.roots([a, b, c]) if abs(r.imag) < 1e-9), key=abs)
    center = np.array([0, -radius])
    from_center = point - center
    circle_foot = center + radius * from_center / np.linalg.norm(from_center)
    left.plot(*np.stack([-0.35 * way, 1.2 * way]).T, color=INK, linewidth=1.1)
    for foot, color, name in (
        (normal_foot, ORANGE, '"approximate"'),
        (circle_foot, BLUE, '"exact"'),
        (point + s * across, HOLE, '"perpendicular"'),
    ):
        left.plot(*np.stack([point, foot]).T, color=color, linewidth=2.2, label=name)
    left.plot(*point, "o", color=INK, markersize=7)
    left.plot(0, 0, "o", color=INK, markersize=5, markerfacecolor="white")
    left.legend(frameon=False, fontsize=11, loc="lower left")
    left.text(0.98, -0.45, "the quadric", fontsize=11, color=INK)
    left.text(0.35, -0.75, "a tube", fontsize=11, color=INK)
    left.set(xlim=(-0.5, 1.3), ylim=(-0.82, 0.24), aspect="equal")
    bare(left)
    _along_a_ray(right)
    return figure


def _along_a_ray(axes: Axes) -> None:
    """Plot the depth below a circle of radius 1, by each distance, along a ray that enters at 35 degrees."""
    way, bend = np.array([np.cos(np.radians(35)), -np.sin(np.radians(35))]), -0.5
    t = np.linspace(0, 1.05, 300)
    x, z = t * way[0], t * way[1]
    true = 1 - np.hypot(x, z + 1)
    approximate = bend * x**2 - z
    across = np.array([-way[1], way[0]])
    a, b, c = bend * across[0] ** 2, 2 * bend * x * across[0] - across[1], bend * x**2 - z
    root = np.sqrt(np.maximum(b * b - 4 * a * c, 0))
    perpendicular = np.abs(2 * c / (-b + root))
    for depth, color, name in (
        (perpendicular, HOLE, '"perpendicular"'),
        (approximate, ORANGE, '"approximate"'),
        (true, BLUE, '"exact", and the truth'),
    ):
        axes.plot(t, depth, color=color, linewidth=1.8, label=name)
    axes.set(xlabel="way along the ray, in radii of a tube", ylabel="depth below it")
    axes.legend(frameon=False, fontsize=11)
    axes.spines[["top", "right"]].set_visible(False)


def quadrics() -> Figure:
    """Draw the quadrics that are fitted at vertices of four meshes."""
    ring, ball = models.donut(64), models.donut(64, radius=1e-6, tube=1.0)
    square = quad((-1, -1, 0), (2, 0, 0), (0, 2, 0))
    cases = {
        "sphere": _fitted(ball, (0.9, 0.25, 0.2)),
        "inside of a torus": _fitted(ring, (0.5, 0, 0)),
        "tube": _fitted(tube(64), (1, 0, 0)),
        "plane": _fitted(square, (-1, -1, 0)),
    }
    figure, row = plt.subplots(1, 4, figsize=(13, 3.4), layout="constrained", subplot_kw={"projection": "3d"})
    x, y = np.meshgrid(np.linspace(-0.7, 0.7, 25), np.linspace(-0.7, 0.7, 25))
    for axes, (name, (a, b, c)) in zip(row, cases.items(), strict=True):
        axes.plot_surface(x, y, a * x**2 + b * y**2 + c * x * y, cmap="viridis", vmin=-0.8, vmax=0.8, linewidth=0)
        axes.set_title(f"{name}: a = {a:.2f}, b = {b:.2f}", fontsize=11, color=INK, y=0.94)
        axes.set(zlim=(-0.8, 0.8))
        axes.set_box_aspect((1, 1, 1), zoom=1.25)
        axes.view_init(elev=22, azim=-50)
        axes.set_axis_off()
    return figure


def _fitted(mesh: ibr.Mesh, near: tuple[float, float, float]) -> np.ndarray:
    """Return a, b and c of the quadric at the vertex that is nearest to a place: (3,)."""
    nearest = np.linalg.norm(mesh.vertices - np.array(near), axis=1).argmin()
    return vertex_frames(mesh, (1, 1)).quadrics[nearest].round(6) + 0.0
