"""Repeats table 2 of Schaufler and Priglinger (1999), who measured on a 250 MHz R10000.

Torus and globe are drawn from six depth images, the dragon's head from sixteen. The paper does not say from where its
torus and its globe are seen. Here, cameras around the torus and the head take their images, whose surfaces are cut at
depth edges. The globe's images are taken at its centre, and its surface is not cut. Cast rays check each picture.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

import pyibr as ibr
from benchmarks.cases import Plan
from benchmarks.launches import kernel_times
from benchmarks.models import DRAGON_HEAD, dragon_head, dragon_scene, globe, load_earth, torus
from benchmarks.results import Record, Skip
from benchmarks.runner import Case, Subject, Work
from benchmarks.scenes import data_folder
from pyibr.capture import MeshScene, models
from pyibr.capture.frusta import load_frusta, part_of
from pyibr.images.depth_image import Side
from pyibr.warp.view import Edges

Mask = NDArray[np.bool_]

PAPER = {
    "torus": {128: 50.3, 256: 201.3, 512: 775.2},
    "globe": {128: 52.3, 256: 291.1, 512: 836.2},
    "dragon": {128: 84.2, 256: 321.8, 512: 1227.6},
}
"""The paper's milliseconds per picture, by model and by the side of views and picture."""

IMAGES = {"torus": 6, "globe": 6, "dragon": 16}

SUBJECTS: dict[str, Literal["nearest", "linear"]] = {"nearest": "nearest", "linear": "linear"}
"""Ways of interpolation; the paper's is nearest."""
FRESH = "nearest, fresh views"  # DepthImages made anew, so that everything is prepared again

OFF, UNCOVERED = "off", "uncovered"
RIGHT = {OFF: 0.01, UNCOVERED: 0.02}
"""Largest accepted fractions of pixels that are off or uncovered, in pictures of 96 x 96 or more.

They are not 0, because a depth image shows the end of a surface only to within a sample, and 6 to 21 % of these models'
pixels lie at outlines at 96 x 96. Surfaces extend half a sample past their end, unless rays of another view pass there.
"""
_OFF = 0.02  # relative to the depth
_GLOBE_FINEST = 640  # largest side of the images whose triangulated samples serve as the true globe


@dataclass(frozen=True)
class Model:
    """Depth images, the options that draw them, and the true picture.

    Attributes
    ----------
    views : list of DepthImage
    camera : Camera
        Camera of the picture.
    side, edges : str
        As for `ibr.warp`.
    truth : DepthImage
        Depth by rays cast from the picture's camera at the true surface.
    covers : (H, W) bool
        Pixels of the picture that the views should cover.
    """

    views: list[ibr.DepthImage]
    camera: ibr.Camera
    side: Side
    edges: Edges
    truth: ibr.DepthImage
    covers: Mask

    def picture(self, sample: Literal["nearest", "linear"], fresh: bool = False) -> ibr.Frame:
        """Draw the picture that is timed; `fresh` makes its views anew."""
        views = self.views
        if fresh:
            views = [ibr.DepthImage(view.color, view.depth, view.camera, far=view.far) for view in views]
        return ibr.warp(views, self.camera, interpolation=sample, side=self.side, edges=self.edges, blend="nearest")


def cases(plan: Plan) -> Iterator[Case]:
    """One case per model and size."""
    for model in PAPER:
        for n, repeats in plan.table2.items():
            prepare = functools.partial(_prepare, model, n, repeats, plan.dragon_mesh)
            yield Case({"model": model, "size": n}, prepare)


def _prepare(name: str, n: int, repeats: int, mesh: str) -> Work | Skip:
    model = made(name, n, mesh)
    if isinstance(model, Skip):
        return model

    def read() -> Iterator[Record]:
        parameters = {"model": name, "size": n}
        for subject, sample in SUBJECTS.items():
            with kernel_times() as times:
                frame = model.picture(sample)
            yield Record(subject, "kernels", "ms", parameters, [sum(map(sum, times.values()))])
            for quantity, share in rightness(frame, model.truth, model.covers).items():
                yield Record(subject, quantity, "share", parameters, [share])

    subjects: dict[str, Subject] = {
        subject: functools.partial(model.picture, sample) for subject, sample in SUBJECTS.items()
    }
    return Work({**subjects, FRESH: functools.partial(model.picture, "nearest", True)}, repeats, read)


def rightness(frame: ibr.Frame, truth: ibr.DepthImage, covers: Mask) -> dict[str, float]:
    """Compare a picture with the hits of its camera's rays.

    Returns
    -------
    dict
        `OFF`: the fraction of the picture's valid pixels whose depth is off by more than 2 %, or whose rays hit
        nothing. `UNCOVERED`: the fraction of the pixels in the mask `covers` that the picture does not show.
    """
    with np.errstate(invalid="ignore"):
        is_right = np.abs(frame.depth / truth.depth - 1) <= _OFF
    shown = max(np.count_nonzero(frame.valid), 1)
    return {
        OFF: float(np.count_nonzero(frame.valid & ~is_right) / shown),
        UNCOVERED: float(np.count_nonzero(covers & ~frame.valid) / max(np.count_nonzero(covers), 1)),
    }


def made(name: str, n: int, mesh: str) -> Model | Skip:
    """Make a model with images of n x n pixels; `mesh` is the name of the dragon's file."""
    makers: dict[str, Callable[[], Model | Skip]] = {
        "torus": functools.partial(_torus, n),
        "globe": functools.partial(_globe, n),
        "dragon": functools.partial(_dragon, n, mesh),
    }
    try:
        return makers[name]()
    except ibr.MissingPackageError as error:
        return Skip(name, str(error))


def _torus(n: int) -> Model:
    views = torus(n)
    camera = models.view(views, (n, n))
    truth = MeshScene.from_mesh(models.torus_mesh()).capture(camera)
    return Model(views, camera, "front", "cut", truth, truth.valid)


def _globe(n: int) -> Model:
    folder = data_folder() / "heightfields/earth"
    earth: tuple[Any, ...] = load_earth(folder) if folder.is_dir() else ()
    views = globe(n, *earth)
    camera = models.view(views, (n, n))
    truth = _grids(globe(min(4 * n, _GLOBE_FINEST), *earth[:1])).capture(camera)
    return Model(views, camera, "back", "connect", truth, truth.valid)


def _dragon(n: int, mesh: str) -> Model | Skip:
    path = data_folder() / "meshes" / mesh
    if not path.is_file():
        return Skip("dragon", f"{mesh} is not in $PYIBR_DATA/meshes")
    views = dragon_head(path, n)
    camera = models.view(views, (n, n))
    truth = dragon_scene(path).capture(camera)
    part = part_of(load_frusta(DRAGON_HEAD)[1], DRAGON_HEAD)
    low, high = np.sort(np.asarray(part) * (1, -1, -1), axis=0)  # in the views, up is -y
    y, x = np.nonzero(truth.valid)
    points = camera.unproject(np.column_stack([x, y]), truth.depth[y, x])
    covers = np.zeros(truth.valid.shape, np.bool_)
    covers[y, x] = ((points >= low) & (points <= high)).all(axis=1)
    return Model(views, camera, "front", "cut", truth, covers)


def _grids(views: list[ibr.DepthImage]) -> MeshScene:
    """Join the samples of images that have depth everywhere to a triangle mesh."""
    vertices: list[Any] = []
    faces: list[Any] = []
    for view in views:
        height, width = view.depth.shape
        y, x = np.mgrid[:height, :width]
        number = y * width + x + sum(map(len, vertices))
        a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]
        faces.append(np.stack([np.stack([a, b, c], -1), np.stack([d, c, b], -1)]).reshape(-1, 3))
        vertices.append(view.camera.unproject(np.stack([x, y], -1).reshape(-1, 2), view.depth.ravel()))
    return MeshScene(np.concatenate(vertices), np.concatenate(faces))
