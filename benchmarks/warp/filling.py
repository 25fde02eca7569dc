"""Measures how far the colours of filled holes are from the true colours, for pyibr's fills and OpenCV's inpainting.

A case warps one picture of a pair to the camera of the other, which holds the true colours. Pairs are frames of a depth
camera's scene, and stereo photographs with known disparity. Nothing is timed.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

import pyibr as ibr
from benchmarks import scenes
from benchmarks.cases import Plan
from benchmarks.results import Parameter, Record, Skip
from benchmarks.runner import Case, Work
from pyibr.core.optional import opencv

Array = NDArray[Any]
Pair = tuple[ibr.DepthImage, ibr.Camera, Array]

FILLS: tuple[Any, ...] = ("background", "smooth", "inpaint")
TELEA = "cv2.inpaint"
RADII = (3, 5)  # pixels around a hole that inpainting reads; the smaller error counts
BETWEEN, HIDDEN = "colour error between surfaces", "colour error where hidden"
FRAMES = (0, 4, 50)


def cases(plan: Plan) -> Iterator[Case]:
    """One case per pair of pictures."""
    scene, missing = scenes.standing_in(plan.rgbd_scene)
    if missing is not None:
        yield Case({"case": "filling"}, lambda: missing)
    for source, target in itertools.permutations(FRAMES, 2):
        yield _case(scene, f"{source} to {target}", functools.partial(_frames, scene, source, target, plan.filling))
    for name in scenes.STEREO:
        yield _case(name, "left to right", functools.partial(scenes.stereo, name))


def _case(scene: str, motion: str, load: Callable[[], Pair | Skip]) -> Case:
    parameters: dict[str, Parameter] = {"scene": scene, "motion": motion}
    return Case(parameters, functools.partial(_prepare, parameters, load))


def _frames(scene: str, source: int, target: int, size: tuple[int, int]) -> Pair | Skip:
    view, truth = (scenes.rgbd(scene, number, size) for number in (source, target))
    if isinstance(view, Skip):
        return view
    return truth if isinstance(truth, Skip) else (view, truth.camera, truth.color)


def _prepare(parameters: dict[str, Parameter], load: Callable[[], Pair | Skip]) -> Work | Skip:
    found = load()
    if isinstance(found, Skip):
        return found
    view, camera, truth = found
    return Work(read=lambda: _errors(parameters, view, camera, truth))


def _errors(
    parameters: dict[str, Parameter], view: ibr.DepthImage, camera: ibr.Camera, truth: Array
) -> Iterator[Record]:
    cv2 = opencv("the benchmark of filling", "inpaint")
    bare = ibr.warp(view, camera, classes=True)
    made = {fill: [ibr.warp(view, camera, fill=fill).color] for fill in FILLS}
    holes = (~bare.valid).astype(np.uint8)
    made[TELEA] = [cv2.inpaint(bare.color, holes, radius, cv2.INPAINT_TELEA) for radius in RADII]
    between = ~bare.valid & (bare.classes != ibr.PixelClass.OUTSIDE)
    parts = {BETWEEN: between, HIDDEN: between & (bare.classes == ibr.PixelClass.HIDDEN)}
    for (subject, pictures), (quantity, part) in itertools.product(made.items(), parts.items()):
        if part.any():
            off = min(np.abs(color.astype(float) - truth)[part].mean() for color in pictures)
            yield Record(subject, quantity, "share", parameters, [float(off) / 255])
