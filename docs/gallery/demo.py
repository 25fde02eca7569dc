"""New views of a terrain: one depth image, warped along a path, into build/demo.png.

`make demo` runs it. It prints the time of each view and the path of the picture.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize, to_rgb
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from numpy.typing import NDArray
from objects import depth_object
from rich.console import Console
from rich.progress import track
from rich.table import Table
from terrain import EXAGGERATION, camera_at, extent_of, height_field, source_view

import pyibr as ibr
from pyibr.opencl.device import explain

OUTPUT = Path(__file__).resolve().parents[2] / "build" / "demo.png"
OBJECT = OUTPUT.with_name("object.png")
SIZE = (900, 600)
PATH = ((-20, 1500, 0.80), (-8, 6000, 0.74), (7, 5000, 0.60), (19, 500, 0.68))  # each view's arguments of `camera_at`
REPEATS = 7
HOLE = "#e6007e"
INK = "#22262b"
FAINT = "#d9dbde"


@dataclass(frozen=True)
class View:
    """A rendered view and the milliseconds that it took."""

    frame: ibr.Frame
    time: float


def views_of(source: ibr.DepthImage, path: Sequence[tuple[float, float, float]]) -> list[View]:
    """Draw new views along PATH, with holes filled from the background; measure the median time of each."""
    views: list[View] = []
    for stop in track(path, "Warping", transient=True, console=Console(stderr=True)):
        camera = camera_at(*stop, size=SIZE, fov_y=32)
        frame = ibr.warp(source, camera, cut_ratio=1.02, fill="background")
        times: list[float] = []
        for _ in range(REPEATS):
            start = time.perf_counter()
            ibr.warp(source, camera, cut_ratio=1.02, fill="background")
            times.append(1e3 * (time.perf_counter() - start))
        views.append(View(frame, statistics.median(times)))
    return views


def picture(field: ibr.DepthImage, source: ibr.DepthImage, views: list[View]) -> Figure:
    """Draw the source and the views in columns; the rows are colour, depth and disocclusions."""
    plt.rcParams |= {"font.family": "DejaVu Sans", "text.color": INK, "axes.labelcolor": INK}
    columns = 1 + len(views)
    panel, gap, left, right, top, bottom = 4.2, 0.18, 0.5, 0.85, 0.5, 0.5
    apart = 0.2  # gap between the source and the views
    tall = panel * SIZE[1] / SIZE[0]
    width = left + columns * panel + (columns - 1) * gap + apart + right
    height = bottom + 3 * tall + 2 * gap + top
    figure = plt.figure(figsize=(width, height), facecolor="white")

    def place(row: int, column: int) -> Axes:
        x, y = left + column * (panel + gap) + apart * (column > 0), bottom + (2 - row) * (tall + gap)
        axes = figure.add_axes((x / width, y / height, panel / width, tall / height))
        axes.set_xticks([])
        axes.set_yticks([])
        axes.set_facecolor(FAINT)
        for spine in axes.spines.values():
            spine.set_visible(False)
        return axes

    kilometres = np.concatenate([view.frame.depth[view.frame.valid] for view in views]) / 1000
    scale = Normalize(*np.percentile(kilometres, (0.5, 99.5)))
    first = [place(row, 0) for row in range(3)]
    for axes, label in zip(first, ("colour", "depth", "cameras, from above"), strict=True):
        axes.set_ylabel(label, fontsize=14, labelpad=7)
    show_title(first[0], "source", f"{source.camera.width} x {source.camera.height}")
    first[0].imshow(np.where(source.valid[..., None], source.color, 255))
    shown = show_depth(first[1], source.depth, source.valid, scale)
    show_map(first[2], field, source.camera, [view.frame.camera for view in views])
    for column, view in enumerate(views, 1):
        color, depth, holes = (place(row, column) for row in range(3))
        show_title(color, f"view {column}", f"{view.time:.0f} ms")
        color.imshow(view.frame.color)
        show_depth(depth, view.frame.depth, view.frame.valid, scale)
        show_holes(holes, view.frame)

    x, y = left + columns * (panel + gap) + apart, bottom + tall + gap
    bar = figure.colorbar(
        shown, cax=figure.add_axes((x / width, (y + 0.1) / height, 0.16 / width, (tall - 0.45) / height))
    )
    bar.ax.set_title("km", fontsize=12, loc="left", pad=6)
    bar.ax.invert_yaxis()
    bar.outline.set_visible(False)  # pyright: ignore[reportCallIssue]
    note = (
        f"Elevation model of the Jacksboro fault, as matplotlib ships it, {EXAGGERATION:g} times as high. "
        "Every view is warped from the source alone. "
        "Pink: hidden from the source; the colour row fills it from the background."
    )
    figure.text(left / width, 0.14 / height, note, fontsize=12, color="#5b626a")
    return figure


def show_title(axes: Axes, head: str, tail: str) -> None:
    """Write the title of a panel, and a number beside it."""
    axes.set_title(head, loc="left", fontsize=15, fontweight="bold", pad=7)
    axes.set_title(tail, loc="right", fontsize=15, pad=7)


def show_depth(axes: Axes, depth: NDArray[np.float32], valid: NDArray[np.bool_], scale: Normalize) -> AxesImage:
    """Draw depth in kilometres, with the same colour scale in all panels."""
    return axes.imshow(np.where(valid, depth / 1000, np.nan), cmap="viridis_r", norm=scale)


def show_holes(axes: Axes, frame: ibr.Frame) -> None:
    """Draw the view in gray with its holes in one colour, and write the percentage of the holes."""
    gray = (frame.color.mean(axis=2, keepdims=True) * 0.55 + 100) / 255
    axes.imshow(np.where(frame.valid[..., None], gray, to_rgb(HOLE)))
    box = {"boxstyle": "round,pad=0.35", "facecolor": HOLE, "edgecolor": "white"}
    share = f"{1 - frame.valid.mean():.1%}"
    axes.text(0.98, 0.05, share, color="white", fontsize=13, ha="right", transform=axes.transAxes, bbox=box)


def show_map(axes: Axes, field: ibr.DepthImage, source: ibr.Camera, path: list[ibr.Camera]) -> None:
    """Draw a map of the terrain, with the cameras and their fields of view."""
    axes.imshow(field.color, extent=extent_of(field.camera))
    axes.set(xlim=(-22_500, 22_500), ylim=(-21_000, 9_000), facecolor="white")
    for name, camera in zip(["s", *"123456789"], [source, *path], strict=False):
        corners = [(0, camera.height / 2), (camera.width - 1, camera.height / 2)]
        ends = camera.unproject(corners, [8000.0, 8000.0])[:, :2]
        at = camera.center[:2]
        wedge = np.vstack([at, ends])
        color = INK if name == "s" else HOLE
        axes.fill(*wedge.T, facecolor=color, alpha=0.25, edgecolor="white", linewidth=1)
        axes.plot(*at, "o", color=color, markersize=15, markeredgecolor="white")
        axes.text(
            float(at[0]),
            float(at[1]),
            name,
            color="white",
            fontsize=11,
            fontweight="bold",
            ha="center",
            va="center_baseline",
        )


def print_table(console: Console, source: ibr.DepthImage, views: list[View]) -> None:
    """Print the warped views and the time of each."""
    device, _ = explain()
    width, height = source.camera.size
    table = Table()
    for heading in ("view", "time", "holes"):
        table.add_column(heading, justify="right")
    for number, view in enumerate(views, 1):
        table.add_row(str(number), f"{view.time:.1f} ms", f"{1 - view.frame.valid.mean():.1%}")
    console.print(f"One depth image of {width} x {height}, warped to {len(views)} views of {SIZE[0]} x {SIZE[1]}:")
    console.print(table)
    console.print(f"Times: median of {REPEATS} calls, NumPy to NumPy, holes filled, on {device.name}.", soft_wrap=True)


def main() -> None:
    """Warp the terrain, write both pictures, and print the times."""
    console, progress = Console(highlight=False), Console(stderr=True)
    with progress.status("looking at the terrain (the first time compiles the kernels)"):
        field = height_field()
        source = source_view(field)
    views = views_of(source, PATH)
    with progress.status("drawing the picture"):
        OUTPUT.parent.mkdir(parents=True, exist_ok=True)
        picture(field, source, views).savefig(OUTPUT, dpi=100)
    with progress.status("making a solid of depth images"):
        depth_object().savefig(OBJECT, dpi=100)
    print_table(console, source, views)
    console.print(f"The picture is [bold]{OUTPUT}[/bold]", soft_wrap=True)
    console.print(f"A solid from twelve depth images is in [bold]{OBJECT}[/bold]", soft_wrap=True)
    console.print(f"To see it, open it in a browser, or run: [bold]xdg-open {OUTPUT}[/bold]", soft_wrap=True)


if __name__ == "__main__":
    main()
