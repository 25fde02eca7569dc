"""Quilts: many views of a scene in one picture, for Looking Glass displays."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pyibr.capture.rigs import RenderOptions, Things, framed, frames_of, stepped
from pyibr.core.camera import Camera
from pyibr.core.checks import checked_size, number_from, positive
from pyibr.core.errors import ArgumentError
from pyibr.warp.filling import Fill

if TYPE_CHECKING:
    from typing_extensions import Unpack

_VIEWS_MAX = 1024


def quilt(
    things: Things,
    camera: Camera | None = None,
    *,
    grid: tuple[int, int] = (8, 6),
    size: tuple[int, int] | None = None,
    cone: float = 20.0,
    focus: float | None = None,
    fill: Fill | None = "background",
    **how: Unpack[RenderOptions],
) -> NDArray[Any]:
    """Draw a quilt: a grid of views from left to right, row by row upwards, starting at the lower left.

    The cameras stand side by side with parallel axes. Their principal points are shifted so that points at depth
    `focus` keep their place in all views. Seen from there, neighbouring cameras are `cone` / (views - 1) degrees
    apart.

    Parameters
    ----------
    things, camera, fill, **how
        As for `stereo`.
    grid : (columns, rows)
        At least 2 views, at most 1024.
    size : (width, height), optional
        Size of each view in pixels. A view shows as much of the camera's picture as its aspect ratio allows. By
        default the camera's size.
    cone : float
        Degrees between the outermost views, more than 0 and up to 179.
    focus : float, optional
        Depth of the display's plane, in scene units. By default the median depth of the first depth image, or of the
        scene as `camera` sees it.

    Returns
    -------
    (rows H, columns W, 3)
        In the dtype of the things' colours. `pyibr.capture.quilt.suffix_of` returns a suffix for the file's name.

    Raises
    ------
    ArgumentError
        An argument has a wrong type or value, or there is no camera.

    Examples
    --------
    >>> import numpy as np
    >>> import pyibr as ibr
    >>> camera = ibr.Camera.from_fov((48, 64), fov_x=40)
    >>> view = ibr.DepthImage(np.full((64, 48, 3), 99, np.uint8), np.full((64, 48), 2, np.float32), camera)
    >>> ibr.quilt(view, grid=(3, 2)).shape
    (128, 144, 3)
    """
    frames = frames_of(QuiltRig(grid, size, cone, focus), things, camera, fill, how)
    return tiled([frame.color for frame in frames], grid)


def suffix_of(grid: tuple[int, int], size: tuple[int, int]) -> str:
    """Suffix of a quilt's file name, from which displays read its grid and aspect ratio: _qs8x6a0.75."""
    return f"_qs{grid[0]}x{grid[1]}a{size[0] / size[1]:.4g}"


@dataclass(frozen=True)
class QuiltRig:
    """Cameras side by side; the attributes are arguments of `quilt`."""

    grid: tuple[int, int] = (8, 6)
    size: tuple[int, int] | None = None
    cone: float = 20.0
    focus: float | None = None

    def __post_init__(self) -> None:
        columns, rows = checked_size(self.grid, "grid", "(columns, rows)")
        if not 2 <= columns * rows <= _VIEWS_MAX:
            raise ArgumentError("grid", f"2 to {_VIEWS_MAX} views", f"{columns}x{rows}")
        if self.size is not None:
            checked_size(self.size)
        number_from("cone", self.cone, 1e-3, 179.0, "degrees > 0, up to 179")
        if self.focus is not None:
            positive("focus", self.focus, "a depth > 0")

    def fitted(self, depths: Callable[[], NDArray[np.float32]]) -> QuiltRig:
        """Return the rig with a focus: the given one, or the median of the depths."""
        if self.focus is not None or not len(there := depths()):
            return self
        return replace(self, focus=float(np.median(there)))

    def cameras(self, camera: Camera) -> list[Camera]:
        """Return cameras from left to right, without lenses; without a focus all are in one place."""
        half = math.radians(self.cone) / 2
        steps = (self.focus or 0.0) * np.tan(np.linspace(-half, half, math.prod(self.grid)))
        return stepped(framed(camera, self.size or camera.size), steps.tolist(), 1 / (self.focus or 1.0))


def tiled(views: Sequence[NDArray[Any]], grid: tuple[int, int]) -> NDArray[Any]:
    """Tile equal pictures (H, W, 3), from left to right, row by row upwards, starting at the lower left."""
    columns, rows = grid
    height, width, channels = views[0].shape
    whole = np.empty((rows, height, columns, width, channels), views[0].dtype)
    for number, view in enumerate(views):
        row, column = divmod(number, columns)
        whole[rows - 1 - row, :, column] = view
    return whole.reshape(rows * height, columns * width, channels)
