"""New views of a terrain: one depth image, warped along a path, into build/demo.png.

Run by `make demo`. It prints where the picture is and what each view took.
"""

from __future__ import annotations

import statistics
import time
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from rich.console import Console
from rich.progress import track
from rich.table import Table
from terrain import camera_at, height_field, source_view

import pyibr as ibr

OUTPUT = Path(__file__).resolve().parents[2] / "build" / "demo.png"
SIZE = (900, 600)
PATH = ((-13, 1500, 0.82), (-5, 4500, 0.80), (5, 4500, 0.70), (13, 500, 0.75))  # as camera_at takes them
REPEATS = 5
DEPTHS = Normalize(8, 28)  # kilometres
HOLE = "#e6007e"
INK = "#22262b"


@dataclass(frozen=True)
class View:
    """A rendered view and the milliseconds that it took."""

    frame: ibr.Frame
    time: float


def views_of(view: ibr.DepthImage) -> list[View]:
    """The new views along the path, holes filled from behind, each with its median time."""
    views: list[View] = []
    for stop in track(PATH, "Warping", transient=True, console=Console(stderr=True)):
        camera = camera_at(*stop, size=SIZE, fov_y=32)
        times: list[float] = []
        for _ in range(REPEATS + 1):  # the first call may compile
            start = time.perf_counter()
            frame = ibr.warp(view, camera, edges="cut", cut_ratio=1.02, fill="background")
            times.append(1e3 * (time.perf_counter() - start))
        views.append(View(frame, statistics.median(times[1:])))  # pyright: ignore[reportPossiblyUnbound]
    return views


def picture(field: ibr.DepthImage, source: ibr.DepthImage, views: list[View]) -> Figure:
    """Source and views side by side: colour, depth, and what the source did not see."""
    plt.rcParams |= {"font.family": "DejaVu Sans", "text.color": INK, "axes.labelcolor": INK}
    columns = 1 + len(views)
    figure, grid = plt.subplots(3, columns, figsize=(4.2 * columns, 9.1), layout="constrained")
    figure.get_layout_engine().set(w_pad=0.02, h_pad=0.02, wspace=0.008, hspace=0.01)
    width, height = source.camera.size
    titles = [f"source\n{width} × {height}, colour and depth"]
    titles += [f"view {i}\n{view.time:.0f} ms" for i, view in enumerate(views, 1)]
    for axes, title in zip(grid[0], titles, strict=True):
        head, tail = title.split("\n")
        axes.set_title(f"$\\bf{{{head.replace(' ', '~')}}}$   {tail}", fontsize=14, pad=8)
    for axes, label in zip(grid[:, 0], ("colour", "depth", "the path, from above"), strict=True):
        axes.set_ylabel(label, fontsize=14, labelpad=8)

    grid[0, 0].imshow(source.color)
    shown = show_depth(grid[1, 0], source.depth)
    show_path(grid[2, 0], field, source.camera, [view.frame.camera for view in views])
    for column, view in enumerate(views, 1):
        frame = view.frame
        grid[0, column].imshow(frame.color)
        show_depth(grid[1, column], np.where(frame.valid, frame.depth, np.nan))
        show_holes(grid[2, column], frame)
    grid[2, 1].set_ylabel("holes", fontsize=14, labelpad=8)
    bar = figure.colorbar(shown, ax=grid[1], location="right", shrink=0.9, aspect=18, pad=0.006)
    bar.set_label("depth (km)", fontsize=12)
    bar.outline.set_visible(False)  # pyright: ignore[reportCallIssue]
    for axes in grid.flat:
        axes.set_xticks([])
        axes.set_yticks([])
        for spine in axes.spines.values():
            spine.set_visible(False)
    return figure


def show_depth(axes: Axes, depth: np.ndarray):
    """Depth in kilometres, on the scale that all panels share; holes in gray."""
    axes.set_facecolor("#d9dbde")
    return axes.imshow(depth / 1000, cmap="viridis_r", norm=DEPTHS)


def show_holes(axes: Axes, frame: ibr.Frame) -> None:
    """The view in gray; holes in one colour."""
    gray = frame.color.mean(axis=2, keepdims=True) * 0.55 + 100
    image = np.where(frame.valid[..., None], gray, 0).repeat(1, axis=2) * np.ones(3) / 255
    image[~frame.valid] = mpl.colors.to_rgb(HOLE)
    axes.imshow(image)
    axes.text(
        0.98, 0.04, f"{1 - frame.valid.mean():.1%}", color="white", fontsize=13, ha="right",
        transform=axes.transAxes, bbox={"boxstyle": "round,pad=0.3", "fc": HOLE, "ec": "none"},
    )  # fmt: skip


def show_path(axes: Axes, field: ibr.DepthImage, source: ibr.Camera, path: list[ibr.Camera]) -> None:
    """The map with the cameras on it."""
    axes.imshow(field.color, alpha=0.75)


def main() -> None:
    """Make the picture."""
    console = Console(highlight=False)
    with Console(stderr=True).status("looking at the terrain (the first time compiles the kernels)"):
        field = height_field()
        source = source_view(field)
    views = views_of(source)
    with Console(stderr=True).status("drawing the picture"):
        OUTPUT.parent.mkdir(parents=True, exist_ok=True)
        picture(field, source, views).savefig(OUTPUT, dpi=100)

    table = Table(title=f"A depth image of {SIZE[0]} ...")
    console.print(table)


if __name__ == "__main__":
    main()
