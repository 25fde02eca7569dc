"""The warping paper's models as depth images: a globe, a torus and the head of a scanned dragon.

The models follow section 7 of Schaufler and Priglinger, "Efficient Displacement Mapping by Image Warping" (1999). In
the world, x points right, y down and z forward. The scan of the dragon has +y up, and is turned about the x axis.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import pyibr as ibr
from pyibr.capture import MeshScene, cube_cameras, models
from pyibr.capture.frusta import load_frusta
from pyibr.picture.light import light_for

Float64 = NDArray[np.float64]
Uint8 = NDArray[np.uint8]

DRAGON_HEAD = Path(__file__).with_name("dragon-head.json")
"""Frusta of `dragon_head`, in the axes of the scan (+y is up)."""
TORUS = Path(__file__).with_name("torus.json")
"""Frusta of `torus`."""


def torus(size: int) -> list[ibr.DepthImage]:
    """Six depth images of `pyibr.capture.models.torus_mesh` from frusta around it, which also see its inner wall.

    `propose_frusta(torus_mesh(), 6)` proposed these frusta.
    """
    mesh = models.torus_mesh()
    return [frustum.resized(size).capture(mesh) for frustum in load_frusta(TORUS)[0]]


def dragon_head(mesh_path: Path, size: int) -> list[ibr.DepthImage]:
    """Sixteen depth images that cover the head of the Stanford dragon, lit from above, as in the figures 11 to 13.

    `pyibr place --auto 16 --within ...` proposed the frusta. In their images, the dragon's other parts were erased by
    hand.
    """
    scanned = ibr.Mesh.load(mesh_path)
    light, turned = light_for(scanned, (0, 1, 0)), np.diag([1.0, -1.0, -1.0, 1.0])
    images = [frustum.resized(size).capture(scanned, light) for frustum in load_frusta(DRAGON_HEAD)[0]]
    cameras = [ibr.Camera(one.camera.K, one.camera.size, turned @ one.camera.world_from_camera) for one in images]
    return [ibr.DepthImage(one.color, one.depth, at, far=one.far) for one, at in zip(images, cameras, strict=True)]


def dragon_scene(mesh_path: Path) -> MeshScene:
    """The dragon's surface in the axes of `dragon_head`'s images, for ray casting."""
    scanned = ibr.Mesh.load(mesh_path)
    return MeshScene(scanned.vertices * np.array([1.0, -1.0, -1.0]), scanned.faces)


def globe(
    size: int, elevation: NDArray[np.float32] | None = None, color: Uint8 | None = None, *, relief: float = 0.08
) -> list[ibr.DepthImage]:
    """Six depth images of a globe of radius 1 with displaced terrain, taken from its centre, which is the origin.

    A viewer outside sees the back of the surface: draw the images with `side="back"`, and with `edges="connect"`, as
    the surface is connected even where it is steep. Depth is exact at the samples: no ray is cast.

    Parameters
    ----------
    size : int
        Width and height of each image in pixels.
    elevation : (h, w) float32 in [0, 1], optional
        Equirectangular: longitude -180 to 180 degrees from left to right, latitude 90 to -90 degrees downwards.
        Interpolated bilinearly. Default: continents from noise with a fixed seed.
    color : (h', w', 3) uint8, optional
        Equirectangular. Default: a colour scale of the elevation.
    relief : float
        Outward displacement at elevation 1, in radii.
    """
    views: list[ibr.DepthImage] = []
    y, x = np.mgrid[:size, :size]
    for camera in cube_cameras((0, 0, 0), size):
        ray = camera.unproject(np.column_stack([x.ravel(), y.ravel()]), np.ones(size * size))
        length = np.linalg.norm(ray, axis=1)
        direction = ray / length[:, None]
        height = _noise(direction) if elevation is None else _on_sphere(elevation[..., None], direction)[:, 0]
        painted = _hypsometric(height) if color is None else _on_sphere(color, direction)
        depth = ((1 + relief * height) / length).astype(np.float32)
        views.append(ibr.DepthImage(_in_bytes(painted).reshape(size, size, 3), depth.reshape(size, size), camera))
    return views


def load_earth(folder: Path) -> tuple[NDArray[np.float32], Uint8]:
    """Elevation (h, w) float32 in [0, 1] and colour (h', w', 3) uint8 of the earth for `globe`.

    The folder holds `earth-topology.png` and `earth-blue-marble.jpg`, both equirectangular.
    """
    height = ibr.read_color(folder / "earth-topology.png")
    color = ibr.read_color(folder / "earth-blue-marble.jpg")
    return (height[..., 0] / 255).astype(np.float32), _in_bytes(np.asarray(color, np.float64))


def _in_bytes(values: Float64) -> Uint8:
    """Round colours from 0 to 255 to bytes."""
    return np.clip(np.floor(values + 0.5), 0, 255).astype(np.uint8)


def _on_sphere(image: NDArray[Any], direction: Float64) -> Float64:
    """Interpolate an equirectangular image (h, w, C) bilinearly in directions (n, 3); returns (n, C)."""
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
    """Colours (n, 3) from 0 to 255 for elevations: sea, beach, plain, rock and snow."""
    stops = [0.0, 0.004, 0.03, 0.2, 0.45, 0.7]
    colors = np.array([[22, 60, 120], [205, 190, 130], [70, 130, 60], [110, 120, 60], [130, 105, 85], [245, 245, 250]])
    return np.stack([np.interp(height, stops, colors[:, channel]) for channel in range(3)], axis=1)
