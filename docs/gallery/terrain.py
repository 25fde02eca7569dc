"""A real terrain as depth images: the elevation model of the Jacksboro fault that matplotlib ships.

World axes: x points east, y north, z up, in metres. The origin is in the middle of the map, at sea level.
"""

from __future__ import annotations

import numpy as np
from matplotlib import cbook
from matplotlib.colors import LightSource, LinearSegmentedColormap
from numpy.typing import NDArray
from PIL import Image

import pyibr as ibr

METRES_PER_DEGREE = 111_200.0
LATITUDE = 36.6  # in degrees, at the map's middle; a degree of longitude is shorter by its cosine
EXAGGERATION = 2.5  # factor on heights; without it, 30 km of low hills would look flat
FINER = 4  # number of samples of the depth image per sample of the elevation model, in each direction
FLIGHT = 6000.0  # height of the map's camera above sea level, in metres
PIVOT = np.array((0.0, -2000.0, EXAGGERATION * 500.0))  # the point that the views look at

_LAND = ("#2f5d4a", "#5f8a56", "#a9b46f", "#d9c58b", "#b58a5e", "#8c6a55", "#e9e4dc")


def height_field() -> ibr.DepthImage:
    """Return the terrain as seen from above by an orthographic camera, with the same scale in both directions."""
    path = str(cbook.get_sample_data("jacksboro_fault_dem.npz", asfileobj=False))
    with np.load(path) as stored:
        elevation = stored["elevation"].astype(np.float32)
        step_x = METRES_PER_DEGREE * float(stored["dx"]) * np.cos(np.radians(LATITUDE)) / FINER
        step_y = METRES_PER_DEGREE * float(stored["dy"]) / FINER
    rows, columns = elevation.shape
    larger = Image.fromarray(elevation).resize((columns * FINER, rows * FINER), Image.Resampling.BICUBIC)
    height = _blurred(np.asarray(larger), 1.5)  # blurred, since heights in whole metres would show as steps
    rows, columns = height.shape

    K = [[1 / step_x, 0, (columns - 1) / 2], [0, 1 / step_y, (rows - 1) / 2], [0, 0, 1]]
    from_above = np.eye(4)
    from_above[:3, :3] = np.diag((1, -1, -1))  # the image's rows go south, the camera looks down
    from_above[2, 3] = FLIGHT
    camera = ibr.Camera(K, (columns, rows), from_above, projection="orthographic")
    depth = (FLIGHT - EXAGGERATION * height).astype(np.float32)
    return ibr.DepthImage(_shaded(height, step_x, step_y), depth, camera)


def _blurred(height: NDArray[np.float32], sigma: float) -> NDArray[np.float32]:
    """Blur heights by a Gaussian; its standard deviation is in samples."""
    reach = round(3 * sigma)
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2).astype(np.float32)
    for axis in (0, 1):
        padded = np.pad(height, [(reach, reach) if axis == along else (0, 0) for along in (0, 1)], mode="edge")
        parts = (np.take(padded, range(k, k + height.shape[axis]), axis) for k in range(len(weights)))
        height = sum(weight * part for weight, part in zip(weights, parts, strict=True)) / weights.sum()
    return height


def _shaded(height: NDArray[np.float32], step_x: float, step_y: float) -> NDArray[np.uint8]:
    """Colour the terrain by height, and shade it by a light from the north-west."""
    colors = LinearSegmentedColormap.from_list("land", _LAND)(np.clip((height - 230) / 850, 0, 1))[..., :3]
    light = LightSource(azdeg=315, altdeg=40)
    shaded = light.shade_rgb(colors, height, blend_mode="soft", vert_exag=EXAGGERATION, dx=step_x, dy=step_y)
    return np.rint(np.clip(shaded, 0, 1) * 255).astype(np.uint8)


def extent_of(camera: ibr.Camera) -> tuple[float, float, float, float]:
    """Return the west, east, south and north end of the map in metres, as matplotlib's `extent`."""
    last = camera.width - 0.5, camera.height - 0.5
    (west, north, _), (east, south, _) = camera.unproject([(-0.5, -0.5), last], [1.0, 1.0]).tolist()
    return west, east, south, north


def camera_at(turned: float, climbed: float, nearer: float, size: tuple[int, int], fov_y: float) -> ibr.Camera:
    """Return a camera that looks at PIVOT: rotated by degrees, raised by metres, then moved nearer by a factor."""
    x, y, z = 0.0, -17_000.0, 11_000.0 + climbed
    a = np.radians(turned)
    offset = np.array((x * np.cos(a) - y * np.sin(a), x * np.sin(a) + y * np.cos(a), z))
    return ibr.Camera.look_at(PIVOT + nearer * offset, PIVOT, (0, 0, 1), size, fov_y=fov_y)


def source_view(field: ibr.DepthImage, size: tuple[int, int] = (1500, 1000)) -> ibr.DepthImage:
    """Return the terrain as a perspective camera sees it, without the parts that hills hide."""
    camera = camera_at(0, 0, 1, size, fov_y=38)
    frame = ibr.warp(field, camera, edges="connect")  # a height field is one surface
    return ibr.DepthImage(frame.color, frame.depth, camera)
