"""Sharpening of the soft edges in depth from networks."""

from __future__ import annotations

import numpy as np

from pyibr.cleaning.stages import Image
from pyibr.images.depth_image import Depth, checked_depth
from pyibr.opencl.device import one_call


def sharpen_depth(depth: Depth) -> Depth:
    """Sharpen the edges of depth that was estimated by a network or enlarged with interpolation.

    Such depth has ramps of several pixels between surfaces, and in new views surfaces smear along these ramps. Each
    sample of a ramp of up to 24 pixels is moved to the closer of the two surfaces, which is extrapolated to the sample.
    All other samples keep their depth to the bit. Depth of cameras is noisy and needs `clean_depth` instead.

    Parameters
    ----------
    depth : (H, W) float32
        Planar z in scene units; NaN, infinite or <= 0 where there is no depth.

    Returns
    -------
    (H, W) float32
        Sharpened depth; NaN where there is no depth.

    Raises
    ------
    ArgumentError
        If shape or dtype do not fit, or there are more pixels than kernels can index.

    Examples
    --------
    >>> import numpy as np
    >>> import pyibr as ibr
    >>> ramp = np.interp(np.arange(20), [7, 12], [0.5, 0.25])  # nearness: from a depth of 2 to one of 4
    >>> soft = np.tile((1 / ramp).astype(np.float32), (15, 1))
    >>> ibr.sharpen_depth(soft)[7, 7:13].tolist()
    [2.0, 2.0, 2.0, 4.0, 4.0, 4.0]
    """
    given = checked_depth(depth, (None, None))
    known = (given > 0) & (given < np.inf)
    nearness = np.zeros(given.shape, np.float32)
    with np.errstate(over="ignore"):  # samples whose nearness exceeds float32 stay unchanged
        np.divide(1, given, out=nearness, where=known)
    with one_call():
        image = Image(given.shape[1], given.shape[0])
        sharp = image.sharpen(image.place(nearness))
    made = np.where(known, given, np.float32(np.nan))
    np.divide(1, sharp, out=made, where=sharp > 0)
    return made
