"""A rendered view, and what its pixels are."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from pyibr.core.camera import Camera
from pyibr.images.depth_image import Color, Depth
from pyibr.images.pictures import Pictured


class PixelClass(IntEnum):
    """Class of a pixel of a new view. Of several views' answers for a hole the least counts: what knows most.

    A hole's class is what begins beyond the last place where the pixel's ray was seen to pass through free space; of a
    ray that never was, what it began in.

    Examples
    --------
    >>> import pyibr as ibr
    >>> ibr.PixelClass(1).name
    'HIDDEN'
    """

    SEEN = 0
    """The source saw what is there."""
    HIDDEN = 1
    """What is there was hidden from the source by something nearer."""
    UNOBSERVED = 2
    """The source has no depth there."""
    OUTSIDE = 3
    """What is there lies outside of the source's image."""


@dataclass(frozen=True, eq=False)
class Frame(Pictured):
    """A rendered view.

    Attributes
    ----------
    color : (H, W, 3)
        In the dtype of the input's colour; black where not valid, unless holes were filled. (H, W, 0) of views that
        are depth alone.
    depth : (H, W) float32
        Planar z in `camera`'s frame; NaN where not valid.
    valid : (H, W) bool
        False in holes: pixels that no surface was seen through.
    camera : Camera
    classes : (H, W) uint8, or None
        If they were asked for: what each pixel is, a `PixelClass`.
    source : (H, W, 2) float32, or None
        If they were asked for: the place (x, y) in the source where each pixel's ray meets the surface, between its
        samples (whatever `sample` is); NaN where not valid. What belongs to the source (labels, features, flow)
        is carried over with it, by `cv2.remap` or by indexing.
    view : (H, W) int32, or None
        If they were asked for: the number of the view that it comes from, -1 where not valid.
    alpha : (H, W) float32, or None
        Of several samples a pixel: the share of them through which something was seen, 0 to 1. The colour is the mean
        of all of them; without a background, and unless holes were filled, that is the things' own colour times alpha.
        Filled samples make up the rest of a pixel's colour, but change neither its alpha nor its depth, which is of
        what is in front among what was seen; where nothing was, it is that of the filled samples.
    guessed : (H, W) bool, or None
        If a thing was drawn that guesses, as a `DepthMeshObject` that is closed: the pixels that show surface which no
        view saw; of several samples a pixel those with any such sample. They are valid, to be looked at; what was seen,
        to be measured with, is `valid & ~guessed`. Holes that were filled are not valid and are not told here.

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

    def __repr__(self) -> str:
        color = self.color.dtype if self.color.shape[2] else "depth alone"
        return f"<Frame {self.camera.width}x{self.camera.height} {color}>"
