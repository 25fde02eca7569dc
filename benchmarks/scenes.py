"""What is drawn: the relief that is warped, cameras with the epipole in each of the nine regions, scans, bumps.

The regions are those of the warping paper's table 1. The relief is fixed in normalised image coordinates, so that
epipolar segments grow with the image's side.
"""

from __future__ import annotations

import functools
import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import pyibr as ibr
from benchmarks.results import Skip

Array = NDArray[Any]

REGIONS = "ABCDEFGHI"  # row by row: A is above left of the image, E inside it, I below right
MOTIONS = ("forward", "backward")  # of the target camera: its epipole is an antipode, or a true one
DISTANCE = 0.6  # scene units between the cameras; the relief lies 3 to 5 before the source
_COLUMN, _ROW = (-0.3, 0.35, 1.3), (-0.3, 0.6, 1.3)  # of the epipole, in image sides
_FUJI_SPACING = 62.4  # metres: tile 10/906/404 of 512 samples a side, at 35.3 degrees north
_CHUNK = 256  # rows made at once, so that making a large relief needs little memory


def relief(n: int) -> tuple[Array, Array]:
    """A smooth relief with a raised box and a raised disc.

    Returns
    -------
    color : uint8 (n, n, 3)
    depth : float32 (n, n)
        Planar z in scene units.
    """
    color, depth = np.empty((n, n, 3), np.uint8), np.empty((n, n), np.float32)
    x = np.linspace(-1, 1, n, dtype=np.float32)
    for top in range(0, n, _CHUNK):
        a, b = x[None, :], x[top : top + _CHUNK, None]
        z = 4.2 + 0.4 * np.sin(2.3 * a + 0.5) * np.cos(2.9 * b) + 0.2 * np.sin(4.1 * (0.6 * a + b) + 1)
        z -= 0.5 * ((np.abs(a + 0.45) < 0.2) & (np.abs(b + 0.4) < 0.25))
        z -= 0.4 * ((a - 0.35) ** 2 + (b - 0.4) ** 2 < 0.06)
        depth[top : top + _CHUNK] = z
        for channel, phase in enumerate((0.0, 2.0, 4.0)):
            waves = 0.3 * np.sin(9 * a + 5 * b + phase) + 0.2 * np.sin(23 * b - 11 * a * b + phase)
            color[top : top + _CHUNK, :, channel] = 255 * (0.5 + waves)
    return color, depth


def white_noise(n: int) -> tuple[Array, Array]:
    """The relief's colours, and depths between its nearest and its farthest that know nothing of their neighbours.

    Returns
    -------
    color : uint8 (n, n, 3)
    depth : float32 (n, n)
        Planar z in scene units.
    """
    color, depth = relief(n)
    low, high = depth.min(), depth.max()
    return color, low + (high - low) * np.random.default_rng(n).random((n, n), np.float32)


def data_folder() -> Path:
    """Where scanned meshes and real height maps are."""
    beside = Path(__file__).resolve().parent.parent.parent / "shared/data"
    return Path(os.environ.get("PYIBR_DATA", beside))


@functools.cache
def scanned(name: str) -> ibr.Mesh | Skip:
    """A scanned mesh of the data folder."""
    path = data_folder() / "meshes" / name
    if not path.is_file():
        return Skip(name.split("_")[0], f"{name} is not in $PYIBR_DATA/meshes")
    try:
        return ibr.Mesh.load(path)
    except ibr.MissingPackageError as error:
        return Skip(name.split("_")[0], str(error))


def bricks(n: int = 256) -> tuple[Array, Array]:
    """Height (n, n) uint8 and colour (n, n, 3) uint8 of a brick wall: 8 rows of 4, tiled."""
    y, x = np.mgrid[:n, :n] * (256 / n)
    shifted = (x + 32 * (y // 32 % 2)) % 64
    joint = np.minimum(np.minimum(shifted, 63 - shifted), np.minimum(y % 32, 31 - y % 32))
    rough = 0.5 + 0.5 * np.sin(x * np.pi / 16 + 3 * np.sin(y * np.pi / 32)) * np.sin(y * np.pi / 16)
    ramp = np.clip(joint / 14, 0, 1)
    height = 255 * ramp * ramp * (3 - 2 * ramp) * (0.75 + 0.25 * rough)
    stone = np.array([150, 82, 60]) * (0.7 + 0.3 * rough[..., None])
    color = np.where(joint[..., None] > 3, stone, (150, 145, 135))
    return height.astype(np.uint8), color.astype(np.uint8)


def terrain() -> tuple[Array, float] | Skip:
    """Heights (513, 513) float32 and spacing, in metres: the tile of mount Fuji that terrain meshers are timed on."""
    path = data_folder() / "heightfields/dem/fuji.png"
    if not path.is_file():
        return Skip("fuji", f"{path.name} is not in $PYIBR_DATA/heightfields/dem")
    import cv2

    blue, green, red = np.moveaxis(np.asarray(cv2.imread(str(path)), np.float64), -1, 0)
    heights = (-10000 + 0.1 * (65536 * red + 256 * green + blue)).astype(np.float32)
    return np.pad(heights, ((0, 1), (0, 1)), "edge"), _FUJI_SPACING


def bumps(n: int) -> Array:
    """(n, n) float32 in [0, 1]: smooth heights that are 0 on the border."""
    x = (np.arange(n) + 0.5) / n
    u, v = np.meshgrid(x, x)
    waves = 0.55 + 0.25 * np.sin(9 * u + 4 * v) * np.cos(11 * v - 3 * u) + 0.2 * np.sin(14 * u * v + 1)
    window = np.clip(8 * np.minimum(np.minimum(u, 1 - u), np.minimum(v, 1 - v)) - 0.2, 0, 1)
    return (waves * window * window * (3 - 2 * window)).clip(0, 1).astype(np.float32)


def source_camera(n: int) -> ibr.Camera:
    """Sees 80 degrees over the image's side."""
    middle = (n - 1) / 2
    return ibr.Camera([[0.6 * n, 0, middle], [0, 0.6 * n, middle], [0, 0, 1]], (n, n))


def view(n: int) -> ibr.DepthImage:
    """The relief as the source camera sees it."""
    return ibr.DepthImage(*relief(n), source_camera(n))


def epipole(n: int, region: str) -> Array:
    """(2,) pixel of the epipole in the target."""
    row, column = divmod(REGIONS.index(region), 3)
    return np.array([_COLUMN[column], _ROW[row]]) * (n - 1)


def translation(n: int, region: str, motion: str) -> Array:
    """(3,) where the source's centre lies in the target's frame; the cameras differ by nothing else."""
    toward = np.linalg.inv(source_camera(n).K) @ [*epipole(n, region), 1.0]
    return (1 if motion == "backward" else -1) * DISTANCE * toward / np.linalg.norm(toward)


def target_camera(n: int, region: str, motion: str) -> ibr.Camera:
    """The source camera moved so that the epipole lies in ``region``."""
    return source_camera(n).moved(*-translation(n, region, motion))
