"""Plots of results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.statistics import exponent, median

Series = Mapping[int, float]  # by size


def complexity(series: Mapping[tuple[str, str], Series], path: Path) -> None:
    """Plot visited samples and times against the image's side, with logarithmic axes and fitted lines."""
    figure, panels = _panels(2)
    labels = {"visited": "samples visited", "end to end": "time [ms]"}
    subjects = list(dict.fromkeys(subject for subject, _ in series))
    for panel, (quantity, label) in zip(panels, labels.items(), strict=True):
        for (method, what), values in series.items():
            if what != quantity:
                continue
            n, y = np.array(list(values)), np.array(list(values.values()))
            color = f"C{subjects.index(method)}"
            power = exponent(n.tolist(), y.tolist())
            scale = np.exp(np.mean(np.log(y) - power * np.log(n)))
            panel.plot(n, y, "o", color=color, label=f"{method}: $n^{{{power:.2f}}}$")
            panel.plot(n, scale * n**power, "-", lw=1, color=color)
        _logarithmic(panel, label)
    _save(figure, path)


def table2(series: Mapping[str, Series], paper: Mapping[str, Series], path: Path) -> None:
    """Plot our times as solid lines and the paper's times as dashed lines, with one colour per model."""
    figure, (panel,) = _panels(1)
    for index, (model, values) in enumerate(series.items()):
        panel.plot(list(values), list(values.values()), "o-", color=f"C{index}", label=f"{model}, here")
        figures = paper[model]
        panel.plot(list(figures), list(figures.values()), "s--", color=f"C{index}", label=f"{model}, R10000")
    _logarithmic(panel, "time of a picture [ms]")
    _save(figure, path)


def peers(
    times: Mapping[tuple[str, int], Mapping[Any, float]],
    ratios: Mapping[tuple[str, int], Sequence[float]],
    bars: Mapping[tuple[str, int], float],
    path: Path,
) -> None:
    """Plot times (left) and their ratios to the base (right) by size: a dot for each position, a line of medians."""
    figure, (left, right) = _panels(2)
    subjects = list(dict.fromkeys(subject for subject, _ in ratios))
    for index, subject in enumerate(subjects):
        sizes = [n for s, n in ratios if s == subject]
        style: dict[str, Any] = {"color": f"C{index}", "marker": "o", "ms": 4, "label": subject}
        left.plot(sizes, [median(times[subject, n].values()) for n in sizes], **style)
        right.plot(sizes, [median(ratios[subject, n]) for n in sizes], **style)
        for n in sizes:
            shift = 1 + 0.025 * (index - len(subjects) / 2)
            right.plot(
                [n * shift] * len(ratios[subject, n]),
                ratios[subject, n],
                ".",
                ms=3,
                alpha=0.4,
                color=f"C{index}",
            )
        for (s, n), bar in bars.items():
            if s == subject and n in sizes:
                right.plot([n / 1.15, n * 1.15], [bar, bar], "-", lw=3, alpha=0.6, color=f"C{index}")
    _logarithmic(left, "time, median over the positions [ms]")
    _logarithmic(right, "ratio to cv2.warpFrame (thick: bars)")
    right.legend().remove()
    _save(figure, path)


def rgbd(
    ratios: Mapping[tuple[str, str, float], Sequence[float]],
    bars: Mapping[tuple[str, str, float], float],
    base: str,
    path: Path,
) -> None:
    """Plot ratios to the base against noise: a panel per kind of motion, a line of means per size, a dot per motion."""
    kinds, sizes = (
        list(dict.fromkeys(kind for kind, _, _ in ratios)),
        list(dict.fromkeys(size for _, size, _ in ratios)),
    )
    figure, panels = _panels(len(kinds))
    for panel, kind in zip(panels, kinds, strict=True):
        noises = sorted({noise for k, _, noise in ratios if k == kind})
        for index, size in enumerate(sizes):
            here = {at: ratios[kind, size, noise] for at, noise in enumerate(noises) if (kind, size, noise) in ratios}
            shift, color = 0.04 * (index - (len(sizes) - 1) / 2), f"C{index}"
            panel.plot(list(here), [np.mean(found) for found in here.values()], "o-", color=color, ms=4, label=size)
            for at, found in here.items():
                panel.plot([at + shift] * len(found), found, ".", ms=4, alpha=0.5, color=color)
                bar = bars.get((kind, size, noises[at]))
                if bar is not None:
                    ends = [at + shift - 0.15, at + shift + 0.15]
                    panel.plot(ends, [bar, bar], "-", lw=3, alpha=0.5, color=color)
        panel.axhline(1, color="k", lw=0.8)
        panel.set_xticks(range(len(noises)), [f"{noise:g}" if noise else "none" for noise in noises])
        panel.set_ylim(bottom=0)
        panel.set_title(kind, fontsize=10)
        panel.set_xlabel("noise [pixels of disparity]")
        panel.set_ylabel(f"ratio to {base} (thick: bars)")
        panel.grid(True, lw=0.3, alpha=0.5)
        panel.legend(fontsize=8)
    _save(figure, path)


def objects(
    by_size: Mapping[str, Series], by_slices: Mapping[str, Series], paper: Mapping[tuple[int, int], float], path: Path
) -> None:
    """Plot frames per second by the picture's side and by the number of slices, like figure 12 of Kautz and Seidel."""
    figure, panels = _panels(2)
    for panel, series, label in zip(
        panels, (by_size, by_slices), ("side of the picture [pixels]", "slices"), strict=True
    ):
        for index, (subject, milliseconds) in enumerate(series.items()):
            style = "s--" if "llvmpipe" in subject else "o-"
            rates = [1000 / value for value in milliseconds.values()]
            panel.plot(list(milliseconds), rates, style, color=f"C{index // 2}", ms=4, label=subject)
        _logarithmic(panel, "frames per second", label)
    for (side, slices), rate in paper.items():
        panels[0].plot(side, rate, "k*", ms=9)
        left: dict[str, Any] = {"ha": "right", "textcoords": "offset points", "fontsize": 8}
        panels[0].annotate(f"GeForce 2, {slices} slices", (side, rate), (-6, -3), **left)
    _save(figure, path)


def directions(error: Mapping[str, Mapping[int, Series]], through: Mapping[str, Series], path: Path) -> None:
    """Plot depth errors (left, by elevation) and fractions that rays pass through (right) by the number of slices."""
    figure, (left, right) = _panels(2)
    for index, (slicing, by_elevation) in enumerate(error.items()):
        for elevation, series in by_elevation.items():
            label = slicing if elevation == min(by_elevation) else None
            left.plot(list(series), list(series.values()), "o-", color=f"C{index}", ms=3, lw=0.8, label=label)
        shown = {n: max(100 * share, 1e-3) for n, share in through[slicing].items()}
        right.plot(list(shown), list(shown.values()), "o-", color=f"C{index}", ms=4, label=slicing)
    _logarithmic(left, "mean depth error [displacements]", "slices")
    _logarithmic(right, "seen through [% of the surface], 0.001: none", "slices")
    _save(figure, path)


def simplification(series: Mapping[str, Mapping[str, Sequence[tuple[float, float]]]], path: Path) -> None:
    """Plot the number of triangles against the measured error: a panel for each surface, a line for each subject."""
    figure, panels = _panels(len(series))
    for panel, (surface, lines) in zip(panels, series.items(), strict=True):
        for subject, points in lines.items():
            error, triangles = np.array(sorted(points)).T
            panel.plot(error, triangles, "o-", ms=4, label=subject)
        panel.set_xscale("log")
        panel.set_yscale("log")
        panel.set_title(surface, fontsize=10)
        panel.set_xlabel("largest error at a sample [scene units]")
        panel.set_ylabel("triangles")
        panel.grid(True, which="both", lw=0.3, alpha=0.5)
        panel.legend(fontsize=8)
    _save(figure, path)


def displaced(
    points: Mapping[tuple[str, str], Mapping[str, tuple[float, float]]], ours: Sequence[str], path: Path
) -> None:
    """Plot time against error: a panel for each map, a line of meshes and marks of `ours` for each size of picture."""
    maps, sizes = (list(dict.fromkeys(key[axis] for key in points)) for axis in (0, 1))
    figure, panels = _panels(len(maps))
    for (name, size), found in points.items():
        panel, color = panels[maps.index(name)], f"C{sizes.index(size)}"
        error, time = np.array([value for subject, value in found.items() if subject not in ours]).T
        panel.plot(100 * error, time, "o-", color=color, ms=4, label=f"meshes, {size}")
        for mark, subject in zip("*PsD", ours, strict=True):
            label = subject if size == sizes[0] else None
            panel.plot(100 * found[subject][0], found[subject][1], mark, color=color, ms=10, mec="k", label=label)
    for name, panel in zip(maps, panels, strict=True):
        _logarithmic(panel, "time of a picture [ms]", "mean error [% of the map's depth]")
        panel.set_xscale("log")
        panel.xaxis.set_minor_formatter(lambda value, _: "")
        panel.set_title(f"{name} map", fontsize=10)
        panel.get_legend().remove()
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize=8)
    _save(figure, path)


def _panels(count: int) -> tuple[Any, list[Any]]:
    # pyplot would search for a window system, and keep its figures open.
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5.5 * count, 4.4), layout="constrained")
    return figure, list(np.atleast_1d(figure.subplots(1, count)))


def _logarithmic(panel: Any, label: str, across: str = "side of the image [pixels]") -> None:
    panel.set_xscale("log", base=2)
    panel.set_yscale("log")
    panel.xaxis.set_major_formatter("{x:.0f}")
    panel.set_xlabel(across)
    panel.set_ylabel(label)
    panel.grid(True, which="both", lw=0.3, alpha=0.5)
    panel.legend(fontsize=8)


def _save(figure: Any, path: Path) -> None:
    figure.savefig(path, dpi=120)
