"""A rendered view and the classes of its pixels."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera
from pyibr.images.depth_image import Color, Depth, Features
from pyibr.images.pictures import Pictured


class PixelClass(IntEnum):
    """Class of a pixel of a new view.

    A hole's class is that of the region where the pixel's ray leaves the last stretch of observed free space. If the
    ray crosses no observed free space, the class is that of the region where the ray starts. If several views disagree
    about a hole, the lowest value wins, since it is the most specific.

    Examples
    --------
    >>> import pyibr as ibr
    >>> ibr.PixelClass(1).name
    'HIDDEN'
    """

    SEEN = 0
    """The source saw this surface."""
    HIDDEN = 1
    """A nearer surface occludes this region in the source."""
    UNOBSERVED = 2
    """The source has no depth for this region."""
    OUTSIDE = 3
    """This region lies outside of the source's image."""


@dataclass(frozen=True, eq=False)
class Frame(Pictured):
    """A rendered view.

    Attributes
    ----------
    color : (H, W, 3)
        Colours, in the dtype of the input's colour; black where not valid, unless holes were filled. The shape is
        (H, W, 0) if the views are depth alone.
    depth : (H, W) float32
        Planar z in `camera`'s frame; NaN where not valid.
    valid : (H, W) bool
        False in holes: pixels that show no surface.
    camera : Camera
    classes : (H, W) uint8, or None
        If requested: the `PixelClass` of each pixel.
    source : (H, W, 2) float32, or None
        If requested: the position (x, y) in the source where each pixel's ray meets the surface, with subpixel
        precision (with any `interpolation`); NaN where not valid. To transfer labels or features, give the source
        `DepthImage.features`, which do not mix across depth edges.
    view : (H, W) int32, or None
        If requested: the index of the view that each pixel comes from, -1 where not valid.
    alpha : (H, W) float32, or None
        The opacity of each pixel, if there are several samples per pixel or things that are not opaque (`Gaussians`).
        With several samples, it is the mean of the samples' opacities: 1 where a sample shows a surface, else 0 or that
        of the Gaussians. The colour is the mean of all samples; without a background and without filled holes, it is
        the surface's colour times alpha. Filled samples contribute to the pixel's colour, but not to its alpha. The
        depth is the front surface's among the seen samples, or among the filled samples where no sample was seen.
    features : (H, W, C), or None
        If the views have features: those of the surface at each pixel, in their dtype, 0 where not valid. `warp` takes
        them from the samples and with the weights from which it interpolates colours. With several views, the features
        of a pixel come from one of them, `view`.
    guessed : (H, W) bool, or None
        If a drawn object guesses surface, as a closed `DepthMeshObject` does: the pixels that show surface which no
        view saw. With several samples per pixel, one such sample suffices. Guessed pixels are valid, but only for
        viewing: `valid & ~guessed` are the pixels to measure with. Filled holes are not valid and not marked here.

    Examples
    --------
    >>> import numpy as np
    >>> import pyibr as ibr
    >>> camera = ibr.Camera([[50, 0, 3], [0, 50, 6], [0, 0, 1]], (7, 13))
    >>> view = ibr.DepthImage(np.zeros((13, 7, 3), np.uint8), np.full((13, 7), 2, np.float32), camera)
    >>> ibr.warp(view, camera)
    <Frame 7x13 uint8>
    """

    color: Color
    depth: Depth
    valid: NDArray[np.bool_]
    camera: Camera
    classes: NDArray[np.uint8] | None = None
    source: NDArray[np.float32] | None = None
    view: NDArray[np.int32] | None = None
    alpha: NDArray[np.float32] | None = None
    guessed: NDArray[np.bool_] | None = None
    features: Features | None = None

    def __repr__(self) -> str:
        color = self.color.dtype if self.color.shape[2] else "depth alone"
        return f"<Frame {self.camera.width}x{self.camera.height} {color}>"
