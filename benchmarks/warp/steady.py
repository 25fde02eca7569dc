"""Measures how much warps change over time if a noisy camera and its scene are at rest.

Three depths are compared: raw depth, depth cleaned frame by frame, and depth cleaned with the help of the frame before.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

import pyibr as ibr
from benchmarks import scenes
from benchmarks.cases import Plan
from benchmarks.results import Parameter, Record, Skip
from benchmarks.runner import Case, Work

Size = tuple[int, int]

INPUT, RAW, SINGLE, STEADY = "input", "as it comes", "cleaned frame by frame", "cleaned with before"
SEEN, HOLES = "seen", "holes"
DEPTH, COLOR = "depth deviation", "colour deviation"

NOISE = 0.3  # standard deviation in pixels of disparity
LOST = 0.05  # fraction of the samples that are missing
COLOR_NOISE = 2.0  # standard deviation in levels of 255

MOTIONS: dict[str, tuple[tuple[int, ...], int | None]] = {
    "0 to 4": ((0,), 4),
    "50 to 0": ((50,), 0),
    "0 to 7 cm sideways": ((0,), None),
    "0 and 50 to 4": ((0, 50), 4),
}
"""By name: the frames that are warped, and the frame whose camera is the target."""

ASIDE = 0.07  # metres sideways
FILLS: tuple[Any, ...] = ("background", "smooth", "inpaint")

Frame = tuple[NDArray[np.uint8], NDArray[np.float32]]


def cases(plan: Plan, scene: str) -> Iterator[Case]:
    """One case per size and motion."""
    for size, frames in plan.rgbd_steady.items():
        for motion in MOTIONS:
            parameters: dict[str, Parameter] = {
                "case": "steady",
                "scene": scene,
                "size": scenes.shown(size),
                "motion": motion,
                "frames": frames,
            }
            yield Case(parameters, functools.partial(_prepare, parameters, size, frames))


def _prepare(parameters: dict[str, Parameter], size: Size, count: int) -> Work | Skip:
    scene, (numbers, to) = str(parameters["scene"]), MOTIONS[str(parameters["motion"])]
    views: list[ibr.DepthImage] = []
    for number in numbers:
        if isinstance(view := scenes.rgbd(scene, number, size), Skip):
            return view
        views.append(view)
    target = views[0].camera.moved(ASIDE, 0, 0) if to is None else scenes.depth_camera(scene, to, size)

    def read() -> Iterator[Record]:
        recorded = [[noisy(view, frame) for frame in range(count)] for view in views]
        cleaned = {how: [depths(frames, how) for frames in recorded] for how in (RAW, SINGLE, STEADY)}
        for quantity, value in _input(recorded[0]):
            yield Record(INPUT, quantity, _unit(quantity), {**parameters, "fill": "", "where": INPUT}, [value])
        exact = [ibr.DepthImage(v.color, ibr.clean_depth(v.depth, v.color).depth, v.camera) for v in views]
        seen = ibr.warp(exact, target).valid
        for fill, (how, found) in itertools.product(FILLS, cleaned.items()):
            shown = [ibr.warp(_frame(views, recorded, found, k), target, fill=fill) for k in range(count)]
            for where, part in ((SEEN, seen), (HOLES, ~seen)):
                at: dict[str, Parameter] = {**parameters, "fill": fill, "where": where}
                for quantity, value in _deviations(shown, part):
                    yield Record(how, quantity, _unit(quantity), at, [value])

    return Work(read=read)


def _frame(
    views: list[ibr.DepthImage], recorded: list[list[Frame]], found: list[list[NDArray[np.float32]]], k: int
) -> list[ibr.DepthImage]:
    """The views' depth images at frame `k`, with recorded colours and the depths `found`."""
    of_each = zip(views, recorded, found, strict=True)
    return [ibr.DepthImage(frames[k][0], own[k], view.camera) for view, frames, own in of_each]


def noisy(view: ibr.DepthImage, number: int) -> Frame:
    """Colour and depth of a view as from a real camera: with noise, different in each frame, and lost samples."""
    rng = np.random.default_rng([number, view.camera.width])
    depth = scenes.with_disparity_noise(view.depth, float(view.camera.K[0, 0]), NOISE, rng)
    depth[rng.random(depth.shape) < LOST] = np.nan
    color = view.color + rng.normal(0, COLOR_NOISE, view.color.shape)
    return np.clip(np.rint(color), 0, 255).astype(np.uint8), depth


def depths(frames: list[Frame], how: str) -> list[NDArray[np.float32]]:
    """The depth of each frame, raw or cleaned as `how` says."""
    if how == RAW:
        return [depth for _, depth in frames]
    cleaned: list[NDArray[np.float32]] = []
    for color, depth in frames:
        before = cleaned[-1] if cleaned and how == STEADY else None
        cleaned.append(ibr.clean_depth(depth, color, before=before).depth)
    return cleaned


def _unit(quantity: str) -> str:
    return "scene units" if quantity == DEPTH else "share"


def _input(frames: list[Frame]) -> Iterator[tuple[str, float]]:
    stacked = np.stack([depth for _, depth in frames])
    known = np.isfinite(stacked).sum(axis=0) > 1
    yield DEPTH, float(np.nanstd(stacked[:, known], axis=0).mean())
    yield COLOR, float(np.stack([color for color, _ in frames]).std(axis=0, dtype=np.float32).mean()) / 255


def _deviations(shown: list[ibr.Frame], part: NDArray[np.bool_]) -> Iterator[tuple[str, float]]:
    """Compute each pixel's standard deviation over time, and its mean over the pixels of a part."""
    if part.any():
        yield DEPTH, float(np.stack([frame.depth[part] for frame in shown]).std(axis=0).mean())
        colors = np.stack([frame.color[part] for frame in shown])
        yield COLOR, float(colors.std(axis=0, dtype=np.float32).mean()) / 255
