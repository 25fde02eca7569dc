"""The paper's table 2: torus and globe of six depth images, dragon of sixteen, beside its 250 MHz R10000.

They are displacement maps there, the dragon's rubber sheets included: `edges="connect"`.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from typing import Any

import pyibr as ibr
from benchmarks.cases import Plan
from benchmarks.launches import kernel_times
from benchmarks.results import Record, Skip
from benchmarks.runner import Case, Subject, Work
from benchmarks.scenes import data_folder
from pyibr.capture import models

PAPER = {
    "torus": {128: 50.3, 256: 201.3, 512: 775.2},
    "globe": {128: 52.3, 256: 291.1, 512: 836.2},
    "dragon": {128: 84.2, 256: 321.8, 512: 1227.6},
}
"""Milliseconds a picture, by model and side of all images (Schaufler & Priglinger 1999)."""

SIDES: dict[str, Any] = {"torus": "both", "globe": "back", "dragon": "front"}
IMAGES = {"torus": 6, "globe": 6, "dragon": 16}

SUBJECTS: dict[str, Any] = {"nearest": "nearest", "linear": "linear"}  # the paper picks the closest sample
FRESH = "nearest, fresh views"  # DepthImages made anew, so that everything is prepared again


def cases(plan: Plan) -> Iterator[Case]:
    """One case a model and size."""
    for model in PAPER:
        for n, repeats in plan.table2.items():
            prepare = functools.partial(_prepare, model, n, repeats, plan.dragon_mesh)
            yield Case({"model": model, "size": n}, prepare)


def _prepare(model: str, n: int, repeats: int, mesh: str) -> Work | Skip:
    made = _views(model, n, mesh)
    if isinstance(made, Skip):
        return made
    views = made
    camera, side = models.view(views, (n, n)), SIDES[model]

    def warp(sample: Any) -> ibr.Frame:
        return ibr.warp(views, camera, sample=sample, side=side, edges="connect", blend="nearest")

    def fresh() -> ibr.Frame:
        again = [ibr.DepthImage(view.color, view.depth, view.camera, view.far) for view in views]
        return ibr.warp(again, camera, sample="nearest", side=side, edges="connect", blend="nearest")

    def read() -> Iterator[Record]:
        parameters = {"model": model, "size": n}
        for name, sample in SUBJECTS.items():
            with kernel_times() as times:
                warp(sample)
            yield Record(name, "kernels", "ms", parameters, [sum(map(sum, times.values()))])
        yield Record("nearest", "coverage", "share", parameters, [float(warp("nearest").valid.mean())])

    subjects: dict[str, Subject] = {name: functools.partial(warp, sample) for name, sample in SUBJECTS.items()}
    return Work({**subjects, FRESH: fresh}, repeats, read)


def _views(model: str, n: int, mesh: str) -> list[ibr.DepthImage] | Skip:
    try:
        if model == "torus":
            return models.torus(n, layers=("last",))
        if model == "globe":
            earth = data_folder() / "heightfields/earth"
            return models.globe(n, *models.load_earth(earth)) if earth.is_dir() else models.globe(n)
        path = data_folder() / "meshes" / mesh
        if not path.is_file():
            return Skip(model, f"{mesh} is not in $PYIBR_DATA/meshes")
        return models.dragon(path, n, IMAGES[model])
    except ibr.MissingPackageError as error:
        return Skip(model, str(error))
