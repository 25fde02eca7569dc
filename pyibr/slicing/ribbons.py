"""Thin parts of depth images, one sample wide, as ribbons for each sample that they cover (kernels/lib/ribbons.h)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pyibr.images import DepthImage
from pyibr.opencl.device import one_call
from pyibr.opencl.device_cache import cached_on_device
from pyibr.opencl.headers import constant
from pyibr.opencl.launch import launch
from pyibr.opencl.memory import empty
from pyibr.opencl.program import kernel
from pyibr.picture.surface import surface_of

_KERNELS = "slicing/ribbons.cl"
_CUT_RATIO = 1.05  # the default of pictures
_TOUCHING = 1e-4  # samples: overlaps of this size are rounding errors


Ribbons = tuple[NDArray[np.int32], NDArray[np.float32]]
"""Counts (H * W,) of the ribbons that cover a part of each sample's square; and the records (N, 8) of each sample's
ribbons, one sample after the other, as kernels/slicing/ribbons.cl writes them."""


def ribbons_of(view: DepthImage) -> Ribbons:
    """Return the ribbons of a view, computed once."""
    return cached_on_device(view, "ribbons", lambda: _found(view))


def _found(view: DepthImage) -> Ribbons:
    width, height = view.camera.size
    with one_call():
        surface = surface_of(view, _CUT_RATIO)
        count = surface.ribbons.shape[0]
        records = empty((count, int(constant(_KERNELS, "RIBBON_FLOATS"))), np.float32)
        if count:
            launch(
                kernel(_KERNELS, "record_ribbons"),
                (count,),
                numbers=surface.ribbons,
                records=records,
                count=count,
                **surface.grid,
            )
        return _by_sample(records.to_host(), width, height)


def _by_sample(records: NDArray[np.float32], width: int, height: int) -> Ribbons:
    """Assign each ribbon to all samples whose squares it partly covers."""
    ends = np.sort(np.stack([records[:, 0:2], records[:, 0:2] + records[:, 2:4]]), axis=0)
    first = np.floor(ends[0] + _TOUCHING).astype(int)
    last = np.floor(ends[1] + 1 - _TOUCHING).astype(int)
    at, which = list[NDArray[np.intp]](), list[NDArray[np.intp]]()
    for down, across in np.ndindex(*(last - first + 1).max(axis=0, initial=0)[::-1]):
        x, y = first[:, 0] + across, first[:, 1] + down
        covers = (x <= last[:, 0]) & (y <= last[:, 1]) & (x >= 0) & (y >= 0) & (x < width) & (y < height)
        at.append((y * width + x)[covers])
        which.append(np.flatnonzero(covers))
    every = np.concatenate([np.empty(0, np.intp), *at])
    order = np.argsort(every, kind="stable")
    counts = np.bincount(every, minlength=width * height).astype(np.int32)
    return counts, records[np.concatenate([np.empty(0, np.intp), *which])[order]]
