"""Measures how much cleaning improves depth, and times it against a NumPy twin and OpenCV's bilateral filter.

Times run from NumPy arrays to NumPy arrays, measured in turns in one process.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

import pyibr as ibr
from benchmarks import scenes
from benchmarks.cases import Plan
from benchmarks.cleaning import twin
from benchmarks.results import Parameter, Record, Skip
from benchmarks.runner import Case, Subject, Work
from pyibr.core.optional import opencv

Size = tuple[int, int]
Depth = NDArray[np.float32]

CLEANED, STEADY = "ibr.clean_depth", "ibr.clean_depth, before"
TWIN, BILATERAL = "NumPy twin", "cv2.bilateralFilter"

BARS = {"640 x 480": 0.1, "1280 x 720": 0.1, "1920 x 1440": 0.1}
"""Largest ratio of the time of `CLEANED` to the twin's time, by size."""

LOST = 0.05  # fraction of the samples that are removed
HOLE = 16  # side of a square hole in pixels; BLOCK x BLOCK such squares contain one hole
BLOCK = 8


def cases(plan: Plan) -> Iterator[Case]:
    """One case for each size and noise."""
    scene, missing = scenes.standing_in(plan.rgbd_scene)
    if missing is not None:
        yield Case({"case": "cleaning"}, lambda: missing)
    for size, repeats in plan.cleaning.items():
        for noise in plan.rgbd_noise:
            if noise:
                parameters: dict[str, Parameter] = {"scene": scene, "size": scenes.shown(size), "noise": noise}
                yield Case(parameters, functools.partial(_prepare, parameters, scene, size, noise, repeats))


def torn(depth: Depth) -> Depth:
    """Remove a twentieth of the samples, and square holes."""
    rng, holes = np.random.default_rng(depth.shape), depth.copy()
    y, x = (np.arange(side) // HOLE % BLOCK == BLOCK // 2 for side in depth.shape)
    holes[(rng.random(depth.shape) < LOST) | (y[:, None] & x)] = np.nan
    return holes


def _prepare(parameters: dict[str, Parameter], scene: str, size: Size, noise: float, repeats: int) -> Work | Skip:
    cv2 = opencv("the benchmark of cleaned depth", "bilateralFilter")
    clean, noisy = (scenes.rgbd(scene, 0, size, each) for each in (0.0, noise))
    if isinstance(clean, Skip) or isinstance(noisy, Skip):
        return clean if isinstance(clean, Skip) else Skip(scene, "it is not there")
    truth, depth, color = clean.depth, torn(noisy.depth), clean.color
    before = ibr.clean_depth(depth, color).depth
    nearness = np.nan_to_num(1 / depth)
    spread = float(np.nanstd(1 / noisy.depth - 1 / truth))

    subjects: dict[str, Subject] = {
        CLEANED: lambda: ibr.clean_depth(depth, color),
        STEADY: lambda: ibr.clean_depth(depth, color, before=before),
        TWIN: lambda: twin.clean_depth(depth, color),
        BILATERAL: lambda: cv2.bilateralFilter(nearness, 11, 6.6 * spread, 3.0),
    }

    def read() -> Iterator[Record]:
        made: dict[str, Callable[..., Any]] = {CLEANED: ibr.clean_depth, TWIN: twin.clean_depth}
        for name, call in made.items():
            yield Record(name, "gain", "dB", parameters, [_gain(call(depth, color).depth, depth, truth)])

    return Work(subjects, repeats, read)


def _gain(found: Depth, depth: Depth, truth: Depth) -> float:
    """Return by how many dB the mean error of nearness (1/depth) falls, over the pixels that had a sample."""
    both = np.isfinite(depth) & np.isfinite(found) & np.isfinite(truth)
    before, after = (np.abs(1 / d - 1 / truth)[both].mean() for d in (depth, found))
    return 20 * float(np.log10(before / after))
