"""Stereo pairs for 3D televisions, headsets and coloured glasses."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from pyibr.capture.rigs import RenderOptions, Things, frames_of, stepped
from pyibr.core.camera import Camera
from pyibr.core.checks import number_from, numbers, one_of
from pyibr.core.errors import ArgumentError
from pyibr.images.srgb import linear_from_srgb, srgb_from_linear
from pyibr.warp.filling import Fill

if TYPE_CHECKING:
    from typing_extensions import Unpack

Color = NDArray[Any]
Layout = Literal["full-sbs", "half-sbs", "full-tb", "half-tb", "dubois", "gray"]
SyntheticView = Literal["both", "left", "right"]

SUFFIXES: dict[Layout, str] = {
    "full-sbs": "_LRF_Full_SBS",
    "half-sbs": "_LR",
    "full-tb": "_TBF_fulltb",
    "half-tb": "_TB",
    "dubois": "_redcyan",
    "gray": "_redcyan",
}
"""File name suffixes by which players recognise the layout, as in iw3."""

_INNER = (1.0, 99.0)  # percentiles of 1 / depth: a few far outliers are ignored
_STEPS = {"both": (-0.5, 0.5), "left": (-1.0, 0.0), "right": (0.0, 1.0)}  # positions of the eyes, in baselines

# Dubois (2009), red and cyan glasses: contribution of each eye's linear RGB to the picture's.
_DUBOIS = np.array(
    [
        [[0.437, 0.449, 0.164], [-0.062, -0.062, -0.024], [-0.048, -0.050, -0.017]],
        [[-0.011, -0.032, -0.007], [0.377, 0.761, 0.009], [-0.026, -0.093, 1.234]],
    ],
    np.float32,
)
_LUMA = np.array([0.299, 0.587, 0.114], np.float32)
_GRAY = np.array([[_LUMA, 0 * _LUMA, 0 * _LUMA], [0 * _LUMA, _LUMA, _LUMA]], np.float32)


def stereo(
    things: Things,
    camera: Camera | None = None,
    *,
    layout: Layout = "full-sbs",
    divergence: float = 2.0,
    convergence: float = 0.5,
    synthetic_view: SyntheticView = "both",
    depth_range: tuple[float, float] | None = None,
    fill: Fill | None = "background",
    **how: Unpack[RenderOptions],
) -> Color:
    """Draw things for two eyes, in one picture.

    Let `d` be 0 at the far end of `depth_range`, 1 at the near end, and linear in 1 / depth. In the left eye's picture,
    a point lies farther to the right than in the right eye's, by (`d` - `convergence`) times `divergence` per cent of
    the width. The eyes' cameras are parallel; they differ by a shift to the right.

    Parameters
    ----------
    things : thing or sequence of things
        As for `render`; depth images among them form one `WarpedView`.
    camera : Camera, optional
        Middle camera, perspective; its lens is ignored. By default the camera of the first depth image.
    layout : {"full-sbs", "half-sbs", "full-tb", "half-tb", "dubois", "gray"}
        The left picture beside the right one or above it, whole or squeezed to half; or both in one picture for red
        and cyan glasses, by Dubois' matrices or in gray.
    divergence : float
        Shift of the nearest point minus the shift of the farthest, in per cent of the width, 0 to 100.
    convergence : float
        Plane of the screen: from 0, the farthest point (the scene is in front of the screen), to 1, the nearest.
    synthetic_view : {"both", "left", "right"}
        Eyes that stand beside the camera; with "left" or "right", the other eye is at the camera.
    depth_range : (near, far), optional
        In scene units. By default the range of the middle 98 % of the pixels, of the first depth image or of the scene
        as `camera` sees it. Use the same range for all frames of a film.
    fill : {"background", "smooth", "inpaint", "exemplar", None}
        Content of regions that no depth image saw, as for `WarpedView`.
    **how
        Options of `render`: `light`, `background`, `samples`, `anisotropy`.

    Returns
    -------
    (H, W, 3)
        Has the dtype of the things' colours and the camera's size; a full layout doubles the width or the height.

    Raises
    ------
    ArgumentError
        An argument has a wrong type or value, or there is no camera.

    Examples
    --------
    >>> import numpy as np
    >>> import pyibr as ibr
    >>> camera = ibr.Camera.from_fov((64, 48), fov_x=60)
    >>> depth = np.full((48, 64), 4, np.float32)
    >>> depth[16:32, 24:40] = 2
    >>> view = ibr.DepthImage(np.full((48, 64, 3), 99, np.uint8), depth, camera)
    >>> ibr.stereo(view, divergence=5).shape
    (48, 128, 3)
    """
    one_of("layout", layout, Layout)
    rig = StereoRig(divergence, convergence, synthetic_view, depth_range)
    return joined([eye.color for eye in frames_of(rig, things, camera, fill, how)], layout)


@dataclass(frozen=True)
class StereoRig:
    """Two eyes beside a camera; the attributes are arguments of `stereo`."""

    divergence: float = 2.0
    convergence: float = 0.5
    synthetic_view: SyntheticView = "both"
    depth_range: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        number_from("divergence", self.divergence, 0.0, 100.0, "0 to 100, per cent of the width")
        number_from("convergence", self.convergence, 0.0, 1.0, "0, the farthest, to 1, the nearest")
        one_of("synthetic_view", self.synthetic_view, SyntheticView)
        near, far = numbers("depth_range", self.depth_range or (1, 1), (2,)).tolist()
        if not 0 < near <= far:
            raise ArgumentError("depth_range", "near > 0 and far >= near", f"{near:g} and {far:g}")

    def fitted(self, depths: Callable[[], NDArray[np.float32]]) -> StereoRig:
        """Return the rig with a depth range: the given one, or the range of the depths."""
        if self.depth_range is not None or not len(there := depths()):
            return self
        return replace(self, depth_range=depth_range_of(there))

    def cameras(self, camera: Camera) -> list[Camera]:
        """Return the cameras of the left and right eye, without lenses; without a depth range both are alike."""
        near, far = self.depth_range or (1.0, 1.0)
        span = 1 / near - 1 / far
        baseline = self.divergence / 100 * camera.width / (camera.K[0, 0] * span) if span else 0.0
        steps = (step * baseline for step in _STEPS[self.synthetic_view])
        return stepped(camera, steps, 1 / far + self.convergence * span)


def depth_range_of(depths: NDArray[np.float32]) -> tuple[float, float]:
    """Range (near, far) of nearly all depths."""
    low, high = np.percentile(1 / depths, _INNER)
    return float(1 / high), float(1 / low)


def joined(eyes: Sequence[Color], layout: Layout) -> Color:
    """Join the left and the right eye's picture, (H, W, 3), in this layout."""
    if layout in ("dubois", "gray"):
        return _anaglyph(eyes, layout)
    axis = 1 if layout.endswith("sbs") else 0
    return np.concatenate(eyes if layout.startswith("full") else [_halved(eye, axis) for eye in eyes], axis=axis)


def _halved(color: Color, axis: int) -> Color:
    """Average pairs of columns (axis 1) or rows (axis 0); the last one of an odd number is dropped."""
    pairs = color.swapaxes(0, axis)[: color.shape[axis] // 2 * 2]
    mean = (pairs[::2].astype(np.float32) + pairs[1::2]) / 2
    return _stored(mean.swapaxes(0, axis), color.dtype)


def _anaglyph(eyes: Sequence[Color], layout: Layout) -> Color:
    """Join pictures for red and cyan glasses; Dubois' matrices apply to linear light, clipped for each eye."""
    dtype = eyes[0].dtype
    scale = np.float32(1 if dtype == np.float32 else 255)
    left, right = (eye / scale for eye in eyes)
    if layout == "gray":
        return _stored(scale * (left @ _GRAY[0].T + right @ _GRAY[1].T), dtype)
    lights = [(linear_from_srgb(eye) @ own.T).clip(0, 1) for eye, own in zip((left, right), _DUBOIS, strict=True)]
    return _stored(scale * srgb_from_linear(lights[0] + lights[1]), dtype)


def _stored(color: NDArray[Any], dtype: np.dtype[Any]) -> Color:
    return color.astype(dtype) if dtype == np.float32 else np.rint(color).astype(dtype)
