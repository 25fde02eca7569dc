"""Images with depth, frames, silhouettes, and converters of depth."""

from pyibr.images.depth_image import DepthImage
from pyibr.images.frame import Frame, PixelClass

__all__ = ["DepthImage", "Frame", "PixelClass"]
