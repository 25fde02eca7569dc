"""Images with depth, frames, silhouettes, and converters of depth."""

from __future__ import annotations

from pyibr.images.converters import (
    depth_from_disparity,
    depth_from_euclidean,
    depth_from_mpeg,
    depth_from_relative,
    depth_from_uint16,
    depth_from_zbuffer,
    disparity_from_depth,
    euclidean_from_depth,
    mpeg_from_depth,
    uint16_from_depth,
    zbuffer_from_depth,
)
from pyibr.images.depth_image import DepthImage
from pyibr.images.frame import Frame, PixelClass
from pyibr.images.noise import disparity_noise

__all__ = [
    "DepthImage",
    "Frame",
    "PixelClass",
    "depth_from_disparity",
    "depth_from_euclidean",
    "depth_from_mpeg",
    "depth_from_relative",
    "depth_from_uint16",
    "depth_from_zbuffer",
    "disparity_from_depth",
    "disparity_noise",
    "euclidean_from_depth",
    "mpeg_from_depth",
    "uint16_from_depth",
    "zbuffer_from_depth",
]
