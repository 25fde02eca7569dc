"""Things one sample thin in depth images, as ribbons by the samples that they cover (kernels/lib/ribbons.h)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pyibr.images import DepthImage
from pyibr.opencl.device import one_call
from pyibr.opencl.device_cache import cached_on_device
from pyibr.opencl.headers import constant
from pyibr.opencl.launch import Struct, launch
from pyibr.opencl.memory import empty, upload
from pyibr.opencl.program import kernel
from pyibr.picture.surface import surface_of

_KERNELS = "slicing/ribbons.cl"
_CUT_RATIO = 1.05  # as by default in pictures
_AT_ONCE = 1 << 16  # samples: most of their ways begin no ribbon, but take memory
_TOUCHING = 1e-4  # samples: what covers no more of a sample than that does not


@dataclass(frozen=True)
class Ribbons:
    """The ribbons of a view.

    Attributes
    ----------
    counts : (H, W) int32
        How many cover a part of each sample's square.
    records : (N, 8) float32
        Those of each sample, one sample after the other, as kernels/slicing/ribbons.cl writes them.
    """

    counts: NDArray[np.int32]
    records: NDArray[np.float32]


def ribbons_of(view: DepthImage) -> Ribbons:
    """The ribbons of a view, found once."""
    return cached_on_device(view, "ribbons", lambda: _found(view))


def _found(view: DepthImage) -> Ribbons:
    width, height = view.camera.size
    floats, ways = int(constant(_KERNELS, "RIBBON_FLOATS")), int(constant("lib/ribbons.h", "NEIGHBOURS"))
    with one_call():
        surface = surface_of(view, _CUT_RATIO)
        image = {
            "surface": surface.nearness,
            "width": width,
            "height": height,
            "pitch": surface.nearness.shape[1],
            "cut": Struct("Cut", surface.test.cut),
        }
        thin = empty((height, width), np.uint8)
        launch(kernel(_KERNELS, "mark_thin"), (height,), thin=thin, **image)
        samples = np.flatnonzero(thin.to_host()).astype(np.int32)
        found = [np.empty((0, floats), np.float32)]
        for first in range(0, len(samples), _AT_ONCE):
            some = samples[first : first + _AT_ONCE]
            ribbons = empty((len(some), ways, floats), np.float32)
            launch(
                kernel(_KERNELS, "find_ribbons"),
                (len(some),),
                samples=upload(some),
                ribbons=ribbons,
                count=len(some),
                **image,
            )
            records = ribbons.to_host().reshape(-1, floats)
            found.append(records[records[:, 4] > constant("lib/pixelspace.h", "NO_SURFACE")])
    return _by_sample(np.concatenate(found), width, height)


def _by_sample(records: NDArray[np.float32], width: int, height: int) -> Ribbons:
    """Each ribbon at all samples of whose squares it covers a part."""
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
    counts = np.bincount(every, minlength=width * height).reshape(height, width).astype(np.int32)
    return Ribbons(counts, records[np.concatenate([np.empty(0, np.intp), *which])[order]])
