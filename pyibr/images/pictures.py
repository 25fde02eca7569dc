"""Preview pictures: depth as colours, an image next to its depth, a camera's frustum; a camera that sees a box."""

from __future__ import annotations

import itertools
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera
from pyibr.core.checks import Float64
from pyibr.core.shown import Shown, picture_of, save_as
from pyibr.images.srgb import in_bytes

Image = NDArray[np.uint8]

_STOPS: Float64 = np.array(
    [(10, 10, 60), (40, 40, 160), (20, 130, 170), (70, 180, 90), (230, 210, 60), (255, 255, 230)], np.float64
)
_RAMP = np.column_stack(
    [np.interp(np.linspace(0, len(_STOPS) - 1, 256), np.arange(len(_STOPS)), _STOPS[:, one]) for one in range(3)]
).astype(np.uint8)
"""(256, 3) colours from far to near."""

_ENDS = (1.0, 99.0)  # percentiles at the ends of the ramp, which exclude outliers
_SAMPLES = 4096  # pixels from which the percentiles are computed
_DRAWN = (640, 480)  # pixels of a camera's picture, before its size is halved
_BENT = 33  # points on each side of the image's border, which a lens bends
_PAPER, _INK, _AXES = (255, 255, 255), (90, 90, 90), ((210, 50, 50), (40, 150, 60), (50, 80, 210))


class Pictured(Shown):
    """Base of colours with depth."""

    color: NDArray[Any]
    depth: NDArray[np.float32]
    camera: Camera

    @property
    def known_depth(self) -> NDArray[np.float32]:
        """(H, W) depth, NaN where there is none."""
        return self.depth

    def save(self, path: str | PathLike[str]) -> None:
        """Write the colours, the depth or the camera, by the file's suffix. A missing folder is created.

        Parameters
        ----------
        path : path
            Pictures of 8 bits (PNG, JPG, BMP, WEBP, PPM) hold the colours, files of floats (NPY, NPZ, EXR, PFM, TIFF)
            the depth, which `pyibr.read_depth` reads without a scale, and JSON the camera. `pyibr.write_color` and
            `write_depth` write either in any format.

        Raises
        ------
        FileFormatError
            If the suffix is unknown, or the file cannot be written.

        Examples
        --------
        >>> import numpy as np
        >>> import pyibr as ibr
        >>> camera = ibr.Camera([[50, 0, 3], [0, 50, 6], [0, 0, 1]], (7, 13))
        >>> view = ibr.DepthImage(np.zeros((13, 7, 3), np.uint8), np.full((13, 7), 2, np.float32), camera)
        >>> for name in ("view.png", "view.npy", "view.json"):
        ...     view.save(name)
        >>> float(ibr.read_depth("view.npy").max())
        2.0
        """
        save_as(self, path)


def depth_colors(of: Pictured, background: tuple[int, int, int] = (0, 0, 0)) -> Image:
    """Depth as colours, lighter when nearer. For a perspective camera, the ramp is linear in 1 / depth."""
    depth = of.known_depth
    seen = np.isfinite(depth)
    near = 1 / depth[seen] if of.camera.projection == "perspective" else -depth[seen]
    made = np.empty((*depth.shape, 3), np.uint8)
    made[:] = background
    if near.size:
        low, high = np.percentile(near[:: max(near.size // _SAMPLES, 1)], _ENDS)
        made[seen] = _RAMP[np.clip((near - low) * (255 / max(high - low, 1e-30)), 0, 255).astype(np.uint8)]
    return made


def camera_before(low: Float64, high: Float64, up: Float64) -> Camera:
    """A camera that sees a whole box, obliquely from above; `up` is a direction of any length."""
    up = up / np.linalg.norm(up)
    side = np.cross(up, np.eye(3)[np.abs(up).argmin()])
    side /= np.linalg.norm(side)
    away = 0.45 * side + 0.35 * up + np.cross(side, up)
    middle, away = 0.5 * (low + high), away * (2.7 * 0.5 * np.linalg.norm(high - low) / np.linalg.norm(away))
    return Camera.look_at(middle + away, middle, up, (640, 480), fov_y=45.0)


@picture_of.register
def _(thing: Pictured) -> Image:
    parts = [in_bytes(thing.color)] if thing.color.shape[2] else []
    return np.concatenate([*parts, depth_colors(thing)], axis=1)


@picture_of.register
def _(thing: Camera) -> Image:
    """The camera's image border at one depth, as the lens bends it, rays to it, and axes: x red, y green, z blue."""
    from PIL import Image, ImageDraw

    own = Camera(thing.K, thing.size, projection=thing.projection, lens=thing.lens)
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]) * own.size - 0.5
    part = np.linspace(0, 1, _BENT)[:, None]
    pixels = np.concatenate([a + part * (b - a) for a, b in itertools.pairwise(corners)])
    reach = 0.5 * own.height / own.K[1, 1]
    border = own.unproject(pixels, np.full(len(pixels), 1.0 if own.projection == "perspective" else 4 * reach))
    starts = border * (0, 0, 0) if own.projection == "perspective" else border * (1, 1, 0)
    rays = np.stack([starts, border], axis=1)[::_BENT]
    axes = np.stack([np.zeros((3, 3)), reach * np.eye(3)], axis=1)
    ends = np.concatenate([border, starts, *axes])  # a lens may give no rays to the whole border
    low, high = np.nanmin(ends, axis=0), np.nanmax(ends, axis=0)
    away = np.array([-0.8, -0.7, -0.6]) * 1.3 * np.linalg.norm(high - low)
    view = Camera.look_at((low + high) / 2 + away, (low + high) / 2, (0, -1, 0), _DRAWN, fov_y=50)
    image = Image.new("RGB", _DRAWN, _PAPER)
    draw = ImageDraw.Draw(image)
    lines = [(border, _INK, 4), *((ray, _INK, 2) for ray in rays)]
    lines += [(axis, color, 6) for axis, color in zip(axes, _AXES, strict=True)]
    for line, color, width in lines:
        draw.line([tuple(place) for place in view.project(line[np.isfinite(line).all(axis=1)])[0]], color, width)
    return np.asarray(image.reduce(2))
