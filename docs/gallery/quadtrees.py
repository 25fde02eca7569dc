"""Pictures of the quadtree of a depth mesh, made by pictures.py."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from demo import HOLE, INK
from epipolar import BLUE, ORANGE, bare
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from objects import knot
from terrain import camera_at, height_field

import pyibr as ibr
from pyibr.capture import object_views
from pyibr.depthmesh import Segmentation
from pyibr.depthmesh.tree import Tree
from pyibr.opencl.headers import constant

PALE = "#dfe7ee"


def refinement() -> Figure:
    """Draw the quadtree's first levels, and a terrain's triangles for two largest errors and for a viewer."""
    figure, grid = plt.subplots(2, 4, figsize=(13, 6.7), layout="constrained")
    for axes, view in zip(grid[0], _steps(), strict=True):
        mesh = ibr.DepthMesh(view, segmentation=Segmentation("none")).simplify(1e-4)
        corners = _pixels(mesh, view)
        axes.add_collection(PolyCollection(list(corners), facecolor=PALE, edgecolor=BLUE, linewidth=1.2))
        sides = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2)
        rows = np.arange(len(corners))
        longest = sides.argmax(axis=1)
        splits = 0.5 * (corners[rows, longest] + corners[rows, (longest + 1) % 3])
        axes.plot(*splits.T, "o", color=ORANGE, markersize=9, markeredgecolor="white")
        _frame(axes, view, f"{len(corners)} triangles, and their split points")
    terrain = _coarse_terrain()
    mesh = ibr.DepthMesh(terrain, segmentation=Segmentation("none"))
    bare(grid[1, 0]).imshow(terrain.color)
    grid[1, 0].set_title("65 x 65 samples of a terrain", loc="left", fontsize=12, color=INK)
    viewer = camera_at(0, 0, 0.75, (900, 600), fov_y=60)
    panels = {
        "within 600 m": mesh.simplify(600),
        "within 300 m": mesh.simplify(300),
        "viewer in the south, 16 px": mesh.triangulate(viewer, tolerance=16),
    }
    for axes, (name, triangles) in zip(grid[1, 1:], panels.items(), strict=True):
        axes.add_collection(
            PolyCollection(list(_pixels(triangles, terrain)), facecolor=PALE, edgecolor=BLUE, linewidth=0.7)
        )
        _frame(axes, terrain, f"{name}: {len(triangles.faces):,}")
    return figure


def _steps() -> list[ibr.DepthImage]:
    """Draw four depth images whose meshes need 2, 4, 8 and 16 triangles."""
    middle = np.array([[3, 3, 3], [3, 2, 3], [3, 3, 3]], float)
    beside = np.array([[3, 2.5, 3], [2.6, 2, 2.4], [3, 2.7, 3]])
    finer = np.zeros((5, 5))
    finer[::2, ::2] = beside
    finer[::2, 1::2] = 0.5 * (finer[::2, :-1:2] + finer[::2, 2::2])
    finer[1::2, ::2] = 0.5 * (finer[:-1:2, ::2] + finer[2::2, ::2])
    finer[1::2, 1::2] = 1.5
    views: list[ibr.DepthImage] = []
    for depth in (np.full((2, 2), 3.0), middle, beside, finer):
        size = depth.shape[1], depth.shape[0]
        camera = ibr.Camera(np.eye(3), size, projection="orthographic")
        views.append(ibr.DepthImage(np.zeros((*depth.shape, 3), np.uint8), depth.astype(np.float32), camera))
    return views


def _coarse_terrain() -> ibr.DepthImage:
    """Return a part of the terrain, 65 x 65 samples, seen from above."""
    field, step = height_field(), 12
    K = field.camera.K / step
    K[2, 2] = 1
    K[:2, 2] = (field.camera.K[:2, 2] - (300, 300)) / step
    part = np.s_[300 : 300 + 65 * step : step, 300 : 300 + 65 * step : step]
    camera = ibr.Camera(K, (65, 65), field.camera.world_from_camera, projection="orthographic")
    return ibr.DepthImage(field.color[part], field.depth[part], camera)


def _pixels(mesh: ibr.Mesh, view: ibr.DepthImage) -> np.ndarray:
    """Return the pixels (T, 3, 2) at which the view sees the corners of a mesh's triangles."""
    return view.camera.project(mesh.vertices)[0][mesh.faces]


def _frame(axes: Axes, view: ibr.DepthImage, title: str) -> None:
    width, height = view.camera.size
    slack = 0.02 * width
    axes.set(xlim=(-slack, width - 1 + slack), ylim=(height - 1 + slack, -slack), aspect="equal")
    axes.set_title(title, loc="left", fontsize=12, color=INK)
    bare(axes)


def _strands() -> ibr.DepthImage:
    """Return 33 x 33 samples of the knot where its strands overlap."""
    view = object_views(knot(), 129)[4]
    x, y = 60, 30
    K = view.camera.K - [[0, 0, x], [0, 0, y], [0, 0, 0]]
    camera = ibr.Camera(K, (33, 33), view.camera.world_from_camera, projection=view.camera.projection)
    part = np.s_[y : y + 33, x : x + 33]
    return ibr.DepthImage(view.color[part], view.depth[part], camera)


def segments() -> Figure:
    """Draw the triangles of four levels of a small view; colours show whether cells within them are drawn."""
    view = _strands()
    tree = ibr.DepthMesh(view).tree
    figure, row = plt.subplots(1, 5, figsize=(13, 2.95), layout="constrained")
    bare(row[0]).imshow(np.where(view.valid, view.depth, np.nan), cmap="gray_r")
    row[0].set_title("depth, 33 x 33", loc="left", fontsize=12, color=INK)
    for axes, step in zip(row[1:], (0, 1, 2, 4), strict=True):
        corners, drawn, undrawn = _level(tree, step)
        colors = np.where(undrawn[:, None], np.where(drawn[:, None], to_rgb("#f5a8cf"), to_rgb(HOLE)), to_rgb(PALE))
        axes.add_collection(PolyCollection(list(corners), facecolor=colors, edgecolor="white", linewidth=0.7))
        side = 2 * step or 1
        _frame(axes, view, f"blocks of {side} x {side}" if step else "the full grid")
    return figure


def _level(tree: Tree, step: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a level's triangles (T, 3, 2), two per block, a mask of triangles with drawn cells, and one with undrawn.

    The side of a block is 2 step, or 1 if step is 0.
    """
    states = (tree.states if step else tree.cells).to_host()
    drawn, undrawn, bits = (int(constant("depthmesh/tree.h", n)) for n in ("DRAWN", "UNDRAWN", "SIDE_BITS"))
    corners: list[np.ndarray] = []
    found: list[int] = []
    side = 2 * step or 1
    for top in range(0, tree.side, side):
        for left in range(0, tree.side, side):
            square = np.array([[left, top], [left + side, top], [left + side, top + side], [left, top + side]])
            main = (left // side + top // side) % 2 == 0  # the block's diagonal runs to the lower right
            byte = int(states[top + step, left + step])
            halves = ([0, 1, 2], [0, 2, 3]) if main else ([0, 1, 3], [1, 2, 3])
            for half, three in enumerate(halves):
                corners.append(square[three])
                found.append(byte >> bits * half)
    state = np.array(found)
    return np.array(corners), (state & drawn) > 0, (state & undrawn) > 0


def strips() -> Figure:
    """Draw strips of triangles: one over the whole grid, and several around empty samples and around rubber sheets."""
    view = _strands()
    whole = ibr.DepthImage(view.color, _filled(view), view.camera)
    panels = {
        "whole": ibr.DepthMesh(whole, segmentation=Segmentation("none")),
        "no background": ibr.DepthMesh(view, segmentation=Segmentation("none")),
        "segmented": ibr.DepthMesh(view),
    }
    figure, row = plt.subplots(1, 3, figsize=(13, 4.6), layout="constrained")
    for axes, (name, mesh) in zip(row, panels.items(), strict=True):
        found, triangles = mesh.strips(view.camera, tolerance=0.4), mesh.triangulate(view.camera, tolerance=0.4)
        places = view.camera.project(triangles.vertices)[0]
        for number, strip in enumerate(found):
            three = np.stack([strip[:-2], strip[1:-1], strip[2:]], axis=-1)
            three = three[(three != np.roll(three, 1, axis=1)).all(axis=1)]
            corners = places[three]
            along = plt.get_cmap("turbo")(np.linspace(0, 0.93, len(three)))
            colors = along if len(found) == 1 else plt.get_cmap("tab20")(np.full(len(three), number % 20))
            colors = 0.45 + 0.55 * colors[:, :3]
            axes.add_collection(PolyCollection(list(corners), facecolor=colors, edgecolor="white", linewidth=0.5))
            axes.plot(*corners.mean(axis=1).T, color=INK, linewidth=0.8)
        several = f"{len(found)} strips" if len(found) > 1 else "one strip"
        _frame(axes, view, f"{name}: {len(triangles.faces):,} triangles, {several}")
    return figure


def _filled(view: ibr.DepthImage) -> np.ndarray:
    """Return depth in which the background has the depth of the farthest sample."""
    return np.where(view.valid, view.depth, view.depth[view.valid].max()).astype(np.float32)


def sections() -> Figure:
    """Draw two cross-sections of a depth image: the error of a vertex, and a triangle between two surfaces."""
    view = object_views(knot(), 72, projection="perspective")[5]
    figure, row = plt.subplots(1, 2, figsize=(13, 4.3), layout="constrained")
    _error(row[0], view)
    _sheet(row[1], view)
    return figure


def _section(view: ibr.DepthImage, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the surface points (n, 3) at some pixels, in the frame of the view's camera."""
    points = view.camera.unproject(np.column_stack([x, y]), view.depth[y, x])
    return (points - view.camera.center) @ view.camera.world_from_camera[:3, :3]


def _error(axes: Axes, view: ibr.DepthImage) -> None:
    """Draw samples of a column by y and z, an edge that spans 16 samples, and the error at the edge's middle."""
    y = np.arange(13, 38)
    flat = _section(view, np.full(len(y), 35), y)[:, 1:]
    a, p, b = flat[4], flat[12], flat[20]
    foot = a + (b - a) * ((p - a) @ (b - a)) / ((b - a) @ (b - a))
    axes.plot(*flat.T, "-o", color=INK, linewidth=1.2, markersize=4)
    axes.plot(*np.stack([a, b]).T, color=BLUE, linewidth=2)
    axes.plot(*np.stack([p, foot]).T, color=HOLE, linewidth=2)
    for point, name in ((a, "a"), (p, "p"), (b, "b")):
        axes.plot(*point, "o", color=BLUE, markersize=10)
        axes.annotate(name, point, (0, 10), textcoords="offset points", fontsize=13, color=INK, ha="center")
    d = np.linalg.norm(p - foot)
    axes.annotate(f"d = {d:.2f}", foot, (-8, -10), textcoords="offset points", fontsize=12, color=HOLE, ha="right")
    _finish(axes, "a column of samples: the error without the vertex p", "y")


def _sheet(axes: Axes, view: ibr.DepthImage) -> None:
    """Draw samples of a row across a depth edge, the normal of the surface between them, and the line of sight."""
    x, at = np.arange(30, 46), 37
    flat = _section(view, x, np.full(len(x), 25))[:, [0, 2]]
    left, right = flat[x == at][0], flat[x == at + 1][0]
    middle, across = 0.5 * (left + right), right - left
    normal = np.array([across[1], -across[0]]) / np.linalg.norm(across)
    sight = -middle / np.linalg.norm(middle)
    angle = np.degrees(np.arcsin(abs(normal @ sight)))
    for part in (x <= at, x > at):
        axes.plot(*flat[part].T, "-o", color=INK, linewidth=1.2, markersize=4)
    axes.plot(*np.stack([left, right]).T, color=HOLE, linewidth=2.4)
    for direction, name, color in ((normal, "n", BLUE), (sight, "v", ORANGE)):
        axes.annotate("", middle + 0.6 * direction, middle, arrowprops={"arrowstyle": "-|>", "color": color, "lw": 1.8})
        axes.annotate(name, middle + 0.7 * direction, fontsize=13, color=color, ha="center", va="center")
    axes.annotate(
        f"v meets it at {angle:.0f}°:\na rubber sheet",
        0.4 * left + 0.6 * right,
        (-12, -8),
        textcoords="offset points",
        fontsize=12,
        color=HOLE,
        ha="right",
        va="center",
    )
    _finish(axes, "a row of samples over a depth edge", "x")


def _finish(axes: Axes, title: str, across: str) -> None:
    axes.set(xlabel=across, ylabel="z", aspect="equal")
    axes.invert_yaxis()
    axes.margins(0.1, 0.12)
    axes.spines[["top", "right"]].set_visible(False)
    axes.set_title(title, loc="left", fontsize=12, color=INK)
