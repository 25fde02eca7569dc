"""The globe of the papers' models: six depth images that look outwards from its centre."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr import io
from pyibr.capture.raycast import cube_cameras
from pyibr.capture.rays import pixel_centers
from pyibr.core.checks import Float64, describe, numbers
from pyibr.core.errors import ArgumentError
from pyibr.images import DepthImage

Float32 = NDArray[np.float32]
Uint8 = NDArray[np.uint8]


def globe(
    size: int, elevation: Float32 | None = None, color: Uint8 | None = None, *, relief: float = 0.08
) -> list[DepthImage]:
    """Make a globe of radius 1 about the origin, displaced outwards from its centre, as six depth images.

    The images are the faces of a cube at the globe's centre (see `cube_cameras`). A viewer outside sees the back of
    the surface, so draw the images with `side="back"`. Draw them with `edges="connect"`, too, because the surface is
    connected even where it is steep. Depth is exact at the samples: no ray is cast.

    Parameters
    ----------
    size : int
        Width and height of each image in pixels.
    elevation : (h, w) float32 in [0, 1], optional
        Equirectangular: longitude -180 to 180 degrees along the rows, latitude 90 to -90 down the columns.
        Read bilinearly. Default: continents from noise with a fixed seed.
    color : (h', w', 3) uint8, optional
        Equirectangular. Default: a colour scale of the elevation.
    relief : float
        Displacement at elevation 1, in radii.

    Examples
    --------
    >>> from pyibr.capture.models import globe
    >>> len(globe(16)), globe(16)[0].depth.shape
    (6, (16, 16))
    """
    raised = float(numbers("relief", relief, ()))
    if elevation is not None and (np.ndim(elevation) != 2 or not np.isfinite(elevation).all()):
        raise ArgumentError("elevation", "finite numbers of shape (h, w)", describe(elevation))
    if color is not None and (np.ndim(color) != 3 or color.shape[2] != 3 or color.dtype != np.uint8):
        raise ArgumentError("color", "uint8 of shape (h, w, 3)", describe(color))
    views: list[DepthImage] = []
    for camera in cube_cameras((0, 0, 0), size):
        ray = camera.unproject(pixel_centers(camera), np.ones(size * size))
        length = np.linalg.norm(ray, axis=1)
        direction = ray / length[:, None]
        height = _noise(direction) if elevation is None else _on_sphere(elevation[..., None], direction)[:, 0]
        painted = _hypsometric(height) if color is None else _on_sphere(color, direction)
        depth = ((1 + raised * height) / length).astype(np.float32)
        views.append(DepthImage(in_bytes(painted).reshape(size, size, 3), depth.reshape(size, size), camera))
    return views


def load_earth(folder: str | PathLike[str]) -> tuple[Float32, Uint8]:
    """Read the earth for `globe`: elevation (h, w) float32 in [0, 1] and colour (h', w', 3) uint8.

    Parameters
    ----------
    folder : path
        Holds `earth-topology.png` and `earth-blue-marble.jpg`, both equirectangular.
    """
    height = io.read_color(Path(folder) / "earth-topology.png")
    color = io.read_color(Path(folder) / "earth-blue-marble.jpg")
    return (height[..., 0] / 255).astype(np.float32), in_bytes(np.asarray(color, np.float64))


def in_bytes(values: Float64) -> Uint8:
    """Return colours from 0 to 255 as bytes, rounded."""
    return np.clip(np.floor(values + 0.5), 0, 255).astype(np.uint8)


def _on_sphere(image: NDArray[Any], direction: Float64) -> Float64:
    """Bilinear samples (n, C) of an equirectangular image (h, w, C) in directions (n, 3)."""
    height, width = image.shape[:2]
    x, y, z = direction.T
    u = (np.arctan2(x, -z) / (2 * np.pi) + 0.5) * width - 0.5
    v = np.clip((np.arcsin(np.clip(y, -1, 1)) / np.pi + 0.5) * height - 0.5, 0, height - 1)
    column, row = np.floor(u).astype(np.int64), np.floor(v).astype(np.int64)
    fu, fv = (u - column)[:, None], (v - row)[:, None]
    left, right, below = column % width, (column + 1) % width, np.minimum(row + 1, height - 1)
    top = (1 - fu) * image[row, left] + fu * image[row, right]
    return (1 - fv) * top + fv * ((1 - fu) * image[below, left] + fu * image[below, right])


def _noise(direction: Float64) -> Float64:
    """Elevation of continents (0 is sea) in directions (n, 3): octaves of plane waves with a fixed seed."""
    random = np.random.default_rng(1999)
    total = np.zeros(len(direction))
    for octave in range(7):
        for _ in range(6):
            wave = random.normal(size=3)
            wave *= 2.2 * 1.9**octave / np.linalg.norm(wave)
            total += 0.58**octave * np.sin(direction @ wave + random.uniform(0, 2 * np.pi))
    return np.clip((total - 0.1) / 7.0, 0, 1)


def _hypsometric(height: Float64) -> Float64:
    """Colours (n, 3), 0 to 255, from the sea over beaches, plains and rock to snow."""
    stops = [0.0, 0.004, 0.03, 0.2, 0.45, 0.7]
    colors = np.array([[22, 60, 120], [205, 190, 130], [70, 130, 60], [110, 120, 60], [130, 105, 85], [245, 245, 250]])
    return np.stack([np.interp(height, stops, colors[:, channel]) for channel in range(3)], axis=1)
