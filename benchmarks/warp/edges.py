"""Counts the errors of edge tests in scenes with known depth edges. Nothing is timed.

A sample is torn if the test cuts it from a neighbour on the same surface. It is part of a sheet if the test joins it to
another surface. pyibr's default test is compared with two limits on the ratio of depths, for each kind of noise.
"""

from __future__ import annotations

import functools
import zlib
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

import pyibr as ibr
from benchmarks import scenes
from benchmarks.cases import Plan
from benchmarks.results import Parameter, Record
from benchmarks.runner import Case, Work
from benchmarks.warp.edge_noises import NOISES, noisy
from benchmarks.warp.edge_scenes import SCENES, Scene
from benchmarks.warp.solids import ONE_SURFACE, TWO_SURFACES
from pyibr.opencl.headers import constant
from pyibr.opencl.memory import to_host
from pyibr.picture.surface import surface_of

Array = NDArray[Any]
Size = tuple[int, int]

AUTOMATIC = "automatic"
RATIOS = (1.02, 1.05)
WAYS: dict[str, float | None] = {AUTOMATIC: None, **{f"cut_ratio={ratio:g}": ratio for ratio in RATIOS}}
TORN, SHEETS = "torn", "sheets"
BASE = "cut_ratio=1.05"
BARS = {TORN: (0.3, 0), SHEETS: (1.1, 30)}
"""Limits for the default test's counts over all scenes: a multiple of the count of `BASE`, plus a number of samples."""
SEPARATOR = ", "  # between the names of noises in a record, which has a value for each
FEW = 100  # image width in samples: in narrower images, the default test must not leave more sheets than `BASE`


def cases(plan: Plan) -> Iterator[Case]:
    """One case per size and scene, with all noises and edge tests."""
    for size in plan.edges:
        for scene in SCENES[:: plan.edge_scenes]:
            if scene.is_resolved(size[0]):
                parameters: dict[str, Parameter] = {"size": scenes.shown(size), "scene": scene.name}
                yield Case(parameters, functools.partial(_prepare, parameters, size, scene))


def torn_and_sheets(view: ibr.DepthImage, cut_ratio: float | None, right: Array, below: Array) -> tuple[int, int]:
    """Count samples that are torn off their own surface, and samples that are joined to another surface.

    Parameters
    ----------
    view : DepthImage
    cut_ratio : float or None
        As in `WarpedView`.
    right, below : int8 (H, W - 1), (H - 1, W)
        Truth about the right and lower neighbours, as `solids.sampled` returns it.
    """
    width, height = view.camera.size
    surface = to_host([surface_of(view, cut_ratio).nearness])[0][1 : height + 1, 1 : width + 1]
    bits = np.ascontiguousarray(surface).view(np.int32)
    found = np.zeros((2, height, width), bool)
    for truth, name, at in ((right, "TORN_RIGHT", np.s_[:, :-1]), (below, "TORN_BELOW", np.s_[:-1])):
        torn = (bits[at] & int(constant("lib/surface.h", name))) != 0
        found[0][at] |= torn & (truth == ONE_SURFACE)
        found[1][at] |= ~torn & (truth == TWO_SURFACES)
    return int(found[0].sum()), int(found[1].sum())


def view_of(depth: Array, camera: ibr.Camera, scene: str, noise: str) -> ibr.DepthImage:
    """Add noise to exact depth; the same scene, kind of noise and size always get the same values."""
    seed = zlib.crc32(f"{scene}, {noise}, {camera.size}".encode())
    return ibr.DepthImage(None, noisy(depth, noise, seed), camera)


def _prepare(parameters: dict[str, Parameter], size: Size, scene: Scene) -> Work:
    def read() -> Iterator[Record]:
        depth, right, below = scene.sampled(*size)
        counts: dict[str, list[tuple[int, int]]] = {way: [] for way in WAYS}
        for noise in NOISES:
            view = view_of(depth, scene.camera(*size), scene.name, noise)
            for way, ratio in WAYS.items():
                counts[way].append(torn_and_sheets(view, ratio, right, below))
        noises: dict[str, Parameter] = {"noises": SEPARATOR.join(NOISES)}
        for way, quantities in counts.items():
            for quantity, values in zip((TORN, SHEETS), zip(*quantities, strict=True), strict=True):
                yield Record(way, quantity, "samples", {**parameters, **noises}, list(values))

    return Work(read=read)
