"""Features of samples carried over to a picture, and gradients back to the samples (kernels/warp/features.cl)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.core.pixelspace import CameraPair, pitch
from pyibr.images.depth_image import Features
from pyibr.opencl.device import current
from pyibr.opencl.headers import constant
from pyibr.opencl.launch import launch
from pyibr.opencl.memory import DeviceArray, empty, upload
from pyibr.opencl.program import Kernel, kernel
from pyibr.picture.surface import Surface
from pyibr.picture.target import Target, in_words
from pyibr.warp.launches import map_of


def find_corners(target: Target, surface: Surface, pair: CameraPair, view: int, linear: bool) -> DeviceArray:
    """Return the samples, with weights, from which a view's pixels of a finished picture are interpolated.

    The picture has the origins of its pixels.
    """
    width, height = target.camera.size
    corners = empty((int(constant("warp/features.cl", "CORNER_PLANES")), height, pitch(width)), np.float32)
    launch(
        _kernel("find_corners"),
        current().profile.packets(width, height, current().profile.strip),
        surface=surface.nearness,
        depth=target.depth,
        corners=corners,
        map=map_of(pair),
        linear=linear,
        pinhole=target.camera.lens is None,
        view=view,
        **target.origins,
    )
    return corners


def gather_features(corners: DeviceArray, features: Features, target: Target, first: bool) -> None:
    """Write the features of a view's pixels; if the view is the `first`, other pixels become 0."""
    made = target.made_features(features.shape[2], features.dtype)
    (height, width, channels), profile = made.shape, current().profile
    each = 1 if profile.lanes == 1 else profile.strip * profile.lanes * channels
    launch(
        _kernel("gather_features", FEATURE_BYTES=features.dtype.itemsize),
        (-(-width * channels // each), height),
        features=upload(in_words(features)),
        pixel_features=made,
        each=each,
        first=first,
        channels=channels,
        **_sizes(corners, width),
    )


def scatter_features(corners: DeviceArray, gradient: NDArray[np.float32], shape: tuple[int, int]) -> DeviceArray:
    """Return the sums (H, W, C) of the pixels' values, (height, width, C), at the samples of a view of a `shape`."""
    (_, width, channels), profile = gradient.shape, current().profile
    sums, bands = empty((*shape, channels), np.float32), profile.chunks
    each = 1 if profile.lanes == 1 else channels
    sizes = _sizes(corners, width)
    ranges = empty((gradient.shape[0], 2), np.int32)
    launch(_kernel("find_ranges"), (gradient.shape[0],), ranges=ranges, **sizes)
    launch(
        _kernel("scatter_features"),
        (-(-channels // each), bands),
        ranges=ranges,
        channels=channels,
        gradient=upload(gradient),
        sums=sums,
        samples=shape[0] * shape[1],
        each=each,
        bands=bands,
        **sizes,
    )
    return sums


def _kernel(name: str, **defines: int) -> Kernel:
    return kernel("warp/features.cl", name, CHANNELS=0, **defines)


def _sizes(corners: DeviceArray, width: int) -> dict[str, Any]:
    _, height, row = corners.shape
    return {"corners": corners, "width": width, "height": height, "pitch": row}
