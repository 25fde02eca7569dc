"""Frusta that cover a surface with depth images, and the depth images that they see.

After Schaufler and Priglinger, "Efficient Displacement Mapping by Image Warping" (1999), sections 6 and 7.1: samples at
a frustum's far plane are empty, and far depth is painted over unwanted parts of its image.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pyibr.capture.clouds import surface_colors
from pyibr.capture.sets import SetEntry, entry_json, read_set, write_set
from pyibr.core.camera import Camera
from pyibr.core.camera_json import write_json
from pyibr.core.checks import Float64, checked_box, describe, instance_of, number_from, positive_or_infinite
from pyibr.core.errors import ArgumentError, FileFormatError
from pyibr.images import DepthImage
from pyibr.picture.light import Light
from pyibr.picture.render import Thing, render

_ANGLE_MIN, _ANGLE_MAX = 0.1, 170.0  # degrees


@dataclass(frozen=True)
class Stroke:
    """Brush stroke over a frustum's image: discs along a polyline.

    Attributes
    ----------
    points : tuple of (x, y)
        In widths and heights of the image, from (0, 0) at its upper left corner to (1, 1).
    radius : float
        In heights of the image.
    erases : bool
        Whether the stroke removes paint.
    """

    points: tuple[tuple[float, float], ...]
    radius: float
    erases: bool = False

    def mask(self, size: tuple[int, int]) -> NDArray[np.bool_]:
        """(H, W) mask of the pixels whose centres the stroke covers, in an image of this size."""
        width, height = size
        x, y = (np.arange(width) + 0.5)[None, :], (np.arange(height) + 0.5)[:, None]
        places = np.array(self.points, np.float64).reshape(-1, 2) * size
        covered, reach = np.zeros((height, width), np.bool_), self.radius * height
        for start, end in zip(places, [*places[1:], places[-1]] if len(places) else places, strict=True):
            along = end - start
            part = ((x - start[0]) * along[0] + (y - start[1]) * along[1]) / max(float(along @ along), 1e-30)
            part = np.clip(part, 0, 1)
            covered |= (x - start[0] - part * along[0]) ** 2 + (y - start[1] - part * along[1]) ** 2 <= reach**2
        return covered


@dataclass(frozen=True)
class Frustum:
    """Camera and far plane of a depth image, with the paint over it.

    Parameters
    ----------
    camera : Camera
        Perspective, without a lens; its axis meets the middle of its image.
    far : float
        Depth of the far plane; samples at or beyond it are empty.
    strokes : tuple of Stroke
        Painted areas, whose samples are empty, in the order of painting.

    Raises
    ------
    ArgumentError
        If the camera is of another kind, or `far` is not > 0.

    Examples
    --------
    >>> from pyibr.capture import models
    >>> from pyibr.capture.frusta import Frustum
    >>> frustum = Frustum.look_at((0, 0, 3), (0, 0, 0), (0, 1, 0), 64, fov=60, far=4)
    >>> view = frustum.capture(models.donut())
    >>> view.camera.size, bool(view.valid[32, 50]), bool(view.valid[32, 32])  # the ring, and the hole in it
    ((64, 64), True, False)
    """

    camera: Camera
    far: float = math.inf
    strokes: tuple[Stroke, ...] = ()

    def __post_init__(self) -> None:
        camera = instance_of("camera", self.camera, Camera, "a pyibr.Camera")
        width, height = camera.size
        centred = np.abs(camera.K[:2, 2] - ((width - 1) / 2, (height - 1) / 2)).max() <= 1e-6 * max(width, height)
        if camera.projection != "perspective" or camera.lens is not None or camera.K[0, 1] != 0 or not centred:
            raise ArgumentError("camera", "a perspective camera without lens, its axis in the middle", describe(camera))
        positive_or_infinite("far", self.far, "a depth > 0, or infinity")

    @classmethod
    def look_at(
        cls, eye: ArrayLike, target: ArrayLike, up: ArrayLike, size: int, *, fov: float = 60.0, far: float = math.inf
    ) -> Frustum:
        """Make a frustum at `eye` around `target`; `up` is any direction not parallel to the line of sight."""
        return cls(Camera.look_at(eye, target, up, (size, size), fov_y=fov), far)

    @property
    def fov(self) -> tuple[float, float]:
        """Angles of view in degrees: (across, down)."""
        (fx, fy), (width, height) = np.diag(self.camera.K)[:2], self.camera.size
        return 2 * math.degrees(math.atan(width / (2 * fx))), 2 * math.degrees(math.atan(height / (2 * fy)))

    def at(self, world_from_camera: ArrayLike) -> Frustum:
        """Return the frustum with another pose."""
        return Frustum(Camera(self.camera.K, self.camera.size, world_from_camera), self.far, self.strokes)

    def opened(self, across: float, down: float, far: float) -> Frustum:
        """Return the frustum with other angles of view, in degrees, and another far plane."""
        (width, height), K = self.camera.size, np.eye(3)
        for axis, (degrees, count) in enumerate(((across, width), (down, height))):
            expected = f"degrees from {_ANGLE_MIN:g} to {_ANGLE_MAX:g}"
            angle = number_from("fov", degrees, _ANGLE_MIN, _ANGLE_MAX, expected)
            K[axis, axis], K[axis, 2] = count / (2 * math.tan(math.radians(angle) / 2)), (count - 1) / 2
        return Frustum(Camera(K, (width, height), self.camera.world_from_camera), far, self.strokes)

    def resized(self, size: int) -> Frustum:
        """Return the frustum with square images of another size."""
        return Frustum(self.camera.resized((size, size)), self.far, self.strokes)

    def painted(self, *strokes: Stroke) -> Frustum:
        """Return the frustum with further strokes."""
        return Frustum(self.camera, self.far, (*self.strokes, *strokes))

    @cached_property
    def mask(self) -> NDArray[np.bool_]:
        """(H, W) mask of the painted samples, which are empty."""
        covered = np.zeros((self.camera.height, self.camera.width), np.bool_)
        for stroke in self.strokes:
            covered = (
                covered & ~stroke.mask(self.camera.size) if stroke.erases else covered | stroke.mask(self.camera.size)
            )
        return covered

    def capture(self, thing: Thing, light: Light | None = None) -> DepthImage:
        """Take the depth image of an object or a scene.

        Parameters
        ----------
        thing : thing
            Object or scene to draw, as for `pyibr.render`.
        light : Light, optional
            Light of the picture, baked into its colours; see `pyibr.picture.light.light_for`.

        Returns
        -------
        DepthImage
            Depth is infinite where there is no surface, or where it is painted as empty.
        """
        frame = render(thing, self.camera, light)
        depth = np.where(frame.valid & ~self.mask, frame.depth, np.float32(np.inf))
        return DepthImage(surface_colors(frame), depth, self.camera, far=self.far)

    def to_json(self) -> dict[str, Any]:
        """Return the frustum's entry in a file."""
        return entry_json(self.camera, self.far) | self._more

    @property
    def _more(self) -> dict[str, Any]:
        """Fields of its entry in a file that not every view has."""
        if not self.strokes:
            return {}
        kept = [
            {"points": [list(point) for point in one.points], "radius": one.radius}
            | ({"erases": True} if one.erases else {})
            for one in self.strokes
        ]
        return {"strokes": kept}


def save_frusta(path: str | PathLike[str], frusta: Sequence[Frustum], **about: object) -> None:
    """Write frusta alone, without their images, as a JSON file; `about` describes the set."""
    write_json(path, {**about, "views": [frustum.to_json() for frustum in frusta]})


def save_set(
    folder: str | PathLike[str], frusta: Sequence[Frustum], views: Sequence[DepthImage], **about: object
) -> None:
    """Write frusta and their images into a folder, which `pyibr.load` reads; see `write_set`."""
    write_set(folder, views, [frustum._more for frustum in frusta], **about)  # pyright: ignore[reportPrivateUsage]


def load_frusta(path: str | PathLike[str]) -> tuple[list[Frustum], dict[str, Any]]:
    """Read the frusta of a set from its folder or JSON file, and the file's other fields.

    Raises
    ------
    FileFormatError
        If the file cannot be read as a set.
    """
    entries, about = read_set(path)
    return frusta_of(entries, path), about


def part_of(about: dict[str, Any], path: str | PathLike[str]) -> Float64 | None:
    """Box, (2, 3), of the part of a surface that a set covers, from its file; None for the whole surface."""
    if about.get("within") is None:
        return None
    try:
        return checked_box("within", about["within"])
    except ArgumentError as error:
        raise FileFormatError(f"{path}: {error}") from error


def frusta_of(entries: Sequence[SetEntry], path: str | PathLike[str]) -> list[Frustum]:
    """Frusta of the views of a set; `path` is for error messages."""
    frusta: list[Frustum] = []
    for entry in entries:
        strokes = tuple(_stroke_of(one, path) for one in _listed(entry.more.get("strokes", []), path))
        try:
            frusta.append(Frustum(entry.camera, entry.far, strokes))
        except ArgumentError as error:
            raise FileFormatError(f"{path}: {error}") from error
    return frusta


def _stroke_of(data: object, path: str | PathLike[str]) -> Stroke:
    try:
        entry = cast("dict[str, Any]", data)
        points = tuple((float(x), float(y)) for x, y in entry["points"])
        return Stroke(points, float(entry["radius"]), bool(entry.get("erases", False)))
    except (TypeError, ValueError, KeyError, AttributeError):
        raise FileFormatError(f"{path}: expected a stroke with points and radius, got {describe(data)}") from None


def _listed(data: object, path: str | PathLike[str]) -> list[object]:
    if not isinstance(data, list):
        raise FileFormatError(f"{path}: expected a list of strokes, got {describe(data)}")
    return cast("list[object]", data)
